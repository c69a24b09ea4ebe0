"""The few dimensions from which a built-in vehicle is made."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SedanShape:
    """Outer dimensions in metres; the defaults are a mid-size saloon's."""

    length: float = 4.70
    width: float = 1.83
    """Without mirrors."""
    height: float = 1.47
    wheelbase: float = 2.80
    front_overhang: float = 0.87
    """From the front bumper back to the front axle."""
    wheel_radius: float = 0.335
    clearance: float = 0.17
    """Height of the floor above the ground."""
    bonnet_length: float = 1.25
    """From the front bumper back to the foot of the windscreen."""
    nose_height: float = 0.78
    """Top of the bonnet's front edge."""
    cowl_height: float = 0.99
    """Foot of the windscreen."""
    windscreen_run: float = 0.80
    """Horizontal distance from the windscreen's foot to the roof."""
    belt_height: float = 0.885
    """Lower edge of the side windows below the windscreen's foot."""
    belt_rise: float = 0.07
    """How much higher the belt line is at the tail."""
    boot_length: float = 0.50
    """From the rear bumper to the rear window; 0 where the roof reaches the tail."""
    boot_height: float = 1.07
    """Rear edge of the rear window; unused without a boot."""
    rear_window_run: float = 0.80
    """Horizontal distance over which the rear window, or the tail gate, slopes."""
    tumblehome: float = 22.0
    """How far the side windows lean inwards, degrees from the vertical."""
    windowless_behind: float | None = None
    """A panel van's sides are metal behind this x; None is glass up to the last pillar."""
    open_bed: bool = False
    """A pickup: the boot is a load bed under a dark cover."""


BUILTIN_VEHICLES: dict[str, SedanShape] = {
    "sedan": SedanShape(),
    "hatchback": SedanShape(
        length=4.10,
        width=1.78,
        height=1.48,
        wheelbase=2.58,
        front_overhang=0.82,
        bonnet_length=1.02,
        nose_height=0.76,
        cowl_height=0.99,
        windscreen_run=0.80,
        belt_height=0.93,
        belt_rise=0.08,
        boot_length=0.0,
        rear_window_run=0.42,
    ),
    "suv": SedanShape(
        length=4.65,
        width=1.90,
        height=1.70,
        wheelbase=2.70,
        front_overhang=0.90,
        wheel_radius=0.37,
        clearance=0.22,
        bonnet_length=1.20,
        nose_height=0.92,
        cowl_height=1.13,
        windscreen_run=0.72,
        belt_height=1.08,
        belt_rise=0.07,
        boot_length=0.0,
        rear_window_run=0.36,
        tumblehome=18.0,
    ),
    "van": SedanShape(
        length=4.95,
        width=1.92,
        height=1.95,
        wheelbase=3.05,
        front_overhang=0.92,
        bonnet_length=0.85,
        nose_height=0.92,
        cowl_height=1.18,
        windscreen_run=0.85,
        belt_height=1.08,
        belt_rise=0.02,
        boot_length=0.0,
        rear_window_run=0.14,
        tumblehome=9.0,
        windowless_behind=0.25,
    ),
    "pickup": SedanShape(
        length=5.30,
        width=1.90,
        height=1.80,
        wheelbase=3.20,
        front_overhang=0.93,
        wheel_radius=0.39,
        clearance=0.25,
        bonnet_length=1.35,
        nose_height=0.98,
        cowl_height=1.17,
        windscreen_run=0.72,
        belt_height=1.10,
        belt_rise=0.02,
        boot_length=1.60,
        boot_height=1.14,
        rear_window_run=0.14,
        tumblehome=17.0,
        open_bed=True,
    ),
}
"""Shapes by name; scenes call them ``builtin:sedan`` and so on."""
