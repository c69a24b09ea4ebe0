"""A picture as an affine function of the texture: for one view in one weather

    picture = constant + Σ_texels weight · texel,

the weights a sparse matrix for each color.  Base color is linear in the BSDF, so a picture whose
paths see the texture once is exactly this; its gradient is the transposed matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from torch import Tensor

Lanes = Float[np.ndarray, "pixels samples 3"]
"""Linear RGB of every sample of the pixels that the vehicle touches."""


@dataclass(frozen=True)
class AffinePicture:
    """One view in one weather."""

    constant: Float[np.ndarray, "film 3"]
    """All pixels of the picture without the texture's part; exposed linear RGB."""
    pixels: Int[np.ndarray, " pixels"]
    """Flat indices of the pixels that show texture."""
    weights: tuple[csr_array, csr_array, csr_array]
    """(pixels, texels) for red, green and blue."""

    @property
    def megabytes(self) -> float:
        """Memory that keeping it takes."""
        shared = self.weights[0].indices.nbytes + self.weights[0].indptr.nbytes
        values = sum(color.data.nbytes for color in self.weights)
        return (self.constant.nbytes + self.pixels.nbytes + shared + values) / 1e6


def texel_weights(
    uv: Float[np.ndarray, "pixels samples 2"], gain: Lanes, size: int
) -> tuple[csr_array, csr_array, csr_array]:
    """The matrices of a texture of ``size`` × ``size`` texels, bilinear and repeating.

    Args:
        uv: texture coordinates, v downwards.
        gain: what a white texel there adds to the pixel; 0 off the paint.
    """
    count = len(uv)
    corner = uv * size - 0.5
    first = np.floor(corner)
    fraction = (corner - first).astype(np.float32)
    texels, shares = [], []
    for right in (0, 1):
        for below in (0, 1):
            column, row = (first + (right, below)).astype(np.int64).transpose(2, 0, 1) % size
            across, along = fraction.transpose(2, 0, 1)
            texels.append((row * size + column).astype(np.int32))
            shares.append((across if right else 1 - across) * (along if below else 1 - along))
    # One row of the matrix may meet a texel in many samples: sort, then add what is equal.
    texel = np.concatenate(texels, axis=1)
    order = np.argsort(texel, axis=1)
    texel = np.take_along_axis(texel, order, axis=1)
    new = np.ones(texel.shape, bool)
    new[:, 1:] = texel[:, 1:] != texel[:, :-1]
    starts = np.flatnonzero(new)
    ends = np.append(0, np.cumsum(new.sum(axis=1))).astype(np.int32)
    matrices = []
    for color in gain.transpose(2, 0, 1):
        value = np.concatenate([color * share for share in shares], axis=1)
        value = np.take_along_axis(value, order, axis=1).ravel()
        data = np.add.reduceat(value, starts) if count else value
        matrices.append((data.astype(np.float32), texel.ravel()[starts], ends))
    red, green, blue = (csr_array(m, shape=(count, size * size)) for m in matrices)
    return red, green, blue


def look_up(
    texture: Float[Tensor, "3 size size"], pictures: Sequence[AffinePicture]
) -> Float[Tensor, "views film 3"]:
    """All pictures with ``texture`` (linear, row 0 at v = 1); differentiable in it."""
    images: Tensor = _LookUp.apply(texture.float(), tuple(pictures))
    return images


class _LookUp(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, texture: Tensor, pictures: tuple[AffinePicture, ...]) -> Tensor:
        ctx.pictures, ctx.shape = pictures, texture.shape
        texels = texture.detach().reshape(3, -1).numpy()
        images = np.stack([picture.constant for picture in pictures])
        for image, picture in zip(images, pictures, strict=True):
            for color in range(3):
                image[picture.pixels, color] += picture.weights[color] @ texels[color]
        return torch.from_numpy(images)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        (image_gradients,) = gradients
        total = np.zeros((3, ctx.shape[1] * ctx.shape[2]), np.float32)
        for picture, image in zip(ctx.pictures, image_gradients.numpy(), strict=True):
            for color in range(3):
                total[color] += picture.weights[color].T @ image[picture.pixels, color]
        return torch.from_numpy(total).reshape(ctx.shape), None
