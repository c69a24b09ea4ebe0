"""The loop, with parts so simple that the outcome is known."""

import math
from dataclasses import replace

import pytest
import torch

from cnca.attack.loop import draw_pool, optimize, start
from cnca.attack.settings import WEATHERS, Settings
from cnca.core.errors import CncaError, DetectorError, GeneratorError, NonFiniteError, RunError
from cnca.scene.protocols import Detector, Renderer, TextureGenerator
from cnca.scene.schema import Scene
from tests.fake_attack import FlatRenderer, attack


def feature_of(progress):
    return progress.variables.latents.feature


def run(settings: Settings, progress=None, stop_after: int | None = None):
    records = []

    def after_step(progress, record):
        records.append(record)
        if record.step == stop_after:
            raise KeyboardInterrupt

    attacked = attack()
    progress = progress or start(attacked, settings)
    try:
        optimize(attacked, settings, progress, after_step)
    except KeyboardInterrupt:
        assert stop_after is not None
    return progress, records


def test_fakes_keep_the_contracts():
    attacked = attack()
    assert isinstance(attacked.renderer, Renderer)
    assert isinstance(attacked.generator, TextureGenerator)
    assert isinstance(attacked.targets[0].detector, Detector)


def test_lowers_the_score_and_says_so():
    _, records = run(Settings("grey", tau=1.0, steps=12, learning_rate=0.1))
    assert records[-1].D_s < 0.6 * records[0].D_s
    assert [record.step for record in records] == list(range(1, 13))
    assert records[0].seconds_total >= records[0].seconds_render > 0


def test_first_adam_step_is_the_learning_rate():
    settings = Settings("grey", tau=1.0, steps=1, learning_rate=0.02, start_spread=0.0)
    progress, _ = run(settings)
    assert torch.allclose(feature_of(progress), torch.full((2, 3), -0.02), atol=1e-6)


def test_signed_steps_move_every_element_by_the_learning_rate():
    settings = Settings(
        "grey", tau=1.0, steps=3, learning_rate=0.02, start_spread=0.0, update="sign"
    )
    progress, _ = run(settings)
    assert torch.allclose(feature_of(progress), torch.full((2, 3), -0.06), atol=1e-6)


def test_with_decay_the_steps_shrink_along_half_a_cosine():
    constant = Settings(
        "grey", tau=1.0, steps=4, learning_rate=0.1, start_spread=0.0, update="sign"
    )
    progress, _ = run(replace(constant, decay=True))
    way = 0.1 * sum(0.5 + 0.5 * math.cos(math.pi * k / 4) for k in range(4))
    assert way < 0.4  # that of constant steps
    assert torch.allclose(feature_of(progress), torch.full((2, 3), -way), atol=1e-6)


def test_an_interrupted_run_with_decay_ends_the_same():
    settings = Settings("grey", tau=1.0, steps=8, learning_rate=0.1, decay=True)
    whole, _ = run(settings)
    part, _ = run(settings, stop_after=3)
    again, _ = run(settings, part)
    assert torch.equal(feature_of(again), feature_of(whole))


def test_the_released_code_starts_at_the_prompt():
    for feature, spread in (("concat", 0.1), ("replace", 0.0)):
        progress = start(attack(), Settings("grey", feature=feature))
        assert (feature_of(progress).std() > 0) == (spread > 0)


@pytest.mark.parametrize(
    ("wrong", "hint"), [({"feature": "concta"}, "concat"), ({"update": "sing"}, "sign")]
)
def test_unknown_kinds_name_the_nearest(wrong, hint):
    with pytest.raises(CncaError, match=f"did you mean '{hint}'"):
        Settings("grey", **wrong)


def test_kappa_bounds_every_element():
    progress, _ = run(Settings("grey", tau=0.05, steps=10, learning_rate=0.1))
    assert feature_of(progress).abs().max().item() == pytest.approx(0.05)


def test_an_interrupted_run_ends_as_if_it_had_not_been():
    settings = Settings("grey", tau=1.0, steps=8, learning_rate=0.1)
    whole, _ = run(settings)
    part, records = run(settings, stop_after=3)
    assert len(records) == 3
    again, _ = run(settings, part)
    assert again.step == 8
    assert torch.equal(feature_of(again), feature_of(whole))


def test_the_residual_is_given_render_and_reference():
    class Loop(FlatRenderer):
        def reference(self, views, weather, *, seed):
            return [(view, seed) for view in views]

    calls = []
    corrected = replace(
        attack(), renderer=Loop(), residual=lambda *pair: calls.append(pair) or 2 * pair[0]
    )
    albedo = torch.full((3, 4, 4), 0.3)
    images = corrected.render(albedo, [None], None, seed=4)
    assert torch.equal(images, 2 * calls[0][0])
    assert (calls[0][0] == 0.3).all()
    assert calls[0][1] == [(None, 4)]


def test_black_boxes_are_refused():
    attacked = attack(differentiable=False)
    settings = Settings("grey")
    with pytest.raises(DetectorError, match="gives no gradient"):
        optimize(attacked, settings, start(attacked, settings), lambda *_: None)


def test_a_gradient_that_is_not_finite_names_step_and_seed():
    attacked = attack(broken=True)
    settings = Settings("grey", seed=3)
    with pytest.raises(NonFiniteError, match=r"step 0 \(seed 3000009\)"):
        optimize(attacked, settings, start(attacked, settings), lambda *_: None)


def test_a_negative_bound_is_refused():
    with pytest.raises(GeneratorError, match="tau is -1"):
        start(attack(), Settings("grey", tau=-1.0))


@pytest.mark.parametrize("wrong", [{"steps": 0}, {"views_per_step": 0}, {"learning_rate": -1.0}])
def test_empty_attacks_are_refused(wrong):
    with pytest.raises(RunError, match="above 0"):
        Settings("grey", **wrong)


def test_the_views_of_a_step_see_the_car_all_around():
    pool = draw_pool(Scene(), Settings("grey", views_per_step=8, view_pool=256))
    for step in (0, 5, WEATHERS + 3, 9 * WEATHERS):
        views, _ = pool(step)
        azimuths = [math.degrees(math.atan2(v.origin[1], v.origin[0])) % 360 for v in views]
        assert sorted(int(azimuth // 45) for azimuth in azimuths) == list(range(8))


def test_the_pool_comes_back_to_its_views_in_another_order():
    pool = draw_pool(Scene(), Settings("grey", views_per_step=8, view_pool=256))
    epochs = [
        [pool(step)[0] for step in range(2 * WEATHERS * k, 2 * WEATHERS * (k + 1))]
        for k in range(3)
    ]
    for epoch in epochs:
        assert len({view for views in epoch for view in views}) == 256
    assert epochs[0] != epochs[1] != epochs[2] != epochs[0]
    batches = {frozenset(views) for epoch in epochs for views in epoch}
    assert len(batches) > 80  # of 96: they are not the same ones in turn either
    assert pool(70) == draw_pool(Scene(), Settings("grey", views_per_step=8, view_pool=256))(70)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"check_every": -1}, "check_every is -1: give 0 or more"),
        ({"patience": -1}, "patience is -1: give 0 or more"),
        ({"patience": 2}, "it counts checks; give check_every too"),
    ],
)
def test_checks_that_are_none(wrong, words):
    with pytest.raises(RunError, match=words):
        Settings("grey", **wrong)
