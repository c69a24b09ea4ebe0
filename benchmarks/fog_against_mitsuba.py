"""The parts of ``fog.py`` that compare pictures and gradients in fog with Mitsuba's own."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np
import torch

from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.volpath import PrbVolpath, exposed_volpath
from cnca.scene.cameras import View, orbit_view
from cnca.scene.weather import Weather

SAMPLES = 16
STEP = 0.2
"""Change of the albedo for finite differences; the picture is nearly linear in it."""
OURS = 8
"""Renders of ours whose scatter is its noise."""
Found = TypeVar("Found")


def camera(options: argparse.Namespace, size: int) -> View:
    """A view from the front left, inside the fog."""
    return orbit_view(35, 12, options.distance, fov=45.0, width=size, height=size)


class Bench:
    """One foggy view of a grey vehicle, and the pixels and weights that a loss would take."""

    def __init__(
        self, renderer: MitsubaRenderer, weather: Weather, options: argparse.Namespace
    ) -> None:
        self.renderer, self.weather, self.spp = renderer, weather, options.spp
        self.view = camera(options, options.size)
        self.where = renderer.vehicle_mask([self.view])[0] == 1
        self.weights = np.random.default_rng(1).uniform(0.5, 1.5, (int(self.where.sum()), 3))
        size = renderer.geometry.texture_size
        self.grey = torch.full((3, size, size), 0.5)

    def pixels(self, images: torch.Tensor) -> torch.Tensor:
        """The vehicle's pixels of the mean picture."""
        return images.mean(dim=0).permute(1, 2, 0)[torch.from_numpy(self.where)]

    def volpath(self, texture: torch.Tensor, seed: int) -> np.ndarray:
        """The vehicle's pixels by Mitsuba's ``volpath``."""
        return self.pixels(
            exposed_volpath(
                self.renderer, texture, self.view, self.weather, samples=self.spp, seed=seed
            )
        ).numpy()

    def ours(self, seed: int, renders: int = 1) -> tuple[np.ndarray, torch.Tensor]:
        """The vehicle's pixels by ``renders`` of ours, and the gradient of their weighted mean."""
        texture = self.grey.clone().requires_grad_()
        images = [
            self.renderer.render(texture, [self.view], self.weather, seed=renders * seed + k)
            for k in range(renders)
        ]
        chosen = self.pixels(torch.cat(images))
        (chosen * torch.from_numpy(self.weights).float()).mean().backward()
        assert texture.grad is not None
        return chosen.detach().numpy(), texture.grad


def error(
    renderer: MitsubaRenderer, weather: Weather, options: argparse.Namespace, row: dict
) -> dict:
    """Bias, gradient and time to equal error against ``volpath``."""
    bench, runs = Bench(renderer, weather, options), range(options.runs)
    patterns = [block_pattern(renderer, 1 + k) - 0.5 for k in range(options.patterns)]
    started = time.perf_counter()
    expected = np.array([bench.volpath(bench.grey, seed) for seed in runs])
    reference_seconds = (time.perf_counter() - started) / options.runs
    slopes = []
    for pattern in patterns:  # the same seed on both sides: the noise cancels
        up, down = (bench.volpath(bench.grey + sign * STEP * pattern, 0) for sign in (1, -1))
        slopes.append(((up - down) * bench.weights).mean() / (2 * STEP))

    pictures, gradients = zip(*(bench.ours(seed, OURS) for seed in runs), strict=True)
    seconds = []
    for seed in runs:
        started = time.perf_counter()
        with torch.no_grad():
            renderer.render(bench.grey, [bench.view], weather, seed=seed)
        seconds.append(time.perf_counter() - started)
    found, slope = np.array(pictures), np.array(slopes)
    gradient = np.mean([[float((g * p).sum()) for p in patterns] for g in gradients], axis=0)
    bias = found.mean() / expected.mean() - 1
    error = np.hypot(*(x.mean(axis=(1, 2)).std(ddof=1) for x in (found, expected)))
    # Squared error of a pixel: ours at 16 rays with its bias, the reference's noise at its rays.
    ours = found.var(axis=0, ddof=1).mean() * OURS + (bias * expected.mean()) ** 2
    theirs = expected.var(axis=0, ddof=1).mean()
    return {
        "bias": round(float(bias), 4),
        "bias_error": round(float(error / expected.mean() / np.sqrt(options.runs)), 4),
        "gradient_cosine": round(float(cosine(gradient, slope)), 4),
        "gradient_length": round(float(np.linalg.norm(gradient) / np.linalg.norm(slope)), 4),
        "volpath_time": round(float(reference_seconds * theirs / ours / np.median(seconds)), 1),
    }


def prbvolpath(
    renderer: MitsubaRenderer, weather: Weather, options: argparse.Namespace, row: dict
) -> dict:
    """Squared error × time of Mitsuba's differentiable tracer over ours.

    Both trace equally many rays for their times, so that fixed costs weigh alike: ours as a larger
    picture of 16 rays per pixel.  Ours has its bias besides its noise: of the picture and of the
    gradient as the part ``error`` found them.
    """
    bench, runs = Bench(renderer, weather, options), range(1, 1 + options.runs)
    first = renderer.shots(
        renderer.plan(bench.grey, [bench.view], weather), [bench.view], None, seed=0
    )[0]
    exposure = float(np.array(first.exposure)[0])
    assert weather.fog is not None
    tracer = PrbVolpath(renderer.geometry, first.surroundings.sky.light, weather.fog, bench.view)
    adjoint = np.zeros((*bench.where.shape, 3))
    adjoint[bench.where] = exposure * bench.weights / bench.weights.size
    grey = bench.grey.permute(1, 2, 0).numpy()

    def theirs(seed: int) -> tuple[np.ndarray, np.ndarray]:
        picture = exposure * tracer.picture(options.spp, seed)[bench.where]
        return picture, tracer.gradient(grey, adjoint, options.spp, seed + 1000)

    large = camera(options, round(options.size * (options.spp / SAMPLES) ** 0.5))

    def timed(seed: int) -> None:
        texture = bench.grey.clone().requires_grad_()
        renderer.render(texture, [large], weather, seed=seed).square().mean().backward()

    theirs_found, theirs_seconds = stopwatch(theirs, runs)
    _, ours_seconds = stopwatch(timed, runs)
    ours_found = [bench.ours(seed) for seed in range(OURS)]
    pictures, gradients = (np.array([pair[k] for pair in theirs_found]) for k in (0, 1))
    our_pictures = np.array([picture for picture, _ in ours_found])
    our_gradients = np.array([gradient.numpy() for _, gradient in ours_found])
    length, cos = row["gradient_length"], row["gradient_cosine"]
    bias = {
        "picture": (row["bias"] * our_pictures.mean()) ** 2,
        # |g − g*|² of a gradient of relative length l at an angle, per texel.
        "gradient": (1 + length**2 - 2 * length * cos) * shared_square(our_gradients) / length**2,
    }
    noise = {"picture": (pictures, our_pictures), "gradient": (gradients, our_gradients)}
    rays = options.spp * theirs_seconds / (SAMPLES * ours_seconds)
    factors = {}
    for what, (a, b) in noise.items():
        squares = a.var(axis=0, ddof=1).mean() / (b.var(axis=0, ddof=1).mean() + bias[what])
        factors[f"prbvolpath_{what}"] = round(float(squares * rays), 1)
    return factors


def shared_square(gradients: np.ndarray) -> float:
    """Mean square of what independent gradients have in common."""
    mean = gradients.mean(axis=0)
    return float((mean**2).mean() - gradients.var(axis=0, ddof=1).mean() / len(gradients))


def stopwatch(call: Callable[[int], Found], seeds: range) -> tuple[list[Found], float]:
    """Results for the seeds and the median seconds of a call; the first one, untimed, compiles."""
    call(0)
    found, seconds = [], []
    for seed in seeds:
        started = time.perf_counter()
        found.append(call(seed))
        seconds.append(time.perf_counter() - started)
    return found, float(np.median(seconds))


def cosine(a: np.ndarray, b: np.ndarray) -> float:
    """Cosine of the angle between two vectors."""
    return float(a @ b / np.linalg.norm(a) / np.linalg.norm(b))


def block_pattern(renderer: MitsubaRenderer, seed: int, blocks: int = 4) -> torch.Tensor:
    """Albedo of 0 and 1 in random squares."""
    chance = torch.Generator().manual_seed(seed)
    squares = torch.randint(2, (1, 3, blocks, blocks), generator=chance).float()
    size = renderer.geometry.texture_size
    return torch.nn.functional.interpolate(squares, size=(size, size), mode="nearest")[0]
