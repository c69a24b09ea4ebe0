"""One process of ``tests/core/test_parallel.py``: an attack on fakes, its outcome as a file.

    python -m torch.distributed.run --nproc-per-node 2 -m tests.attack_rank FOLDER [STEP]

With STEP the last process kills itself there, the first time that it comes so far.
"""

import json
import os
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path

import torch

from cnca.attack import checkpoint
from cnca.attack.loop import optimize, start
from cnca.attack.settings import Settings
from cnca.core import parallel
from cnca.core.records import as_json
from tests.fake_attack import NoisyGreyGenerator, SlantedRenderer, attack

SETTINGS = Settings(
    "grey",
    steps=6,
    views_per_step=4,
    learning_rate=0.1,
    check_every=2,
    variable="both",
    jitter=True,
)


def run_rank(folder: Path, die_at: int | None = None) -> None:
    attacked = replace(attack(), renderer=SlantedRenderer(), generator=NoisyGreyGenerator())
    progress, records = start(attacked, SETTINGS), []
    saved, died = folder / "checkpoint.pt", folder / "died"
    if saved.exists():
        checkpoint.restore(progress, saved)

    def after_step(progress, record):
        records.append({k: v for k, v in as_json(record).items() if not k.startswith("seconds_")})
        if parallel.rank() == 0:
            checkpoint.save(progress, saved)
        last = parallel.rank() == parallel.count() - 1
        if last and progress.step == die_at and not died.exists():
            died.touch()
            os.kill(os.getpid(), signal.SIGKILL)

    latents = optimize(attacked, SETTINGS, progress, after_step)
    values = torch.cat([latents.feature.flatten(), latents.noises.flatten()])
    outcome = {"feature": values.tolist(), "records": records}
    (folder / f"rank{parallel.rank()}.json").write_text(json.dumps(outcome))


if __name__ == "__main__":
    if (os.environ["TORCHELASTIC_RESTART_COUNT"], os.environ["RANK"]) == ("1", "1"):
        time.sleep(3)  # the first process must not take the dead one's address for this one's
    with parallel.joined():
        run_rank(Path(sys.argv[1]), *map(int, sys.argv[2:]))
