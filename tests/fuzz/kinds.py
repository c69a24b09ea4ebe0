"""Every kind of file that CNCA reads, how it is used, and what is done to it."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import torch
from hypothesis import strategies as st

from cnca import build
from cnca.attack import checkpoint
from cnca.core.images import read_mask, read_texture_srgb
from cnca.detect import load_detector
from cnca.efr.unet import EnvironmentFeatureRenderer
from cnca.gen.feature import StoredFeature
from cnca.gen.scorer import BagScorer
from cnca.scene.carla import read_carla_frame
from cnca.scene.load_scene import load_scene
from cnca.scene.variation import draw_views, draw_weathers
from cnca.scene.views import build_views
from cnca.vehicle.mesh.load_mesh import load_vehicle
from cnca.vehicle.uv.masks import paint_mask
from tests.fuzz import mutations, samples

Mutation = Callable[[bytes], st.SearchStrategy[bytes]]


def use_scene(path: Path) -> None:
    scene = load_scene(path)
    build.build_vehicle(scene)
    build_views(scene)
    draw_views(scene, 2, seed=0)
    draw_weathers(scene, 2, seed=0)


def use_mesh(path: Path) -> None:
    paint_mask(load_vehicle(path), 32)


def use_picture(path: Path) -> None:
    for read in (read_texture_srgb, read_mask):
        read(path)


def use_detector(path: Path) -> None:
    load_detector(str(path)).detect(torch.zeros(1, 3, 32, 48))


def use_weights(path: Path) -> None:
    use_detector(path.with_suffix(".cfg"))


def use_checkpoint(path: Path) -> None:
    checkpoint.restore(samples.progress(), path)


@dataclass(frozen=True)
class Kind:
    """A kind of file, how it is used and what is done to it; others may lie beside it."""

    name: str
    content: bytes
    use: Callable[[Path], object]
    mutations: tuple[Mutation, ...] = ()
    beside: Mapping[str, bytes] = field(default_factory=dict)


NASTY_YAML = (
    "a: !!python/object/apply:os.system ['touch owned']",
    "b: &b [*b, *b]",
    "<<: {mesh: 1}",
    "? [x]: y",
    "2: 3",
    "[" * 3000,
    "image: 2001-01-01",
)
NASTY_OBJ = ("f 1/1/1 2//2 3", "f -1 -2 -3", "f 99 1 2", "v 1 2", "vt nan nan", "l 1 2", "g a b")
NASTY_CFG = ("[yolo]", "[lstm]", "groups=3", "from=-99", "filters=", "[", "=", "mask=0,0,0,0")
_darknet = {"a.names": samples.NAMES}
_network = {**_darknet, "a.cfg": samples.CONFIG}
_text = mutations.rewritten


def checksummed(content: bytes) -> st.SearchStrategy[bytes]:
    """A checkpoint that was damaged before its checksum was taken."""
    body = content[checkpoint.DIGEST :]
    return mutations.damaged(body).map(lambda b: hashlib.sha256(b).digest() + b)


def odd_checkpoints(content: bytes) -> st.SearchStrategy[bytes]:
    """A checkpoint whose checksum is right and whose content is not an attack's."""
    state = torch.load(io.BytesIO(content[checkpoint.DIGEST :]), weights_only=True)

    def packed(tree: Any) -> bytes:
        file = io.BytesIO()
        torch.save(_with_tensors(tree), file)
        return hashlib.sha256(file.getvalue()).digest() + file.getvalue()

    return mutations.restructured(_plain(state)).map(packed)


def _plain(tree: Any) -> Any:
    """The tree for JSON."""
    if isinstance(tree, torch.Tensor):
        return {"tensor": tree.tolist()}
    if isinstance(tree, dict):
        return {str(key): _plain(value) for key, value in tree.items()}
    return [_plain(value) for value in tree] if isinstance(tree, list | tuple) else tree


def _with_tensors(tree: Any) -> Any:
    """The tree for torch, as far as it is still one."""
    if isinstance(tree, list):
        return [_with_tensors(value) for value in tree]
    if not isinstance(tree, dict):
        return tree
    if set(tree) == {"tensor"}:
        try:
            return torch.tensor(tree["tensor"])
        except (TypeError, ValueError, RuntimeError, OverflowError):
            return tree
    return {int(k) if k.isdecimal() else k: _with_tensors(value) for k, value in tree.items()}


KINDS = (
    Kind(
        "scene.yaml",
        samples.SCENE,
        use_scene,
        (partial(_text, extra=NASTY_YAML),),
        {"frame.npz": samples.frame()},
    ),
    Kind("mesh.obj", samples.OBJ, use_mesh, (partial(_text, extra=NASTY_OBJ),)),
    Kind("mesh.ply", samples.PLY, use_mesh),
    Kind("text.ply", samples.PLY_TEXT, use_mesh, (_text,)),
    Kind("mesh.gltf", samples.GLTF, use_mesh, (mutations.json_text,)),
    Kind("mesh.glb", samples.GLB, use_mesh, (mutations.glb,)),
    Kind("picture.png", samples.PNG, use_picture),
    Kind("picture.jpg", samples.JPEG, use_picture),
    Kind("picture.exr", samples.EXR, use_picture),
    Kind("frame.npz", samples.frame(), read_carla_frame, (samples.odd_frames,)),
    Kind(
        "a.cfg",
        samples.CONFIG,
        use_detector,
        (partial(_text, extra=NASTY_CFG),),
        {**_darknet, "a.weights": samples.WEIGHTS},
    ),
    Kind("a.weights", samples.WEIGHTS, use_weights, (), _network),
    Kind(
        "a.safetensors",
        samples.DARKNET_SAFETENSORS,
        use_weights,
        (mutations.safetensors,),
        _network,
    ),
    Kind("a.onnx", samples.ONNX, use_detector, (samples.odd_graphs,)),
    Kind("F_adv.safetensors", samples.FEATURE, StoredFeature.load, (mutations.safetensors,)),
    Kind(
        "efr.safetensors",
        samples.EFR,
        EnvironmentFeatureRenderer.load,
        (mutations.safetensors,),
    ),
    Kind("scorer.safetensors", samples.SCORER, BagScorer.load, (mutations.safetensors,)),
    Kind("checkpoint.pt", samples.CHECKPOINT, use_checkpoint, (checksummed, odd_checkpoints)),
)
