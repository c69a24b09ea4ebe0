"""What a user would write: a detector, a generator, a renderer and an objective of one's own."""

import torch
import torch.nn.functional as F

from cnca.core.types import Candidates
from cnca.detect.base import CandidateDetector

NUMBER = 3


class Redness(CandidateDetector):
    """Takes red for a car, in the middle of the picture."""

    name, class_names, differentiable = "redness", ("car",), True

    def candidates(self, images):
        count, _, height, width = images.shape
        box = images.new_tensor([0.2 * width, 0.2 * height, 0.8 * width, 0.8 * height])
        red = (images[:, 0] - images[:, 1] + 0.5).mean(dim=(1, 2)).clamp(0, 1)
        return Candidates(box.expand(count, 1, 4), red[:, None], torch.ones(count, 1, 1))


REDNESS = Redness()


class Half:
    """A detector that cannot detect."""

    name, class_names, differentiable = "half", ("car",), True

    def candidates(self, images):
        raise NotImplementedError


class Stripes:
    """Two colors, which F_adv shifts, in place of a diffusion model."""

    feature_shape = (1, 6)

    def encode(self, prompt):
        return torch.tensor([[2.0, -2, -2, 2, 2, 2]])

    def generate(self, text_feature, adversarial_feature, generator, *, together=False):
        colors = torch.sigmoid(text_feature + adversarial_feature).reshape(2, 3, 1, 1)
        return torch.where(torch.arange(64) // 8 % 2 == 0, *colors.expand(2, 3, 64, 64))


class Wall:
    """Hangs the texture on a grey wall."""

    def __init__(self, scene, vehicle, paint, *, samples):
        self.scene, self.samples = scene, samples

    def render(self, albedo, views, weather, *, seed):
        poster = F.interpolate(albedo[None], (32, 32), mode="area")
        return F.pad(poster, (16, 16, 16, 16), value=0.2).expand(len(views), -1, -1, -1)

    def vehicle_boxes(self, views):
        return torch.tensor([16.0, 16.0, 48.0, 48.0]).expand(len(views), 4)


class Poster(Wall):
    """The same, for a loop that asks what a residual needs."""

    def reference(self, views, weather, *, seed):
        raise NotImplementedError


def mean_confidence(candidates, vehicle_boxes, label):
    """An objective in one line."""
    return (candidates.objectness * candidates.class_scores[..., label]).mean(dim=1)
