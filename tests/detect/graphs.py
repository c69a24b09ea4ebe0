"""Tiny ONNX graphs that answer every picture with the same arrays."""

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

SIZE = (64, 96)
"""Height and width of their input."""


def write_graph(
    path, outputs, *, shape=(1, 3, *SIZE), kind=TensorProto.FLOAT, further=(), names=None
):
    """Save a graph with ``outputs`` {name: array}; ``further`` inputs are (name, type, shape)."""
    nodes, constants, described = [], [], []
    for name, array in outputs.items():
        constants.append(numpy_helper.from_array(array, f"{name}_values"))
        nodes.append(helper.make_node("Identity", [f"{name}_values"], [name]))
        described.append(helper.make_tensor_value_info(name, constants[-1].data_type, array.shape))
    inputs = [helper.make_tensor_value_info("image", kind, shape)]
    inputs += [helper.make_tensor_value_info(*values) for values in further]
    save(path, helper.make_graph(nodes, "constant", inputs, described, constants), names)
    return path


def write_echo(path, *, shape=(1, 3, *SIZE), kind=TensorProto.FLOAT):
    """A graph whose only box is (mean of each channel of the input, 0), label 2, score 1."""
    axes = [1, 2] if shape[3] == 3 else [2, 3]
    constants = [
        numpy_helper.from_array(np.array(axes), "axes"),
        numpy_helper.from_array(np.array([1, 1, 3]), "row"),
        numpy_helper.from_array(np.array([[[0, 1]]], np.float32), "rest"),
        numpy_helper.from_array(np.array([[2]]), "two"),
    ]
    nodes = [
        helper.make_node("Cast", ["image"], ["real"], to=TensorProto.FLOAT),
        helper.make_node("ReduceMean", ["real", "axes"], ["means"], keepdims=0),
        helper.make_node("Reshape", ["means", "row"], ["triple"]),
        helper.make_node("Concat", ["triple", "rest"], ["dets"], axis=2),
        helper.make_node("Identity", ["two"], ["labels"]),
    ]
    outputs = [
        helper.make_tensor_value_info("dets", TensorProto.FLOAT, (1, 1, 5)),
        helper.make_tensor_value_info("labels", TensorProto.INT64, (1, 1)),
    ]
    inputs = [helper.make_tensor_value_info("image", kind, shape)]
    save(path, helper.make_graph(nodes, "echo", inputs, outputs, constants), None)
    return path


def save(path, graph, names):
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    if names:
        helper.set_model_props(model, {"names": repr(dict(enumerate(names)))})
    onnx.checker.check_model(model)
    onnx.save(model, str(path))


def cells(strides, size=SIZE):
    """(column, row, stride) of each cell, level by level, row by row."""
    return [
        (column, row, stride)
        for stride in strides
        for row in range(-(-size[0] // stride))
        for column in range(-(-size[1] // stride))
    ]
