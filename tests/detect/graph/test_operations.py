"""Every operation against ONNX's own examples of it, and the usual ones against ONNX Runtime."""

import warnings

import numpy as np
import onnxruntime
import pytest
import torch

pytest.importorskip("onnx", reason="needs the package onnx to build graphs")

from onnx import TensorProto, helper

from cnca.detect.graph.network import OPERATIONS, OnnxNetwork
from cnca.detect.graph.node import UnsupportedError

IMAGE = np.random.default_rng(0).normal(size=(1, 4, 7, 9)).astype(np.float32)
SMALL = np.random.default_rng(1).normal(size=(6, 4, 3, 2)).astype(np.float32)
GROUPED = np.random.default_rng(2).normal(size=(6, 2, 3, 3)).astype(np.float32)
UP = {"coordinate_transformation_mode": "align_corners", "mode": "linear"}
SCALES = [IMAGE, np.array([], np.float32), np.array([1, 1, 2, 1.5], np.float32)]

CASES = {
    "uneven padding": ("Conv", [IMAGE, SMALL], {"pads": [0, 1, 2, 1], "strides": [2, 1]}),
    "groups": (
        "Conv",
        [IMAGE, GROUPED],
        {"group": 2, "strides": [2, 2], "auto_pad": "SAME_UPPER"},
    ),
    "ceil": ("MaxPool", [IMAGE], {"kernel_shape": [3, 3], "strides": [2, 2], "ceil_mode": 1}),
    "average": ("AveragePool", [IMAGE], {"kernel_shape": [3, 3], "pads": [1, 1, 1, 1]}),
    "counted": (
        "AveragePool",
        [IMAGE],
        {"kernel_shape": [2, 2], "pads": [1, 1, 1, 1], "count_include_pad": 1},
    ),
    "nearest": ("Resize", SCALES, {"mode": "nearest"}),
    "nearest, asymmetric": (
        "Resize",
        SCALES,
        {"coordinate_transformation_mode": "asymmetric", "nearest_mode": "floor"},
    ),
    "linear": ("Resize", SCALES, {"mode": "linear"}),
    "corners": ("Resize", SCALES, UP),
    "cubic": ("Resize", SCALES, {"mode": "cubic"}),
    "hard sigmoid": ("HardSigmoid", [IMAGE], {"alpha": 1 / 6}),
    "hard swish": ("HardSwish", [IMAGE], {}),
    "softmax": ("Softmax", [IMAGE], {"axis": 1}),
    "top": ("TopK", [IMAGE, np.array([3])], {"axis": 2}),
    "backwards": (
        "Slice",
        [IMAGE, np.array([-1, 1]), np.array([-100, 100]), np.array([3, 2]), np.array([-2, 3])],
        {},
    ),
    "focus": ("Slice", [IMAGE, np.array([1]), np.array([2**62]), np.array([2]), np.array([2])], {}),
    "kept and inferred": ("Reshape", [IMAGE, np.array([0, 2, -1])], {}),
    "negative numbers": ("Gather", [IMAGE, np.array([[0, -1], [2, 1]])], {"axis": 1}),
}


@pytest.mark.parametrize("case", CASES)
def test_against_onnx_runtime(case):
    operation, arrays, attributes = CASES[case]
    names = [f"input{i}" for i in range(len(arrays))]
    outputs = ["a", "b"] if operation == "TopK" else ["a"]
    node = helper.make_node(operation, names, outputs, **attributes)
    kinds = [helper.np_dtype_to_tensor_dtype(array.dtype) for array in arrays]
    inputs = [
        helper.make_tensor_value_info(name, kind, array.shape)
        for name, kind, array in zip(names, kinds, arrays, strict=True)
    ]
    described = [helper.make_tensor_value_info("a", TensorProto.FLOAT, None)]
    graph = helper.make_graph([node], "one", inputs, described)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    session = onnxruntime.InferenceSession(model.SerializeToString())
    (expected,) = session.run(None, dict(zip(names, arrays, strict=True)))
    found = OnnxNetwork(model)({n: torch.from_numpy(a) for n, a in zip(names, arrays, strict=True)})
    np.testing.assert_allclose(found["a"].numpy(), expected, rtol=1e-5, atol=1e-5)


UNLIKE = ("int16", "int32", "int64", "int8", "uint", "bfloat16", "FLOAT8", "string", "STRING")
"""Types in names of examples that no detector computes with."""
ELSEWHERE = (
    "training",
    "dropout",
    "empty_set",
    "downsample_scales_linear_align_corners",
    "downsample_scales_cubic_align_corners",
)
"""Examples of what happens in training alone, of reductions over nothing, and of lengths that
ONNX Runtime rounds."""


@pytest.mark.slow
def test_against_the_examples_of_the_specification():
    """Of the operations that we have, each example is computed rightly or refused."""
    from onnx.backend.test.case.node import collect_testcases

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # their division by zero is meant
        examples = collect_testcases("")
    right, wrong = 0, []
    for example in examples:
        known = {node.op_type for node in example.model.graph.node} <= {*OPERATIONS, "Constant"}
        if not known or any(word in example.name for word in UNLIKE + ELSEWHERE):
            continue
        try:
            right += all(_agrees(example.model, *data) for data in example.data_sets)
        except UnsupportedError:
            continue
        except Exception as error:
            wrong.append(f"{example.name}: {error}")
    assert wrong == []
    assert right > 600


def _agrees(model, inputs, expected):
    feed = {}
    for entry, array in zip(model.graph.input, inputs, strict=True):
        array = np.array(array)
        array = (
            array.astype(np.float32) if array.dtype.kind == "f" and array.itemsize < 4 else array
        )
        feed[entry.name] = torch.from_numpy(array)
    found = OnnxNetwork(model)(feed)
    for values, array in zip(found.values(), expected, strict=False):
        array = np.array(array).astype(np.float64)
        np.testing.assert_allclose(values.double().numpy(), array, rtol=2e-3, atol=1e-5)
    return True
