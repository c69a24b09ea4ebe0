"""What each model costs: its error and its time, predicted from measurements.

``cnca accuracy --calibrate`` renders random scenes with and without each model and fits

    error(model) = known(model, subject) · exp(w · x(subject) + spread).

``known`` is a closed form where there is one (the share of light that fog takes), x the subject's
features, and ``spread`` the residual that nine of ten scenes stay under: predictions err upwards.
The fit ships as ``assets/prices.json``.

An error is √mean((L − L_ref)² / (L_ref² + 0.01)) over the vehicle's pixels, L exposed linear RGB:
relative to bright pixels, absolute in dark ones (relMSE of Rousselle, Knaus & Zwicker 2011).
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

import numpy as np

from cnca.scene.materials import Material
from cnca.scene.weather import Weather
from cnca.vehicle.model import Vehicle

SHIPPED = Path(__file__).parents[1] / "assets" / "prices.json"
TYPICAL = 16
"""Rays per pixel to which the noise's constant belongs."""
QUANTILE = 0.9


@dataclass(frozen=True)
class Subject:
    """What a picture's errors depend on."""

    weather: Weather
    ground: float
    """Mean linear albedo of the ground in [0, 1]."""
    paint: float
    """Mean linear albedo of the texture in [0, 1]."""
    fog_path: float
    """Metres inside the fog layer between the camera and the vehicle."""
    coat: float
    """Clear coat of the vehicle's materials in [0, 1], weighted by area: :func:`mean_over_area`."""
    glass: float
    """Transmission of the vehicle's materials in [0, 1], weighted likewise."""
    pixels_per_metre: float
    """At the vehicle: the share of pixels that edges cross, and so are noisy, falls with it."""

    @property
    def has_fog(self) -> bool:
        """Whether the scene names a layer that has a height."""
        return self.weather.fog is not None and self.weather.fog.height > 0

    @property
    def has_sun(self) -> bool:
        """Whether the sun shines."""
        return self.weather.sun_scale > 0 and self.weather.sun_altitude > 0

    @property
    def opacity(self) -> float:
        """1 − T of the fog between camera and vehicle."""
        fog = self.weather.fog
        return -math.expm1(-fog.extinction * self.fog_path) if fog is not None else 0.0

    @property
    def fog_share(self) -> float:
        """Most that fog can change: the share it takes of the view and of the sun's slant path."""
        fog = self.weather.fog
        if fog is None:
            return 0.0
        slant = fog.height / max(math.sin(math.radians(self.weather.sun_altitude)), 1e-4)
        length = self.fog_path + (slant if self.has_sun else fog.height)
        return -math.expm1(-fog.extinction * length) if fog.height > 0 else 0.0

    @property
    def sun_share(self) -> float:
        """Share of the direct sun in the light at the vehicle.

        Above the fog 0.7^(m^0.678) of the sun's light arrives through the air mass m, and a tenth
        of what arrives comes from the sky besides (Meinel & Meinel 1976).
        """
        if not self.has_sun:
            return 0.0
        sine = max(math.sin(math.radians(self.weather.sun_altitude)), 0.01)
        arriving = 0.7 ** (sine**-0.678)
        fog = self.weather.fog
        direct = math.exp(-fog.extinction * fog.height / sine) if fog is not None else 1.0
        sun = self.weather.sun_scale * arriving
        sky = 0.1 * self.weather.sky_scale * max(arriving, 0.05)
        return sun * direct / (sun + sky)

    def known(self, key: str) -> float:
        """Closed form of how much ``"effect=model"`` can change; 1 where there is none."""
        forms = {
            "fog=none": self.fog_share,
            "fog=airlight": self.fog_share,
            "fog=single": self.fog_share,
            "sun=direction": float(self.has_sun),
            "materials=principled": self.coat,
            "glass=dark": self.glass,
        }
        return forms.get(key, 1.0)

    def features(self) -> list[float]:
        """x: constant, log albedos, opacity of the view, share of the sun."""
        albedos = [math.log(self.ground + 0.02), math.log(self.paint + 0.02)]
        return [1.0, *albedos, self.opacity, self.sun_share]

    def noise_features(self, samples: int) -> list[float]:
        """x of the noise, whose last weight is minus the rate at which it falls with samples."""
        return [*self.features(), math.log(self.pixels_per_metre), math.log(samples / TYPICAL)]


def mean_over_area(vehicle: Vehicle, value: Callable[[Material], float]) -> float:
    """A property of the materials, such as their clear coat, averaged over all parts' area."""
    areas, values = [], []
    for part in vehicle.parts:
        a, b, c = np.moveaxis(part.vertices[part.faces], 1, 0)
        areas.append(np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum() / 2)
        values.append(value(vehicle.material(part.material)))
    return float(np.dot(areas, values) / max(sum(areas), 1e-12))


@dataclass(frozen=True)
class Fit:
    """One model's error as a function of the features."""

    weights: tuple[float, ...]
    spread: float

    def error(self, features: Sequence[float]) -> float:
        """exp(w · x + spread)."""
        return math.exp(
            sum(w * x for w, x in zip(self.weights, features, strict=True)) + self.spread
        )


def fit(features: Sequence[Sequence[float]], errors: Sequence[float]) -> Fit:
    """Least squares in the logarithm with a slight pull to a constant; all errors > 0."""
    x, y = np.asarray(features, dtype=np.float64), np.log(errors)
    pull = np.sqrt(0.3) * np.eye(x.shape[1])[1:]
    rows, values = np.vstack([x, pull]), np.concatenate([y, np.zeros(len(pull))])
    weights = np.linalg.lstsq(rows, values, rcond=None)[0]
    spread = max(float(np.quantile(y - x @ weights, QUANTILE)), 0.0)
    return Fit(tuple(round(float(w), 4) for w in weights), round(spread, 4))


@dataclass(frozen=True)
class Prices:
    """Fits of all models that have an error, of the noise, and the time of each model."""

    errors: Mapping[str, Fit]
    """``"effect=model"`` → error beside the reference's model; others have none."""
    noise: Fit
    """Of :meth:`Subject.noise_features`."""
    seconds: Mapping[str, float]
    """``"effect=model"`` → seconds per million rays; ``"rays"`` is what every ray costs."""

    def error(self, effect: str, model: str, subject: Subject) -> float:
        """Predicted error of the model beside that of the reference, without noise."""
        key = f"{effect}={model}"
        share = subject.known(key)
        if key not in self.errors or share == 0:
            return 0.0
        return share * self.errors[key].error(subject.features())

    def noise_of(self, samples: int, subject: Subject) -> float:
        """Predicted noise of so many rays per pixel."""
        return self.noise.error(subject.noise_features(samples))

    def samples_for(self, noise: float, subject: Subject, most: int) -> int:
        """Rays per pixel for that noise: a power of two, whose kernels are used again."""
        ratio = self.noise_of(TYPICAL, subject) / max(noise, 1e-9)
        wanted = TYPICAL * ratio ** (-1 / self.noise.weights[-1])
        return int(min(2 ** max(math.ceil(math.log2(wanted)), 0), most))

    def as_json(self) -> dict[str, object]:
        """What :func:`read_prices` reads."""
        return asdict(self)


def read_prices(path: Path) -> Prices:
    """Prices from a file that ``cnca accuracy --calibrate`` wrote."""
    content = json.loads(path.read_text(encoding="utf-8"))["prices"]
    fits = {name: Fit(tuple(f["weights"]), f["spread"]) for name, f in content["errors"].items()}
    noise = Fit(tuple(content["noise"]["weights"]), content["noise"]["spread"])
    return Prices(fits, noise, content["seconds"])


@cache
def shipped_prices() -> Prices:
    """The prices that come with the package."""
    return read_prices(SHIPPED)
