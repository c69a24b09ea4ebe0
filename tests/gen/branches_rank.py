"""One of the processes that divide a denoiser's branches: texture and gradient, as a file.

    python -m torch.distributed.run --nproc-per-node 2 -m tests.gen.branches_rank FOLDER

The loss is a weighted sum of texels, of which each process has its share, as of an attack's views.
"""

import sys
from pathlib import Path

import torch

from cnca.core import parallel
from cnca.gen.choices import KINDS
from cnca.gen.sampling import DiffusionTextureGenerator
from tests.gen.tiny import tiny_pipeline


def run_rank(folder: Path) -> None:
    content: dict[str, torch.Tensor] = {}
    branches: list[int] = []
    for kind in KINDS:
        for options in ({}, {"gradient_steps": 2}, {"gradient_checkpointing": False}):
            pipeline, name = tiny_pipeline(), " ".join([kind, *options])
            pipeline.unet.register_forward_pre_hook(lambda _, given: branches.append(len(given[0])))
            generator = DiffusionTextureGenerator(
                pipeline, feature=kind, tokens=2, steps=4, guidance=3.0, **options
            )
            seeded = torch.Generator().manual_seed(3)
            extra = torch.randn(generator.feature_shape, generator=seeded).requires_grad_()
            noises = torch.randn(generator.noise_shape, generator=seeded).requires_grad_()
            texture = generator.generate(
                generator.encode("zebra"), extra, seeded, noises=noises, together=True
            )
            weights = torch.randn(texture.shape, generator=seeded)
            parallel.share(weights * texture).sum().backward()
            parallel.add_up(extra.grad, noises.grad)
            content |= {name: texture.detach(), f"{name} gradient": extra.grad}
            content[f"{name} noises"] = noises.grad
    content["branches"] = torch.tensor([min(branches), max(branches)])
    torch.save(content, folder / f"rank{parallel.rank()}.pt")


if __name__ == "__main__":
    torch.set_num_threads(1)
    with parallel.joined():
        run_rank(Path(sys.argv[1]))
