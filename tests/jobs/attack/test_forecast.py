"""What ``--dry-run`` says a run will take."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from cnca.attack.loop import draw_pool
from cnca.attack.settings import Settings
from cnca.jobs.attack import run
from cnca.jobs.attack.forecast import Forecast, Part, forecast, step_counts, textures_of
from cnca.report import MEANING
from cnca.scene.schema import Scene
from tests.forecast_process import small_request


@pytest.mark.parametrize("steps", [1, 10, 16, 17, 32, 40, 100])
@pytest.mark.parametrize(("views", "pool"), [(8, 256), (5, 200), (8, 1)])
def test_kinds_of_steps_are_counted_as_the_loop_meets_them(steps, views, pool):
    settings = Settings("grey", steps=steps, views_per_step=views, view_pool=pool)
    draw, met, weathers = draw_pool(Scene(), settings), set(), set()
    counts = [0, 0, 0, 0]
    for step in range(steps):
        own, weather = draw(step)
        new_weather, new_views = weather not in weathers, not met.issuperset(own)
        counts[0 if step == 0 else 1 if new_weather else 2 if new_views else 3] += 1
        weathers.add(weather)
        met.update(own)
    assert step_counts(settings) == tuple(counts)
    assert len(weathers) == min(steps, settings.weathers)


def test_seconds_are_summed():
    expected = Forecast([Part("a", 3, 2.0), Part("b", 1, 54.0)], 3 * 2**29, None)
    assert expected.seconds == 60
    assert expected.sentence() == "about 1.0 minutes, 1.5 GiB of memory"
    assert expected.table().row_count == 2


@pytest.fixture
def request_(tmp_path) -> run.Request:
    return small_request(tmp_path)


def test_a_dry_run_writes_nothing_and_names_all_parts(request_):
    expected = forecast(request_)
    assert not request_.out.exists()
    controls = set(MEANING) - {"before", "after", "seeds"}  # no other seeds were asked for
    assert {part.name: part.times for part in expected.parts} == {
        "preparation": 1,
        "first step": 1,
        "steps in a new weather": 15,
        "steps on new views": 16,
        "other steps": 28,
        "first check": 1,
        "other checks": 5,
        "first held-out weather": 1,
        "other held-out weathers": 1,
        "the same in other textures": 2 * (len(controls) + 1),  # the camouflage too
    }
    assert expected.memory > 2**28


def test_other_seeds_are_one_more_texture(request_):
    plain, seeds = (textures_of(replace(request_, control_seeds=n)) for n in (0, 5))
    assert set(seeds) - set(plain) == {"seeds"}


def measured(folder: Path, job: str) -> list[float]:
    """Processor seconds and bytes."""
    command = [sys.executable, "-m", "tests.forecast_process", str(folder), job]
    environment = os.environ | {"OMP_WAIT_POLICY": "PASSIVE"}  # as the command line sets it
    answer = subprocess.run(command, check=True, stdout=subprocess.PIPE, env=environment)
    return json.loads(answer.stdout)


@pytest.mark.slow
def test_the_run_takes_what_was_said(tmp_path, capsys):
    measured(tmp_path, "forecast")  # compiles the kernels, for all that follow
    said, taken = (measured(tmp_path, job) for job in ("forecast", "run"))
    with capsys.disabled():
        print(f"\nsaid {said}, taken {taken} (processor seconds, bytes)")
    assert said == pytest.approx(taken, rel=0.25)
