"""A small attack, forecast or run in its own process, for ``tests/jobs/attack/test_forecast.py``.

    python -m tests.forecast_process FOLDER {forecast,run}

prints its processor seconds and its peak of memory in bytes.
"""

import json
import resource
import sys
import time
from pathlib import Path

from rich.console import Console

from cnca.attack.settings import Settings
from cnca.jobs.attack import run
from cnca.jobs.attack.forecast import forecast
from tests.attack_process import SCENE
from tests.gen.tiny import save_pipeline, tiny_pipeline


def small_request(folder: Path) -> run.Request:
    scene = folder / "scene.yaml"
    scene.write_text(SCENE)
    settings = Settings("zebra strips", steps=60, views_per_step=2, view_pool=64, check_every=10)
    generator = save_pipeline(tiny_pipeline(), folder / "generator")
    options = {"generator": generator, "samples": 4, "held_out_views": 8}
    return run.Request(scene, folder / "out", settings, **options)


def main(folder: Path, job: str) -> None:
    # What else the machine does changes the clock, not the processor's time.
    time.perf_counter = time.process_time
    request = small_request(folder)
    if job == "forecast":
        expected = forecast(request)
        found = expected.seconds, expected.memory
    else:
        began = time.process_time()
        run.run(request, Console(quiet=True))
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        found = time.process_time() - began, peak
    print(json.dumps(found))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
