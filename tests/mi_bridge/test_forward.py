"""The share of scattered light that comes from the vehicle, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from cnca.mi_bridge.forward import (
    RAYS,
    ForwardShare,
    henyey_greenstein_directions,
    integrated,
    measure_share,
    table_distances,
)
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.variant import mi
from cnca.scene.cameras import orbit_view
from cnca.scene.weather import Fog, Weather
from cnca.vehicle.builtin.props import box
from cnca.vehicle.model import Vehicle

ERROR = 0.5 / np.sqrt(RAYS / 4)
"""Bound on one share's standard error: at least a quarter of the rays meet the vehicle."""


@pytest.mark.parametrize("g", [-0.9, 0.0, 0.85, 0.99])
def test_scattered_directions_have_the_phase_functions_mean_cosine(g):
    drawn = henyey_greenstein_directions(np.random.default_rng(0), g, 100_000)
    np.testing.assert_allclose(np.linalg.norm(drawn, axis=1), 1, atol=1e-6)
    assert drawn[:, 2].mean() == pytest.approx(g, abs=4 / np.sqrt(3 * 100_000))


def test_isotropic_droplets_at_a_convex_surface_see_the_vehicle_in_half_of_all_directions(renderer):
    assert measure_share(renderer.geometry, 0.0)[0] == pytest.approx(0.5, abs=4 * ERROR)


def test_far_away_the_share_falls_with_the_square_of_the_distance(renderer):
    """There the vehicle's solid angle is A/u²; isotropic droplets send 1/4π of it on."""
    u, share = (
        table_distances(),
        np.mean([measure_share(renderer.geometry, 0.0, seed=s) for s in range(8)], axis=0),
    )
    far = (u > 6) & (u < 20)
    area = 4 * np.pi * share[far] * u[far] ** 2
    # A box of 4 × 2 × 1.5 m shows at least its front and at most three faces at their best angle.
    assert (area > 2).all()
    assert (area < np.sqrt((4 * 2) ** 2 + (4 * 1.5) ** 2 + (2 * 1.5) ** 2)).all()


def test_forward_droplets_see_the_vehicle_from_farther(renderer):
    shares = [measure_share(renderer.geometry, g)[20] for g in (0.0, 0.5, 0.85, 0.95)]
    assert all(np.diff(shares) > 0)


def test_the_integral_of_the_share(renderer):
    u = table_distances()
    share = 1 / (1 + u) ** 2
    Φ = integrated(np.append(share[:-1], 0.0))
    np.testing.assert_allclose(Φ[:-1], (u / (1 + u))[:-1], rtol=0.02)
    assert Φ[-1] == pytest.approx(1, rel=0.03)  # the tail is taken for 1/u²


def test_kernels_read_the_table(renderer):
    forward = ForwardShare(renderer.geometry, 0.85)
    share = measure_share(renderer.geometry, 0.85)
    u = table_distances()[:-1]
    f, Φ = forward(mi.Float(np.float32(u)), mi.Bool(True))
    np.testing.assert_allclose(np.array(f), share[:-1], atol=1e-4)
    np.testing.assert_allclose(np.array(Φ), integrated(share)[:-1], rtol=1e-3, atol=1e-3)


def test_fog_without_a_vehicle():
    """The pictures of empty streets for detectors."""
    props = (box(np.ones(3)),)
    renderer = MitsubaRenderer(Vehicle("none", ()), texture_size=8, props=props)
    view = orbit_view(0, 20, 8, fov=45, width=8, height=8)
    image = renderer.render(torch.zeros(3, 8, 8), [view], Weather(fog=Fog(60)), seed=0)
    assert image.isfinite().all()
    assert image.min() > 0
