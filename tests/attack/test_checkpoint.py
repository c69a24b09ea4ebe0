"""Checkpoints: all of the attack's state, and no other file taken for one."""

import errno
import math
from pathlib import Path

import pytest
import torch

from cnca.attack import checkpoint
from cnca.attack.best import Best
from cnca.attack.loop import Progress
from cnca.attack.variables import Variable, Variables
from cnca.core.errors import RunError


def progress(step: int = 0, value: float = 0.0) -> Progress:
    origins = {"feature": torch.zeros(2, 3), "noises": torch.zeros(2, 1, 4, 4)}
    moved = Variables(
        {n: Variable((o + value).requires_grad_(), o, math.inf) for n, o in origins.items()}
    )
    optimizer = torch.optim.Adam(moved.tensors, lr=0.1)
    for _ in range(step):
        sum((tensor**2).sum() for tensor in moved.tensors).backward()
        optimizer.step()
    best = Best(moved.copy(), 0.25, step) if step else Best()
    return Progress(step, moved, optimizer, best)


def test_all_of_the_state_comes_back(tmp_path):
    saved, fresh = progress(3, 0.5), progress()
    checkpoint.save(saved, tmp_path / "c.pt")
    checkpoint.restore(fresh, tmp_path / "c.pt")
    assert fresh.step == 3
    for one, other in zip(saved.variables.tensors, fresh.variables.tensors, strict=True):
        assert torch.equal(one, other)
    for number in (0, 1):
        before, after = (p.optimizer.state_dict()["state"][number] for p in (saved, fresh))
        for key in ("step", "exp_avg", "exp_avg_sq"):
            assert torch.equal(before[key], after[key])
    assert (fresh.best.loss, fresh.best.step) == (0.25, 3)
    assert torch.equal(fresh.best.latents.noises, saved.best.latents.noises)


def test_variables_of_another_kind_are_no_checkpoint_of_this_attack(tmp_path):
    saved = progress(1)
    checkpoint.save(Progress(1, Variables({}), saved.optimizer), tmp_path / "c.pt")
    with pytest.raises(RunError, match="holds no attack"):
        checkpoint.restore(progress(), tmp_path / "c.pt")


def test_every_damage_is_told(tmp_path):
    path = tmp_path / "c.pt"
    checkpoint.save(progress(1, 0.5), path)
    whole = path.read_bytes()
    damaged = [whole[:length] for length in (0, 10, 32, len(whole) // 2, len(whole) - 1)]
    damaged += [whole[:i] + bytes([whole[i] ^ 1]) + whole[i + 1 :] for i in (0, 40, 700, -20)]
    for content in damaged:
        path.write_bytes(content)
        with pytest.raises(RunError, match=r"c\.pt: damaged; delete it to begin this run anew"):
            checkpoint.restore(progress(), path)


def test_a_checkpoint_that_cannot_be_read(tmp_path):
    with pytest.raises(RunError, match=r"cannot be read \(Is a directory\)"):
        checkpoint.restore(progress(), tmp_path)


def test_a_full_disk_leaves_the_checkpoint_before(tmp_path, monkeypatch):
    path = tmp_path / "c.pt"
    checkpoint.save(progress(1, 0.5), path)
    before = path.read_bytes()

    def full(self, data):
        with open(self, "wb") as file:
            file.write(data[:50])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(RunError, match=r"c\.pt: cannot be written \(No space left on device\)"):
        checkpoint.save(progress(2, 0.5), path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
