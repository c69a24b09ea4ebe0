"""The texture generator: differentiable diffusion sampling, F_adv and the shipped model."""

GUIDANCE = 2.5
"""Scale of classifier-free guidance, where none is asked for."""
