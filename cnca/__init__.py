"""CNCA: customizable, natural adversarial camouflage on a differentiable path tracer.

A tool to measure and harden the robustness of vehicle detectors.  A text prompt goes into a
diffusion model, its image becomes the paint of a vehicle, Mitsuba 3 renders the vehicle in sun
and fog, a detector looks, and the loss flows back into the adversarial feature F_adv.

What :data:`PLACES` names is here as well, imported when it is first used (PEP 562); the modules
``cnca.optimize`` and ``cnca.evaluate``, which hold the loops, are too.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cnca import evaluate as evaluate
    from cnca import optimize as optimize
    from cnca.attack.parts import Attack as Attack
    from cnca.attack.parts import Settings as Settings
    from cnca.attack.run import held_out_shots as held_out_shots
    from cnca.build import build_generator as build_generator
    from cnca.build import build_loop_renderer as build_loop_renderer
    from cnca.build import build_paint as build_paint
    from cnca.build import build_renderer as build_renderer
    from cnca.build import build_targets as build_targets
    from cnca.build import build_vehicle as build_vehicle
    from cnca.optimize import start as start
    from cnca.scene.schema import load_scene as load_scene
    from cnca.targets import Target as Target
    from cnca.types import Candidates as Candidates

__version__ = "0.1.0"

PLACES = {
    "build": "build_generator build_loop_renderer build_paint build_renderer build_targets "
    "build_vehicle",
    "attack.parts": "Attack Settings",
    "attack.run": "held_out_shots",
    "optimize": "start",
    "scene.schema": "load_scene",
    "targets": "Target",
    "types": "Candidates",
}
"""Module of the package → what of it ``import cnca`` gives."""


def __getattr__(name: str) -> Any:
    if name in ("evaluate", "optimize"):
        return import_module(f"cnca.{name}")
    for module, names in PLACES.items():
        if name in names.split():
            return getattr(import_module(f"cnca.{module}"), name)
    raise AttributeError(f"module 'cnca' has no attribute '{name}'")
