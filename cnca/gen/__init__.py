"""The texture generator: a differentiable diffusion sampler, F_adv, and the shipped model's data."""
