"""Whether CNCA works on this machine, and if not, why."""

from __future__ import annotations

import json
import platform
import signal
import subprocess
import sys
from dataclasses import asdict, dataclass
from importlib import metadata

from cnca.core.version import VERSION
from cnca.mi_bridge import llvm

PACKAGES = (
    "mitsuba",
    "drjit",
    "torch",
    "diffusers",
    "transformers",
    "onnxruntime",
    "opencv-contrib-python-headless",
    "OpenEXR",
    "trimesh",
    "numpy",
)


@dataclass(frozen=True)
class RenderTrial:
    """Outcome of a tiny render in a process of its own."""

    variant: str | None
    """The Mitsuba variant that rendered, or None if nothing was rendered."""
    mean: float | None
    """Mean linear radiance of the picture."""
    failure: str | None
    """Why the render is no good, in one line, or None if it is."""


@dataclass(frozen=True)
class Report:
    """What the doctor found."""

    version: str
    python: str
    platform: str
    packages: dict[str, str | None]
    """Distribution name → installed version, or None where it is missing."""
    gpu: str | None
    """The GPU that torch sees, or None."""
    llvms: tuple[llvm.Library, ...]
    """Every LLVM on this machine, best first, with the reason for refusing it."""
    render: RenderTrial

    @property
    def healthy(self) -> bool:
        """Whether the test render works."""
        return self.render.failure is None

    def as_json(self) -> str:
        """The report for programs, one JSON object."""
        return json.dumps({**asdict(self), "healthy": self.healthy}, default=str, indent=2)

    def lines(self) -> list[str]:
        """The report for people."""
        packages = [f"{name} {version or 'MISSING'}" for name, version in self.packages.items()]
        llvms = [f"{lib.path}: {lib.refusal or f'LLVM {lib.major}, usable'}" for lib in self.llvms]
        render = self.render
        verdict = f"FAILED: {render.failure}"
        if self.healthy:
            verdict = f"works ({render.variant}, mean radiance {render.mean:.3f})"
        return [
            f"cnca {self.version}, Python {self.python}, {self.platform}",
            "packages: " + ", ".join(packages),
            f"GPU: {self.gpu or 'none that torch can use'}",
            *(f"LLVM: {line}" for line in llvms or ["none found"]),
            f"test render: {verdict}",
        ]


def diagnose() -> Report:
    """Look at versions, LLVM, GPU and the outcome of a test render; never raises CncaError."""
    return Report(
        version=VERSION,
        python=platform.python_version(),
        platform=f"{platform.system()} {platform.machine()}",
        packages={name: _installed_version(name) for name in PACKAGES},
        gpu=_gpu_name(),
        llvms=tuple(llvm.survey()),
        render=try_render(),
    )


def try_render() -> RenderTrial:
    """Render a small ball in a process of its own, which an unusable LLVM may abort."""
    command = [sys.executable, "-m", "cnca.mi_bridge.selftest"]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    except subprocess.TimeoutExpired:
        return RenderTrial(None, None, "no picture after 300 s")
    if answer.returncode < 0:
        name = signal.Signals(-answer.returncode).name
        return RenderTrial(None, None, f"the renderer died of {name}: {_last_line(answer.stderr)}")
    if answer.returncode > 0:
        return RenderTrial(None, None, _last_line(answer.stderr))
    outcome = json.loads(answer.stdout.splitlines()[-1])
    failure = None
    if not outcome["finite"]:
        failure = "the picture holds NaN or infinity"
    elif outcome["mean"] <= 0:
        failure = "the picture is black"
    return RenderTrial(outcome["variant"], outcome["mean"], failure)


def _last_line(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[-1].removeprefix("cnca.core.errors.BackendError: ") if lines else "no message"


def _installed_version(distribution: str) -> str | None:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None


def _gpu_name() -> str | None:
    try:
        import torch
    except (ImportError, OSError):
        return None
    return torch.cuda.get_device_name() if torch.cuda.is_available() else None
