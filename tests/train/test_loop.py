"""The training loop: it minimises, repeats itself, goes on after a stop, refuses what is bad."""

import math

import pytest
import torch
from torch import nn

from cnca.core.errors import NonFiniteError, RunError
from cnca.train.loop import TrainingLoop, moving_average, rate_factor
from cnca.train.task import Recipe, Task

WANTED = torch.tensor([1.0, -2.0, 0.5])


class Line(nn.Module):
    def __init__(self):
        super().__init__()
        self.slope = nn.Parameter(torch.zeros(3))


class LineTask(Task[torch.Tensor]):
    """A slope from noisy points; draws from both generators, and remembers something."""

    name = "line"

    def __init__(self, steps, *, stops_at=None, points=16):
        self.network = Line()
        self.recipe = Recipe(steps, 0.1, save_every=5, warm_up=3, averaging=0.9)
        self.settings = {"points": points}
        self.taken, self.seen, self.stops_at = [], [], stops_at

    def batch(self, step, rng):
        if step == self.stops_at:
            raise KeyboardInterrupt
        self.taken.append(step)
        return torch.randn(self.settings["points"], 3, generator=rng)

    def losses(self, batch, rng):
        wanted = batch @ WANTED + 0.01 * torch.randn(len(batch))
        return {"squares": ((batch @ self.network.slope - wanted) ** 2).mean()}

    def metrics(self):
        self.seen.append(self.network.slope[0].item())
        return {"first": self.seen[-1]}

    def state_dict(self):
        return {"seen": self.seen}

    def load_state_dict(self, state):
        self.seen = state["seen"]


def fit(folder, task, *, resume=False, seed=0):
    averaged = TrainingLoop(folder, seed, resume).run(task)
    return task.network.slope.detach(), averaged.slope.detach(), torch.tensor(task.seen)


def test_finds_the_minimum():
    _, averaged, _ = fit(None, LineTask(200))
    torch.testing.assert_close(averaged, WANTED, atol=0.02, rtol=0.0)


def test_a_step_is_that_of_torchs_adamw():
    """Against torch's optimizer and scheduler, driven by hand; the average is Polyak's by hand."""
    task = LineTask(12)
    ours, averaged, _ = fit(None, task, seed=2)
    line, reference = Line(), LineTask(12)
    optimizer = torch.optim.AdamW(line.parameters(), lr=0.1, weight_decay=1e-4)
    scheduler = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda i: rate_factor(i, task.recipe))
    mean = None
    for step in range(12):
        torch.manual_seed(2_000_006 + step)
        points = reference.batch(step, torch.Generator().manual_seed(2_000_006 + step))
        wanted = points @ WANTED + 0.01 * torch.randn(16)
        optimizer.zero_grad()
        ((points @ line.slope - wanted) ** 2).mean().backward()
        nn.utils.clip_grad_norm_(line.parameters(), 1.0)
        optimizer.step()
        scheduler.step()
        slope, decay = line.slope.detach().clone(), min(0.9, (1 + step) / (10 + step))
        mean = slope if mean is None else decay * mean + (1 - decay) * slope
    torch.testing.assert_close(ours, line.slope.detach())
    torch.testing.assert_close(averaged, mean)


def test_the_step_size_grows_and_then_falls_to_what_is_left():
    recipe = Recipe(100, 1.0, warm_up=4, last_rate=0.02)
    assert [rate_factor(step, recipe) for step in range(2)] == pytest.approx([0.25, 0.5], rel=1e-3)
    assert rate_factor(50, recipe) == pytest.approx(0.51)
    assert rate_factor(100, recipe) == pytest.approx(0.02)
    assert rate_factor(0, Recipe(100, 1.0, warm_up=0)) == 1


def test_the_average_forgets_its_first_weights():
    average = torch.zeros(1)
    for step in range(1, 30):
        moving_average(0.998)([average], [torch.ones(1)], step)
    assert average.item() > 0.99


def test_an_interrupted_run_goes_on_as_if_it_had_not_been(tmp_path):
    whole = fit(tmp_path / "whole", LineTask(20))
    with pytest.raises(KeyboardInterrupt):
        fit(tmp_path / "broken", LineTask(20, stops_at=12))
    again = LineTask(20)
    resumed = fit(tmp_path / "broken", again, resume=True)
    assert again.taken == list(range(10, 20))  # from the checkpoint at step 10
    assert all(torch.equal(a, b) for a, b in zip(whole, resumed, strict=True))


def test_the_callers_random_numbers_stay_as_they_were(tmp_path):
    torch.manual_seed(0)
    expected = torch.rand(2)[1]
    torch.manual_seed(0)
    torch.rand(1)
    fit(None, LineTask(3))
    assert torch.rand(1) == expected


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_loss_that_is_not_finite_stops_the_training_and_says_where(value):
    task = LineTask(3)
    task.losses = lambda batch, rng: {"squares": task.network.slope.sum() + value}
    with pytest.raises(NonFiniteError, match="training of line, step 0: squares is (nan|inf)"):
        fit(None, task)


def test_a_gradient_that_is_not_finite_stops_it_before_the_weights_move():
    """The loss is finite; the slope of the square root at 0 is not."""
    task = LineTask(3)
    task.losses = lambda batch, rng: {"root": (0 * task.network.slope.sum()).sqrt()}
    with pytest.raises(NonFiniteError, match="training of line, step 0: gradient is nan"):
        fit(None, task)
    assert not task.network.slope.any()


def test_a_folder_that_holds_a_training_is_refused(tmp_path):
    fit(tmp_path, LineTask(5))
    with pytest.raises(RunError, match="already holds a training; add --resume or choose"):
        TrainingLoop(tmp_path, 0)


def test_a_damaged_checkpoint_is_refused(tmp_path):
    fit(tmp_path, LineTask(5))
    whole = (tmp_path / "line.pt").read_bytes()
    for damaged in (whole[:-100], whole[: len(whole) // 2], b"", b"PK\x03\x04"):
        (tmp_path / "line.pt").write_bytes(damaged)
        with pytest.raises(RunError, match="line.pt: not a checkpoint of this model .*; remove it"):
            fit(tmp_path, LineTask(10), resume=True)


@pytest.mark.parametrize("change", [{"network": {}}, {"step": None}, {"optimizer": {}}])
def test_a_checkpoint_of_another_model_is_refused(tmp_path, change):
    fit(tmp_path, LineTask(5))
    saved = torch.load(tmp_path / "line.pt", weights_only=True)
    torch.save(saved | change, tmp_path / "line.pt")
    with pytest.raises(RunError, match="not a checkpoint of this model"):
        fit(tmp_path, LineTask(5), resume=True)


def test_a_checkpoint_of_other_settings_is_refused(tmp_path):
    fit(tmp_path, LineTask(5))
    with pytest.raises(RunError, match="line.pt: was trained with seed=0, not 1; remove it"):
        fit(tmp_path, LineTask(5), resume=True, seed=1)
    with pytest.raises(RunError, match="line.pt: was trained with points=16, not 8; remove it"):
        fit(tmp_path, LineTask(5, points=8), resume=True)
