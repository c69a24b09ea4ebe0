"""Malformed files: whatever is read, it is used or complained about in one line."""

from __future__ import annotations

import hashlib
import io
import pickle
import subprocess
import zipfile
from pathlib import Path
from tempfile import gettempdir
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cnca.gen.feature import StoredFeature
from cnca.scene.carla import read_carla_frame
from tests.fuzz import mutations, samples
from tests.fuzz.kinds import KINDS, use_checkpoint, use_detector, use_mesh, use_picture, use_scene
from tests.fuzz.sandbox import survives

FEW, MANY = 5, 40
"""Cases of each kind."""

each_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)


@each_kind
def test_what_is_mutated_is_valid(kind):
    assert survives(kind.use, {kind.name: kind.content, **kind.beside}) is None


@each_kind
@pytest.mark.parametrize("cases", [FEW, pytest.param(MANY, marks=pytest.mark.slow)])
def test_malformed_files(kind, cases):
    mutated = [mutation(kind.content) for mutation in (mutations.damaged, *kind.mutations)]

    @settings(
        max_examples=cases,
        deadline=None,
        database=None,
        derandomize=cases == FEW,
        suppress_health_check=list(HealthCheck),
    )
    @given(content=st.one_of(mutated))
    def check(content: bytes) -> None:
        survives(kind.use, {kind.name: content, **kind.beside})

    check()


class Payload:
    """Makes a file when it is unpickled."""

    def __init__(self, target: Path):
        self.target = target

    def __reduce__(self) -> Any:
        return Path.touch, (self.target,)


def pickled_frame(payload: Payload) -> bytes:
    file = io.BytesIO()
    np.savez(file, **(samples.FRAME | {"img": np.array([payload], object)}))
    return file.getvalue()


def pickled_checkpoint(payload: Payload) -> bytes:
    file = io.BytesIO()
    torch.save({"step": 1, "feature": payload, "optimizer": {}}, file)
    return hashlib.sha256(file.getvalue()).digest() + file.getvalue()


@pytest.mark.parametrize(
    ("name", "make", "use"),
    [
        ("frame.npz", pickled_frame, read_carla_frame),
        ("frame.npz", pickle.dumps, read_carla_frame),
        ("checkpoint.pt", pickled_checkpoint, use_checkpoint),
        ("F_adv.safetensors", pickle.dumps, StoredFeature.load),
        ("a.weights", pickle.dumps, use_detector),
    ],
)
def test_nothing_is_unpickled(tmp_path, name, make, use):
    target = tmp_path / "owned"
    assert survives(use, {name: make(Payload(target))})
    assert not target.exists()


def test_yaml_tags_are_not_followed(tmp_path):
    target = tmp_path / "owned"
    text = f"sun: !!python/object/apply:pathlib.Path.touch [{target}]"
    assert survives(use_scene, {"scene.yaml": text.encode()})
    assert not target.exists()


def test_a_picture_that_would_fill_the_memory_is_refused():
    """100 000 × 100 000 pixels in 67 bytes: the size in the header alone."""
    header = bytes.fromhex("000186a0000186a00806000000")
    start = samples.PNG.index(b"IHDR")
    assert survives(
        use_picture, {"a.png": samples.PNG[: start + 4] + header + samples.PNG[start + 17 :]}
    )


def test_an_archive_that_would_fill_the_memory_is_refused():
    """Zeros of 4 GiB, packed into a few bytes that only the header speaks of."""
    file, head = io.BytesIO(), io.BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {"descr": "|u1", "fortran_order": False, "shape": (40_000, 40_000, 3)}
    )
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("img.npy", head.getvalue())
    assert survives(read_carla_frame, {"frame.npz": file.getvalue()})


def test_a_mesh_that_claims_more_than_it_holds_is_refused():
    """The binary chunk's length says 4 GiB."""
    glb = samples.GLB
    at = 20 + int.from_bytes(glb[12:16], "little")
    assert glb[at + 4 : at + 7] == b"BIN"
    survives(use_mesh, {"mesh.glb": glb[:at] + b"\xff\xff\xff\xff" + glb[at + 4 :]})


@pytest.mark.parametrize(
    ("fault", "raised"),
    [
        (lambda path: subprocess.run(["true"], check=False), AssertionError),
        (lambda path: np.ones(2**32, np.uint8), MemoryError),
        (lambda path: 1 / 0, ZeroDivisionError),
        (lambda path: (path.parent / "more").touch(), AssertionError),
        (lambda path: Path(gettempdir(), "cnca_elsewhere").open("ab").close(), AssertionError),
    ],
)
def test_the_check_can_fail(fault, raised):
    with pytest.raises(raised):
        survives(fault, {"file": b""})
