"""The texture generator: differentiable diffusion sampling, F_adv and the shipped model."""
