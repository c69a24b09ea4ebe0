"""Training of the autoencoder: crops of the corpus, absolute errors of colors and edges."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from diffusers import AutoencoderKL
from jaxtyping import Float, UInt8
from torch import Tensor

from cnca.gen import architecture
from cnca.train.generator.corpus import Corpus
from cnca.train.task import Recipe, Task

KL_WEIGHT = 1e-5


class AutoencoderTask(Task[Tensor]):
    """Learns random crops: absolute error of colors and of edges, and a light KL term."""

    name = "autoencoder"
    network: AutoencoderKL

    def __init__(self, data: Corpus, *, steps: int, crop: int = 64, batch: int = 4) -> None:
        self.network = architecture.autoencoder().to(memory_format=torch.channels_last)
        self.recipe = Recipe(steps, 1e-3)
        self.settings = {"batch": batch, "crop": crop}
        self._data, self._crop, self._batch = data, crop, batch

    def batch(self, step: int, rng: torch.Generator) -> Float[Tensor, "batch 3 crop crop"]:
        """Random cut-outs of the corpus."""
        return random_crops(self._data, self._batch, self._crop, rng)

    def losses(self, batch: Tensor, rng: torch.Generator) -> dict[str, Tensor]:
        """The errors of what a sample of the posterior decodes to, and the posterior's KL."""
        with torch.autocast("cpu", torch.bfloat16):
            posterior = self.network.encode(batch).latent_dist
            decoded = self.network.decode(posterior.sample(rng)).sample.float()
        edges = [F.l1_loss(decoded.diff(dim=d), batch.diff(dim=d)) for d in (-2, -1)]
        kl = posterior.kl().mean() / posterior.mean[0].numel()
        color = F.l1_loss(decoded, batch)
        return {"color": color, "edges": edges[0] + edges[1], "kl": KL_WEIGHT * kl}


def random_crops(
    data: Corpus, batch: int, crop: int, rng: torch.Generator
) -> Float[Tensor, "batch 3 crop crop"]:
    """Square cut-outs, mirrored at random, sRGB scaled to [−1, 1]."""
    cuts = []
    for _ in range(batch):
        i = int(torch.randint(len(data.pictures), (), generator=rng))
        side = data.pictures.shape[1]
        top, left = torch.randint(side - crop + 1, (2,), generator=rng).tolist()
        cut = torch.from_numpy(data.pictures[i, top : top + crop, left : left + crop].copy())
        cuts.append(cut.flip(1) if torch.rand((), generator=rng) < 0.5 else cut)
    return signed(torch.stack(cuts))


def signed(
    pictures: UInt8[Tensor, "batch height width 3"],
) -> Float[Tensor, "batch 3 height width"]:
    """uint8 channels-last → [−1, 1] channels-first, as the autoencoder takes them."""
    return pictures.permute(0, 3, 1, 2).float() / 127.5 - 1.0
