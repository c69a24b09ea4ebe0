"""The scalars of a run for TensorBoard, which is imported only where a run asks for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cnca.attack.records import StepRecord
from cnca.core.errors import RunError
from cnca.core.records import as_json

Log = Callable[[StepRecord], None]
"""Takes a record of ``log.jsonl``."""


def need_tensorboard() -> Any:
    """``torch.utils.tensorboard``; raises RunError where the package is not installed."""
    try:
        from torch.utils import tensorboard
    except ImportError:
        message = "--tensorboard: the package is not installed; pip install tensorboard"
        raise RunError(message) from None
    return tensorboard


@contextmanager
def logging_to(folder: Path, step: int) -> Iterator[Log]:
    """Write records into ``folder``; those of an earlier attempt after ``step`` are dropped."""
    with need_tensorboard().SummaryWriter(str(folder), purge_step=step + 1) as writer:

        def log(record: StepRecord) -> None:
            for name, value in scalars(as_json(record)):
                if name != "step":
                    prefix = "seconds/" if name.startswith("seconds_") else ""
                    tag = prefix + name.removeprefix("seconds_")
                    writer.add_scalar(tag, value, record.step)

        yield log


def scalars(record: Mapping[str, object], prefix: str = "") -> Iterator[tuple[str, float]]:
    """All numbers, with the names of the dictionaries that they lie in before their own."""
    for name, value in record.items():
        if isinstance(value, dict):
            yield from scalars(value, f"{prefix}{name}/")
        elif isinstance(value, int | float):
            yield prefix + name, value
