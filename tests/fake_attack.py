"""An attack whose parts are so simple that the outcome is known."""

from dataclasses import dataclass

import torch

from cnca.attack.parts import Attack
from cnca.attack.targets import Target
from cnca.core.types import Candidates
from cnca.scene.paint import Paint
from cnca.scene.schema import Scene


@dataclass
class GreyGenerator:
    """A texture whose grey level is a sigmoid of the sum of F_adv."""

    feature_shape: tuple[int, int] = (2, 3)

    def encode(self, prompt):
        return torch.zeros(2, 3)

    def generate(self, text_feature, adversarial_feature, generator, *, together=False):
        return adversarial_feature.sum().sigmoid().expand(3, 4, 4)


@dataclass
class NoisyGreyGenerator(GreyGenerator):
    """The same, of the sum of F_adv and of the differences of neighbouring noises."""

    noise_shape: tuple[int, int, int, int] = (2, 1, 8, 8)

    def generate(
        self, text_feature, adversarial_feature, generator, *, noises=None, together=False
    ):
        total = torch.zeros(()) if adversarial_feature is None else adversarial_feature.sum()
        if noises is not None:
            total = total + noises[..., 1:].sub(noises[..., :-1]).square().mean() - 2
        return total.sigmoid().expand(3, 4, 4)


class FlatRenderer:
    """Every pixel of every view is the mean albedo."""

    def render(self, albedo, views, weather, *, seed):
        return albedo.mean().expand(len(views), 3, 8, 8)

    def vehicle_boxes(self, views):
        return torch.tensor([[1.0, 1.0, 6.0, 6.0]]).expand(len(views), 4)


class SlantedRenderer(FlatRenderer):
    """Every view has a brightness of its own."""

    def render(self, albedo, views, weather, *, seed):
        light = torch.tensor([0.6 + 0.05 * view.origin[0] for view in views])
        return light[:, None, None, None] * super().render(albedo, views, weather, seed=seed)


@dataclass
class BrightnessDetector:
    """Finds the vehicle, exactly, with a confidence that is the picture's brightness."""

    name: str = "brightness"
    class_names: tuple[str, ...] = ("car",)
    differentiable: bool = True
    broken: bool = False

    def candidates(self, images):
        score = images.mean(dim=(1, 2, 3))[:, None]
        score = score * float("nan") if self.broken else score
        boxes = torch.tensor([[[1.0, 1.0, 6.0, 6.0]]]).expand(len(images), 1, 4)
        return Candidates(boxes, torch.ones_like(score), score[..., None])

    def detect(self, images, *, score_threshold=0.25, iou_threshold=0.45):
        raise NotImplementedError


def attack(**detector) -> Attack:
    paint = Paint(torch.full((3, 4, 4), 0.5), torch.ones(1, 4, 4))
    target = Target("brightness", BrightnessDetector(**detector), label=0)
    return Attack(Scene(), FlatRenderer(), paint, GreyGenerator(), [target])
