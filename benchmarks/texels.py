"""How far could the loop come with a perfect grip?  The attack on texels, without a generator.

    python benchmarks/texels.py scenes/sedan_clear.yaml --steps 120 --picture out/texels.png

runs the same loop, renderer and loss as ``cnca optimize`` on a free picture of ``--side`` texels in
place of F_adv, and judges it on the same held-out views against the same controls.  The paint is
not natural: this bounds from below what any camouflage can reach in as many steps.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from cnca import build
from cnca.attack.loop import Attack, Progress, Settings, optimize, start
from cnca.attack.objectives import paper
from cnca.attack.records import StepRecord
from cnca.core.images import write_texture_srgb
from cnca.core.types import SrgbTexture
from cnca.judge.evaluate import evaluate
from cnca.judge.held_out import held_out_shots
from cnca.scene import controls
from cnca.scene.load_scene import load_scene

SIZE, BOUND = 256, 6.0
"""Pixels of the texture; bound on the logits, 0.0025 from black and white."""


class Texels:
    """A ``TextureGenerator`` whose feature is the picture itself, as logits."""

    def __init__(self, side: int) -> None:
        self.side = side
        self.feature_shape = (side * side, 3)

    def encode(self, prompt: str) -> Tensor:
        """No text is read."""
        return torch.zeros(0)

    def generate(
        self,
        text_feature: Tensor,
        adversarial_feature: Tensor | None,
        generator: torch.Generator,
        *,
        together: bool = False,
    ) -> SrgbTexture:
        """The picture of ``side`` texels, enlarged."""
        assert adversarial_feature is not None
        logits = adversarial_feature.T.reshape(1, 3, self.side, self.side)
        return torch.sigmoid(F.interpolate(logits, size=SIZE, mode="bicubic"))[0]


def main() -> None:
    """Attack, then print one line of JSON with the scores."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--detector", default="builtin")
    parser.add_argument("--steps", type=int, default=120)
    parser.add_argument("--side", type=int, default=64)
    parser.add_argument("--learning-rate", type=float, default=0.3)
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()

    scene = load_scene(options.scene)
    vehicle, targets = build.build_vehicle(scene), build.build_targets([options.detector])
    paint = build.build_paint(scene, vehicle)
    loop = build.build_loop_renderer(scene, vehicle, paint, backend="mitsuba", samples=16)
    attack = Attack(scene, loop, paint, Texels(options.side), targets, paper.Loss(full_overlap=0.5))
    settings = Settings(
        prompt="",
        tau=BOUND,
        steps=options.steps,
        learning_rate=options.learning_rate,
        start_spread=0.5,
    )

    def after_step(progress: Progress, record: StepRecord) -> None:
        print(f"step {progress.step}: D_s {record.D_s:.3f}", flush=True)

    feature = optimize(attack, settings, start(attack, settings), after_step)
    texture = attack.texture(torch.zeros(0), feature, 0)
    if options.picture:
        write_texture_srgb(options.picture, texture.permute(1, 2, 0).numpy())
    chance = torch.Generator().manual_seed(0)
    albedos = {
        "plain": paint.apply(),
        "random": paint.apply(controls.random_blocks(SIZE, chance)),
        "shuffled": paint.apply(controls.shuffled(texture, chance)),
        "texels": paint.apply(texture),
    }
    renderer = build.build_renderer(scene, vehicle)
    shots = held_out_shots(scene, 24, 0)
    results = evaluate(renderer, targets, albedos, shots)[targets[0].name]
    scores = {name: round(result.mean_score, 4) for name, result in results.items()}
    precision = {name: round(result.average_precision, 4) for name, result in results.items()}
    print(json.dumps({"score": scores, "AP@0.5": precision}))


if __name__ == "__main__":
    main()
