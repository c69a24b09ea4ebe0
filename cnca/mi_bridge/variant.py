"""Mitsuba and Dr.Jit with their variant already set.

Every module of ``cnca.mi_bridge`` imports them from here and from nowhere else::

    from cnca.mi_bridge.variant import dr, mi

The variant is ``cuda_ad_rgb`` where an NVIDIA GPU really traces rays, else ``llvm_ad_rgb``; the
environment variable ``CNCA_VARIANT`` overrides this.  ``OMP_NUM_THREADS`` bounds the renderer's
threads on the CPU as it bounds torch's.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys

from cnca.core.errors import BackendError, did_you_mean
from cnca.mi_bridge import llvm

VARIANTS = ("llvm_ad_rgb", "cuda_ad_rgb")


def cuda_traces_rays() -> bool:
    """Whether Mitsuba can trace a ray on a GPU here (driver, device and OptiX all present).

    Tried in a process of its own, since a broken driver may abort; without a driver nothing starts.
    """
    try:
        ctypes.CDLL("libcuda.so.1")
    except OSError:
        return False
    trial = subprocess.run(
        [sys.executable, "-I", "-c", _TRACE_ONE_RAY], capture_output=True, check=False, timeout=300
    )
    return trial.returncode == 0


_TRACE_ONE_RAY = """
import mitsuba as mi  # noqa: E402
mi.set_variant("cuda_ad_rgb")
scene = mi.load_dict({"type": "scene", "ball": {"type": "sphere"}})
ray = mi.Ray3f(mi.Point3f(0, 0, -3), mi.Vector3f(0, 0, 1))
assert abs(scene.ray_intersect(ray).t[0] - 2) < 1e-3
"""


def wanted_variant() -> str:
    """Return the variant to use: ``CNCA_VARIANT`` if set, else the fastest that works.

    Raises BackendError if ``CNCA_VARIANT`` names no supported variant.
    """
    wanted = os.environ.get("CNCA_VARIANT")
    if not wanted:
        return "cuda_ad_rgb" if cuda_traces_rays() else "llvm_ad_rgb"
    if wanted not in VARIANTS:
        hint = did_you_mean(wanted, VARIANTS)
        raise BackendError(f"CNCA_VARIANT={wanted}: not one of {', '.join(VARIANTS)}{hint}")
    return wanted


def activate() -> str:
    """Choose LLVM, import Mitsuba, set the variant and return its name; later calls change nothing.

    Raises BackendError if this machine has no usable LLVM or if ``CNCA_VARIANT`` cannot be used.
    """
    loaded = sys.modules.get("mitsuba")
    if loaded is not None and loaded.variant() in VARIANTS:
        return loaded.variant()
    variant = wanted_variant()
    if variant == "llvm_ad_rgb":
        os.environ[llvm.VARIABLE] = str(llvm.choose().path)
    import mitsuba  # only now: Dr.Jit reads the environment when the variant loads

    try:
        mitsuba.set_variant(variant)
    except (ImportError, RuntimeError) as error:
        reason = str(error).strip().splitlines()[0]
        remedy = "no working GPU? CNCA_VARIANT=llvm_ad_rgb renders on the CPU"
        raise BackendError(f"variant {variant} does not start: {reason}; {remedy}") from error
    bound_threads()
    return variant


def bound_threads() -> None:
    """Let Dr.Jit work in as many threads as ``OMP_NUM_THREADS`` says, the caller's among them."""
    import drjit

    threads = os.environ.get("OMP_NUM_THREADS", "")
    if threads.isdecimal() and int(threads) > 0:
        drjit.set_thread_count(int(threads))


activate()

import drjit as dr  # noqa: E402  (after the variant)
import mitsuba as mi  # noqa: E402

__all__ = [
    "VARIANTS",
    "activate",
    "bound_threads",
    "cuda_traces_rays",
    "dr",
    "mi",
    "wanted_variant",
]
