"""What ``cnca view`` takes until the first picture, and for each picture while the mouse drags.

    python benchmarks/live_view.py builtin:street_day

Processor seconds of all threads: on two free cores the picture comes sooner.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from statistics import median
from typing import Any

BEGAN = time.process_time()
DRAGS = 12


def timed(what: str, job: Callable[[], Any]) -> None:
    """Print the processor seconds of a job."""
    began = time.process_time()
    job()
    print(f"{what:44s} {time.process_time() - began:6.2f}", flush=True)


def main() -> None:
    """Measure one scene."""
    from cnca.jobs.view.controls import changed, controls_of
    from cnca.jobs.view.stage import Stage
    from cnca.report.webpage import jpeg_uri
    from cnca.scene.load_scene import load_scene

    print(f"{'programs loaded':44s} {time.process_time() - BEGAN:6.2f}", flush=True)
    scene = load_scene(sys.argv[1])
    stage, controls = Stage(scene, width=320), controls_of(scene)
    timed("vehicle and world built", lambda: stage.show(controls))
    timed("first picture", stage.step)
    for detector in ("", "builtin"):
        spent = []
        for turn in range(DRAGS):
            update = {"azimuth": 10.0 * turn, "moving": True, "detector": detector}
            began = time.process_time()
            stage.show(changed(controls, update))
            jpeg_uri(stage.step().picture)
            spent.append(time.process_time() - began)
        name = f"a picture while dragging, detector {detector or 'none'}"
        print(f"{name:44s} {median(spent):6.3f}", flush=True)
    evening = changed(controls, {"sun_altitude": 10.0})
    timed("another sun: its first picture", lambda: (stage.show(evening), stage.step()))
    fog = changed(controls, {"visibility": 80.0})
    timed("fog: its first picture", lambda: (stage.show(fog), stage.step()))
    other = changed(controls, {"world_seed": 5})
    timed("another world: its first picture", lambda: (stage.show(other), stage.step()))


if __name__ == "__main__":
    main()
