"""What ``--dry-run`` says a run will take."""

import time

import pytest
from rich.console import Console

from cnca.attack import run
from cnca.attack.forecast import Forecast, Part, forecast, step_counts
from cnca.optimize import WEATHERS, Settings, draw_pool
from cnca.scene.schema import Scene
from tests.attack_process import SCENE
from tests.gen.tiny import save_pipeline, tiny_pipeline


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
    assert len(weathers) == min(steps, WEATHERS)


def test_seconds_are_summed():
    expected = Forecast([Part("a", 3, 2.0), Part("b", 1, 54.0)], 3 * 2**29, None)
    assert expected.seconds == 60
    assert expected.sentence() == "about 1.0 minutes, 1.5 GiB of memory"
    assert expected.table().row_count == 2


@pytest.fixture
def request_(tmp_path) -> run.Request:
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE)
    settings = Settings("zebra strips", steps=60, views_per_step=2, view_pool=64, check_every=10)
    generator = save_pipeline(tiny_pipeline(), tmp_path / "generator")
    where = scene, ("builtin",), tmp_path / "out"
    return run.Request(*where, settings, generator=generator, samples=4, held_out_views=8)


def test_a_dry_run_writes_nothing_and_names_all_parts(request_):
    expected = forecast(request_)
    assert not request_.out.exists()
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
        "the same in other textures": 8,
    }
    assert expected.memory > 2**28


@pytest.mark.slow
def test_the_run_takes_what_was_said(request_):
    began = time.perf_counter()
    expected = forecast(request_)
    said = time.perf_counter() - began
    began = time.perf_counter()
    run.run(request_, Console(quiet=True))
    # Kernels are compiled already: the run is spared what the first step took longer.
    first, later = (p.seconds for p in expected.parts[1:3])
    spared = max(first - later, 0)
    assert time.perf_counter() - began == pytest.approx(expected.seconds - spared, rel=0.25)
    assert said < expected.seconds
