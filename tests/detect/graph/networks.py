"""A small network with a gradient as an ONNX file: YOLOv8's table by three convolutions."""

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

SIZE = (64, 96)
STRIDES = (8, 16, 32)
CLASSES = 80


def write_network(path, *, batch=1, suppression=False, weights_as_inputs=False, unknown=False):
    """Save the network; boxes are parts of the picture, scores of COCO's classes.

    ``suppression`` ends it in NonMaxSuppression, ``weights_as_inputs`` lists the weights among the
    inputs as Paddle's exports do, ``unknown`` puts an operation of a foreign domain inside.
    """
    random = np.random.default_rng(0)
    weights, nodes = {}, []
    for stride in STRIDES:
        shape = (4 + CLASSES, 3, stride, stride)
        weights[f"w{stride}"] = random.normal(0, 2 / stride, shape).astype(np.float32)
        strides = {"strides": [stride, stride]}
        nodes.append(helper.make_node("Conv", ["image", f"w{stride}"], [f"c{stride}"], **strides))
        flat = [f"c{stride}", "flat"], [f"f{stride}"]
        nodes.append(helper.make_node("Reshape", *flat))
    weights["flat"] = np.array([batch, 4 + CLASSES, -1])
    nodes.append(helper.make_node("Concat", [f"f{s}" for s in STRIDES], ["logits"], axis=2))
    nodes.append(helper.make_node("Sigmoid", ["logits"], ["output0"]))
    outputs = {"output0": (TensorProto.FLOAT, [batch, 84, 126])}
    if suppression:
        weights |= {"parts": np.array([4, CLASSES]), "most": np.array([100])}
        nodes += [
            helper.make_node("Split", ["output0", "parts"], ["columns", "scores"], axis=1),
            helper.make_node("Transpose", ["columns"], ["boxes"], perm=[0, 2, 1]),
            helper.make_node("NonMaxSuppression", ["boxes", "scores", "most"], ["selected"]),
        ]
        nodes[-1].attribute.append(helper.make_attribute("center_point_box", 1))
        outputs = {"selected": (TensorProto.INT64, ["n", 3])}
    if unknown:
        nodes[0].op_type = "SphericalConv"
    _save(path, nodes, weights, outputs, batch, weights_as_inputs)
    return path


def _save(path, nodes, weights, outputs, batch, weights_as_inputs):
    constants = [numpy_helper.from_array(array, name) for name, array in weights.items()]
    inputs = [helper.make_tensor_value_info("image", TensorProto.FLOAT, (batch, 3, *SIZE))]
    if weights_as_inputs:
        inputs = [
            helper.make_tensor_value_info(c.name, c.data_type, c.dims) for c in constants
        ] + inputs
    described = [helper.make_tensor_value_info(name, *kind) for name, kind in outputs.items()]
    graph = helper.make_graph(nodes, "network", inputs, described, constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    onnx.save(model, str(path))
