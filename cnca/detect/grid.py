"""The cells of a detector's heads."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def cell_corners(rows: int, columns: int, like: Tensor) -> Float[Tensor, "{rows} {columns} 2"]:
    """Column and row of each cell, of the type and on the device of ``like``."""
    y, x = torch.meshgrid(
        torch.arange(rows, device=like.device, dtype=like.dtype),
        torch.arange(columns, device=like.device, dtype=like.dtype),
        indexing="ij",
    )
    return torch.stack([x, y], dim=-1)
