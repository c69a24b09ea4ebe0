"""What an interrupted attack goes on from.

A checkpoint is the SHA-256 of what follows it, and then, as ``torch.save`` writes them, the number
of steps done, the variables, their optimizer and the best so far.  Nothing else changes from step
to step: views, weather and noise of a step follow from its number and the seed.
"""

from __future__ import annotations

import hashlib
import io
from pathlib import Path

import torch

from cnca.attack.best import Best
from cnca.attack.loop import Progress
from cnca.core.errors import RunError
from cnca.core.files import replacing
from cnca.gen.latents import Latents

DIGEST = hashlib.sha256().digest_size


def save(progress: Progress, path: Path) -> None:
    """Write a checkpoint whole or not at all; raises RunError where that cannot be done."""
    best = progress.best.latents
    content = io.BytesIO()  # torch.save would not say what is wrong with a disk
    state = {
        "step": progress.step,
        "variables": vars(progress.variables.copy()),
        "optimizer": progress.optimizer.state_dict(),
        "best": {**vars(progress.best), "latents": best and vars(best)},
    }
    torch.save(state, content)
    with replacing(path) as temporary:
        temporary.write_bytes(hashlib.sha256(content.getbuffer()).digest() + content.getvalue())


def restore(progress: Progress, path: Path) -> None:
    """Bring ``progress`` to where the checkpoint was written.

    Raises:
        RunError: the file cannot be read, or is not what was written.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise RunError(f"{path}: cannot be read ({error.strerror}); check the folder") from None
    digest, content = content[:DIGEST], content[DIGEST:]
    if hashlib.sha256(content).digest() != digest:
        raise RunError(f"{path}: damaged; delete it to begin this run anew")
    try:
        state = torch.load(io.BytesIO(content), weights_only=True)
        progress.step = int(state["step"])
        with torch.no_grad():
            for name, variable in progress.variables.by_name.items():
                variable.value.copy_(state["variables"][name])
        progress.optimizer.load_state_dict(state["optimizer"])
        best = state["best"].pop("latents")
        progress.best = Best(best and Latents(**best), **state["best"])
    except Exception as error:  # torch raises whatever another program's content makes it raise
        raise RunError(f"{path}: holds no attack ({error}); delete it to begin anew") from None
