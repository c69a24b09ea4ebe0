"""One job in several processes that ``torchrun`` started; alone, nothing here does anything.

In an attack each process runs its branch of the denoiser and looks at its share of a step's views;
the gradients of F_adv are summed, and all take the same step.  Other jobs divide their pictures.
Only the first writes results.
"""

from __future__ import annotations

import io
import os
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, redirect_stdout
from datetime import timedelta
from typing import Any, TypeVar

import torch
import torch.distributed as dist
from torch import Tensor
from torch.distributed.distributed_c10d import PrefixStore
from torch.distributed.rendezvous import rendezvous

LAUNCHED = "TORCHELASTIC_RUN_ID"
"""Set by torchrun."""
PATIENCE = timedelta(days=1)
"""How long the others wait while one judges; torchrun notices at once when a process dies."""

Items = TypeVar("Items", Sequence[Any], Tensor)
Item = TypeVar("Item")
Result = TypeVar("Result")


@contextmanager
def joined() -> Iterator[None]:
    """Join the processes that torchrun started, if it did; all but the first print nothing."""
    if LAUNCHED not in os.environ:
        yield
        return
    _keep_to_own_cores()
    store, own, every = next(rendezvous("env://", timeout=PATIENCE))
    if os.environ["GROUP_WORLD_SIZE"] == "1":  # several machines count their restarts apart
        # torchrun's store still has the addresses of a group that died; who reads one waits for it.
        store = PrefixStore(os.environ["TORCHELASTIC_RESTART_COUNT"], store)
    dist.init_process_group(store=store, rank=own, world_size=every, timeout=PATIENCE)
    try:
        with redirect_stdout(io.StringIO()) if rank() else nullcontext():
            yield
    finally:
        dist.destroy_process_group()


def rank() -> int:
    """Number of this process; 0 is the first."""
    return dist.get_rank() if dist.is_initialized() else 0


def count() -> int:
    """Number of processes."""
    return dist.get_world_size() if dist.is_initialized() else 1


def share(items: Items) -> Items:
    """This process's items; alone, all of them."""
    return items[rank() :: count()]


def gathered(own: Sequence[Result]) -> list[Result]:
    """What all processes made of their :func:`share` of some items, in the order of these."""
    if count() == 1:
        return list(own)
    parts: list[Sequence[Result]] = [()] * count()
    dist.all_gather_object(parts, own)
    return [part[k] for k in range(len(parts[0])) for part in parts if k < len(part)]


def add_up(*values: Tensor | None) -> None:
    """Replace each tensor by its sum over all processes."""
    for value in values:
        if count() > 1 and value is not None:
            dist.all_reduce(value.detach())


class _Sum(torch.autograd.Function):
    """Sum over all processes.  Each holds a part of the loss, so that gradients are summed too."""

    @staticmethod
    def forward(_ctx: Any, value: Tensor) -> Tensor:
        # gloo carries what lies in main memory, and adds it up in memory order.
        total = value.detach().to("cpu", copy=True, memory_format=torch.contiguous_format)
        dist.all_reduce(total)
        return total.to(value)

    @staticmethod
    def backward(_ctx: Any, gradient: Tensor) -> Tensor:
        return _Sum.apply(gradient)


def divided(work: Callable[[slice], Tensor], pieces: int) -> Tensor:
    """What ``work`` makes of all ``pieces``, each process doing one of them; differentiable.

    All processes call this at once, and each has its own loss: they sum the gradients that they
    get (:func:`add_up`).  Fewer processes than pieces do all pieces each.

    Args:
        work: pieces → a tensor with a row for each, of equal shapes.
    """
    if pieces == 1 or count() < pieces:
        return work(slice(None))
    piece = rank() % pieces
    alike = len(range(piece, count(), pieces))
    part = work(slice(piece, piece + 1)) / alike  # as many processes add the same piece
    before, after = (part.new_zeros(k, *part.shape[1:]) for k in (piece, pieces - piece - 1))
    return _Sum.apply(torch.cat([before, part, after]))


def calls(views: Sequence[Item], seed: int) -> list[tuple[Sequence[Item], int]]:
    """The views that are rendered in one call each, with its seed.

    A single process renders all in one call.  The noise of a view then depends on the views beside
    it, and so would depend on the number of processes: under torchrun each view has a call, and
    noise, of its own.  That takes longer where pictures are small.
    """
    if not dist.is_initialized():
        return [(views, seed)]
    return [([view], seed + zlib.crc32(repr(view).encode())) for view in views]


def by_first(work: Callable[[], Result]) -> Result:
    """Let the first process alone do ``work``; all get what it returns."""
    if count() == 1:
        return work()
    box = [work() if rank() == 0 else None]
    dist.broadcast_object_list(box)
    return box[0]  # type: ignore[return-value]


def _keep_to_own_cores() -> None:
    """Otherwise each process would start as many threads as the machine has cores."""
    cores = sorted(os.sched_getaffinity(0))
    mine = cores[int(os.environ["LOCAL_RANK"]) :: int(os.environ["LOCAL_WORLD_SIZE"])]
    if mine:
        os.sched_setaffinity(0, mine)
        torch.set_num_threads(len(mine))
