"""CNCA: customizable, natural adversarial camouflage on a differentiable path tracer.

A tool to measure and harden the robustness of vehicle detectors.  A text prompt goes into a
diffusion model, its image becomes the paint of a vehicle, Mitsuba 3 renders the vehicle in sun
and fog, a detector looks, and the loss flows back into the adversarial feature F_adv.

What :data:`PLACES` names is here as well, imported when it is first used (PEP 562).
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from cnca.core.version import VERSION as __version__  # noqa: F401

if TYPE_CHECKING:
    from cnca.attack.loop import draw_pool as draw_pool
    from cnca.attack.loop import optimize as optimize
    from cnca.attack.loop import start as start
    from cnca.attack.parts import Attack as Attack
    from cnca.attack.settings import Settings as Settings
    from cnca.attack.targets import Target as Target
    from cnca.build import build_generator as build_generator
    from cnca.build import build_loop_renderer as build_loop_renderer
    from cnca.build import build_paint as build_paint
    from cnca.build import build_renderer as build_renderer
    from cnca.build import build_targets as build_targets
    from cnca.build import build_vehicle as build_vehicle
    from cnca.core.types import Candidates as Candidates
    from cnca.judge.evaluate import evaluate as evaluate
    from cnca.judge.held_out import held_out_shots as held_out_shots
    from cnca.scene.load_scene import load_scene as load_scene

PLACES = {
    "attack.loop": "draw_pool optimize start",
    "attack.parts": "Attack",
    "attack.settings": "Settings",
    "attack.targets": "Target",
    "build": "build_generator build_loop_renderer build_paint build_renderer build_targets "
    "build_vehicle",
    "core.types": "Candidates",
    "judge.evaluate": "evaluate",
    "judge.held_out": "held_out_shots",
    "scene.load_scene": "load_scene",
}
"""Module of the package → what of it ``import cnca`` gives."""


def __getattr__(name: str) -> Any:
    for module, names in PLACES.items():
        if name in names.split():
            return getattr(import_module(f"cnca.{module}"), name)
    raise AttributeError(f"module 'cnca' has no attribute '{name}'")
