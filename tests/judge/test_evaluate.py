"""The verdict of a run: what is around the vehicle neither helps nor harms it."""

import numpy as np
import pytest
import torch

from cnca.attack.targets import Target
from cnca.core.types import Detections
from cnca.judge.evaluate import Shots, evaluate
from cnca.scene.cameras import orbit_view
from cnca.scene.layers import Sighting
from cnca.scene.weather import Weather
from tests.fakes import BOX, FlatRenderer

VIEWS = [orbit_view(a, 10, 7, fov=45, width=32, height=12) for a in (0, 90)]
SHOTS = Shots([VIEWS], [Weather()], seed=0)
OTHER = (20, 2, 28, 10)


class StreetRenderer(FlatRenderer):
    """Another car stands in every view."""

    def sightings(self, views):
        mask = np.zeros((12, 32), bool)
        left, top, right, bottom = OTHER
        mask[top:bottom, left:right] = True
        return [[Sighting("car", mask, 0.0)] for _ in views]

    def visible_shares(self, views):
        return [1.0] * len(views)


class TwoCars:
    """Reports the vehicle, and with more confidence whatever is at the other's place."""

    name, class_names, differentiable = "two", ("car",), False

    def detect(self, images, *, score_threshold=0.25):
        boxes = torch.stack([torch.tensor(OTHER, dtype=torch.float), BOX])
        return [Detections(boxes, torch.tensor([0.9, 0.6]), torch.zeros(2, dtype=torch.long))]


def precision(renderer):
    target = Target("two", TwoCars(), 0, 1.0)
    results = evaluate(renderer, [target], {"plain": torch.full((3, 4, 4), 0.5)}, SHOTS)
    return results["two"]["plain"].average_precision


def test_other_vehicles_of_the_world_are_no_false_alarms():
    assert precision(StreetRenderer()) == pytest.approx(1.0)


def test_what_is_no_vehicle_is_one():
    assert precision(FlatRenderer()) == pytest.approx(0.5)
