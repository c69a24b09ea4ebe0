"""A small valid file of every kind that CNCA reads, as bytes."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import torch
import trimesh
from hypothesis import strategies as st
from onnx import load_from_string

from cnca.attack import checkpoint
from cnca.attack.loop import Progress
from cnca.attack.variables import Variable, Variables
from cnca.core.images import write_exr
from cnca.detect.cfg import parse_config
from cnca.detect.darknet import Darknet
from cnca.detect.weights import _in_file_order, save_weights
from cnca.efr.unet import EnvironmentFeatureRenderer
from cnca.gen.feature import StoredFeature
from cnca.gen.scorer import BagScorer
from tests.detect.graphs import write_echo

SCENE = b"""vehicle:
  mesh: builtin:sedan
  paint: [0.62, 0.09, 0.10]
  finish: {roughness: 0.3, clearcoat: 1.0}
  texture_size: 64
ground: {color: [0.4, 0.4, 0.4]}
sun: {altitude: 35, azimuth: 75, scale: 1}
sky: {turbidity: 3, scale: 1}
fog: {visibility: 60, height: 60, albedo: 0.99, asymmetry: 0.85}
cameras:
  - {name: front, azimuth: 35, elevation: 12, distance: 7.5, fov: 45}
  - {name: frame, carla: frame.npz, fov: 90, lift: 0.1}
variation:
  azimuth: [0, 360]
  elevation: [5, 30]
  distance: [8, 14]
  visibility: [40, 300]
image: {width: 16, height: 16, samples: 1, exposure: 1}
"""
CONFIG = b"""[net]
width=32
height=32
channels=3
[convolutional]
batch_normalize=1
filters=4
size=3
stride=2
pad=1
activation=leaky
[maxpool]
size=2
stride=2
[shortcut]
from=-1
activation=linear
[upsample]
stride=2
[route]
layers=-1,0
[convolutional]
filters=7
size=1
stride=1
pad=1
activation=linear
[yolo]
mask=0
anchors=10,14, 23,27
classes=2
num=2
"""
NAMES = b"car\ntruck\n"


def written(write: Callable[[Path], object], name: str = "file") -> bytes:
    """What ``write`` leaves in a file of that name."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


def mesh() -> trimesh.Trimesh:
    """A textured box."""
    box = trimesh.creation.box((4, 1.5, 2))
    uv = (box.vertices[:, :2] + [2, 0.75]) / [4, 1.5]
    box.visual = trimesh.visual.TextureVisuals(uv=uv)
    return box


OBJ = b"usemtl Paint_Red\n" + mesh().export(file_type="obj").encode()
PLY = mesh().export(file_type="ply")
PLY_TEXT = mesh().export(file_type="ply", encoding="ascii")
GLB = mesh().export(file_type="glb")
GLTF = trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh()), embed_buffers=True)["model.gltf"]

_rng = np.random.default_rng(0)
PICTURE = _rng.integers(0, 256, (12, 12, 4), np.uint8)
PNG = cv2.imencode(".png", PICTURE)[1].tobytes()
JPEG = cv2.imencode(".jpg", PICTURE[..., :3])[1].tobytes()
EXR = written(lambda path: write_exr(path, {"": np.float32(PICTURE[..., :3] / 255)}), "a.exr")
FRAME = {
    "img": PICTURE[..., :3],
    "veh_trans": np.zeros((2, 3)),
    "cam_trans": np.array([[-7.0, 0, 2], [-10, 0, 0]]),
}


def frame(**changed: np.ndarray) -> bytes:
    """A CARLA frame, some arrays replaced."""
    content = io.BytesIO()
    np.savez_compressed(content, **(FRAME | changed))
    return content.getvalue()


@st.composite
def odd_frames(draw: st.DrawFn, content: bytes) -> bytes:
    """Frames with an array of another shape or type; objects are pickled."""
    key = draw(st.sampled_from(sorted(FRAME)))
    kind = draw(st.sampled_from(("u1", "f8", "i4", "c16", "U3", "M8[s]", "O", "?")))
    shape = draw(st.sampled_from(((), (0,), (2, 3), (3, 2), (2, 3, 1), (0, 4, 3), (2, 2, 4))))
    return frame(**{key: np.zeros(shape, kind)})


_network = Darknet(parse_config(CONFIG.decode(), Path("sample.cfg"))).eval()
WEIGHTS = np.array([0, 2, 5, 0, 0], "<i4").tobytes() + b"".join(
    t.detach().numpy().tobytes() for t in _in_file_order(_network) if t is not None
)
DARKNET_SAFETENSORS = written(lambda path: save_weights(_network, path))
ONNX = written(write_echo)
FEATURE = written(StoredFeature(torch.zeros(4, 8), "zebra", 1.0).save)
EFR = written(EnvironmentFeatureRenderer().save)
SCORER = written(BagScorer(["red", "car"]).save)


def progress() -> Progress:
    """An attack of two steps on a tiny F_adv."""
    feature = torch.zeros(4, 8, requires_grad=True)
    moved = Variables({"feature": Variable(feature, torch.zeros(4, 8), 1.0)})
    optimizer = torch.optim.Adam(moved.tensors)
    for _ in range(2):
        feature.sum().backward()
        optimizer.step()
    return Progress(2, moved, optimizer)


CHECKPOINT = written(lambda path: checkpoint.save(progress(), path))


@st.composite
def odd_graphs(draw: st.DrawFn, content: bytes) -> bytes:
    """ONNX graphs with other operators, shapes, types or constants."""
    model = load_from_string(content)
    graph = model.graph
    for _ in range(draw(st.integers(1, 3))):
        number = draw(st.sampled_from((-1, 0, 1, 2, 7, 70000, 2**40)))
        match draw(st.sampled_from(("operator", "input", "wire", "constant", "type"))):
            case "operator":
                names = ("Identity", "Loop", "Expand", "NonZero", "Resize", "Gather", "Nothing")
                draw(st.sampled_from(graph.node)).op_type = draw(st.sampled_from(names))
            case "input":
                shape = graph.input[0].type.tensor_type.shape
                draw(st.sampled_from(shape.dim)).dim_value = number
            case "wire":
                node = draw(st.sampled_from(graph.node))
                node.input[0] = draw(st.sampled_from(("image", "dets", "means", "nowhere", "")))
            case "constant":
                constant = draw(st.sampled_from(graph.initializer))
                constant.raw_data = np.full(len(constant.raw_data) // 8, number).tobytes()
            case "type":
                graph.output[0].type.tensor_type.elem_type = abs(number) % 20
    return bytes(model.SerializeToString())
