"""Malformed files given to the whole program, in a process of its own."""

from __future__ import annotations

import resource
import subprocess
import sys

import numpy as np
import pytest

from tests.fuzz import samples
from tests.fuzz.kinds import KINDS
from tests.fuzz.sandbox import BYTES

OPTIMIZE = "optimize --scene scene.yaml --detector a.cfg --prompt zebra --out out --steps 1"
COMMANDS = (
    ("scene.yaml", "render-scene scene.yaml -o out/a.png"),
    ("frame.npz", "render-scene scene.yaml --view frame -o out/a.png"),
    ("a.onnx", "evaluate --scene scene.yaml --detector a.onnx --views 2 --out out"),
    ("mesh.obj", "reorder-uv mesh.obj -o out/b.obj"),
    ("mesh.glb", "reorder-uv mesh.glb -o out/b.obj"),
    ("a.cfg", f"{OPTIMIZE} --views-per-step 1 --spp 1 --held-out-views 4"),
)
CPU_SECONDS = 100
"""Of a whole command that works."""


@pytest.mark.slow
@pytest.mark.parametrize(("damaged", "arguments"), COMMANDS, ids=lambda text: text.split()[0])
@pytest.mark.parametrize("seed", range(2))
def test_the_whole_program(tmp_path, damaged, arguments, seed):
    """One file damaged: exit code 2 and one line, or 0; nothing outside of ``out``."""
    rng = np.random.default_rng(seed)
    for kind in KINDS:
        content = bytearray(kind.content)
        if kind.name == damaged:
            for at in rng.integers(0, len(content), 1 + len(content) // 100):
                content[at] = rng.integers(0, 256)
        (tmp_path / kind.name).write_bytes(bytes(content))
    (tmp_path / "a.names").write_bytes(samples.NAMES)
    before = sorted(tmp_path.iterdir())
    done = subprocess.run(
        [sys.executable, "-m", "cnca", *arguments.split()],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS, CPU_SECONDS)),
    )
    assert done.returncode in (0, 2), done.stderr
    if done.returncode == 2:
        assert done.stderr.startswith("error: ")
        assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert sorted(path for path in tmp_path.iterdir() if path.name != "out") == before
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024 < BYTES
