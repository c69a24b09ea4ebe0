"""The best F_adv is kept and the search ends, also across interruptions."""

from dataclasses import replace

import pytest
import torch

from cnca.attack import checkpoint
from cnca.attack.best import Best, Validation
from cnca.attack.loop import draw_pool, optimize, start
from cnca.attack.settings import Settings
from cnca.core.errors import NonFiniteError
from cnca.gen.latents import Latents
from cnca.judge.held_out import held_out_shots
from cnca.scene.schema import Scene
from tests.fake_attack import GreyGenerator, attack


class Valley(GreyGenerator):
    """Darkest where F_adv sums to −0.5; signed steps of 0.6 in all jump to and fro across it."""

    def generate(self, text_feature, adversarial_feature, generator, *, together=False):
        return ((adversarial_feature.sum() + 0.5) ** 2).clamp(0, 1).expand(3, 4, 4)


ATTACK = replace(attack(), generator=Valley())
SETTINGS = Settings(
    "grey", steps=9, learning_rate=0.1, update="sign", start_spread=0.0, check_every=1
)


def search(settings, progress=None, stop_after=None, path=None):
    """F_adv and the records of the steps; ``path`` gets the checkpoint of an interruption."""
    progress, records = progress or start(ATTACK, settings), []

    def after_step(progress, record):
        records.append(record)
        if record.step == stop_after:
            checkpoint.save(progress, path)
            raise KeyboardInterrupt

    try:
        return optimize(ATTACK, settings, progress, after_step).feature, records
    except KeyboardInterrupt:
        return None, records


def test_the_best_is_kept_not_the_last():
    last, _ = search(replace(SETTINGS, check_every=0, steps=8))
    best, records = search(replace(SETTINGS, steps=8))
    assert last.sum() == pytest.approx(0, abs=1e-6)
    assert best.sum() == pytest.approx(-0.6)
    losses = [record.validation.loss_adv for record in records]
    assert losses[0] == min(losses) < losses[1]
    assert set(records[0].validation.targets) == {"brightness"}


def test_patience_ends_the_search():
    best, records = search(replace(SETTINGS, patience=3))
    assert [record.step for record in records] == [1, 2, 3, 4]
    assert best.sum() == pytest.approx(-0.6)


def test_checks_come_every_so_many_steps_and_at_the_end():
    _, records = search(replace(SETTINGS, check_every=4))
    assert [r.step for r in records if r.validation] == [4, 8, 9]


def test_a_check_that_brings_no_number_is_told():
    with pytest.raises(NonFiniteError, match="check after step 3: the loss is not finite"):
        Best().offer(Latents(torch.zeros(1, 2)), float("nan"), 3)


@pytest.mark.parametrize("stop_after", [1, 2, 4])
def test_an_interrupted_search_ends_as_if_it_had_not_been(tmp_path, stop_after):
    settings, path = replace(SETTINGS, patience=3), tmp_path / "checkpoint.pt"
    whole, records = search(settings)
    _, first = search(settings, stop_after=stop_after, path=path)
    progress = start(ATTACK, settings)
    checkpoint.restore(progress, path)
    again, second = search(settings, progress)
    assert torch.equal(again, whole)
    assert [r.step for r in first + second] == [r.step for r in records]


def test_validation_views_are_of_their_own():
    settings = Settings("grey", seed=3)
    pool = draw_pool(Scene(), settings)
    trained = {view for step in range(100) for view in pool(step)[0]}
    shots = held_out_shots(Scene(), 24, settings.seed)
    held_out = {view for views in shots.views for view in views}
    validation = Validation(ATTACK, settings, torch.zeros(2, 3))
    own = {view for views in validation.views for view in views}
    assert len(own) == 12
    assert not own & (trained | held_out)
