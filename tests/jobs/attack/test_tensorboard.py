"""``cnca optimize --tensorboard``: what the log holds, and what is said where the package lacks."""

import sys

import pytest
import torch

from cnca.attack.records import Reading, StepRecord
from cnca.core.errors import RunError
from cnca.jobs.attack.tensorboard import logging_to, need_tensorboard


def test_scalars_come_back_and_what_a_resumed_run_repeats_is_dropped(tmp_path):
    pytest.importorskip("tensorboard")
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    seen = {"builtin": Reading(0.5, 0.75)}
    spent = {"seconds_render": 2.0, "seconds_total": 3.0}
    for done, steps in ((0, (1, 2, 3)), (1, (2,))):
        with logging_to(tmp_path, done) as log:
            for step in steps:
                loss = step + done / 4
                log(StepRecord(step=step, loss_adv=loss, D_s=0.75, targets=seen, **spent))
    events = EventAccumulator(str(tmp_path)).Reload()
    each = {"loss_adv", "D_s"}
    assert set(events.Tags()["scalars"]) == (
        each | {f"targets/builtin/{name}" for name in each} | {"seconds/render", "seconds/total"}
    )
    assert [(e.step, e.value) for e in events.Scalars("loss_adv")] == [(1, 1.0), (2, 2.25)]


def test_a_missing_package_is_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "tensorboard", None)
    monkeypatch.delitem(sys.modules, "torch.utils.tensorboard", raising=False)
    monkeypatch.delattr(torch.utils, "tensorboard", raising=False)
    with pytest.raises(RunError, match="pip install tensorboard"):
        need_tensorboard()
