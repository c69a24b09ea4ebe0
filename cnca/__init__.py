"""CNCA: customizable, natural adversarial camouflage on a differentiable path tracer.

A tool to measure and harden the robustness of vehicle detectors.  A text prompt goes into a
diffusion model, its image becomes the paint of a vehicle, Mitsuba 3 renders the vehicle in sun
and fog, a detector looks, and the loss flows back into the adversarial feature F_adv.
"""

__version__ = "0.1.0"
