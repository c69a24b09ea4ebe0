"""Textures, masks and layered images as files.

Arrays here are (height, width[, channels]) with row 0 at the top, which is v = 1 in UV space.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float
from PIL import Image

from cnca.core.errors import TextureError, did_you_mean
from cnca.core.files import replacing

SrgbArray = Float[np.ndarray, "_ _ 3"]
"""Display-encoded red, green, blue in [0, 1], float32."""

MOST_PIXELS = 8192**2

READABLE = (".png", ".jpg", ".jpeg", ".exr")
RADIANT = (".hdr", ".exr")
MOST_NEGATIVE = 1e-3
"""Sum of the negative texels relative to that of the positive ones."""


def read_texture_srgb(path: str | Path) -> SrgbArray:
    """Read a PNG, JPEG (taken as sRGB) or EXR (linear by its standard, encoded to sRGB here).

    Alpha marks the UV islands: texels outside them (alpha 0) take the nearest color inside, so
    that no dark seams appear when the texture is filtered.
    Raises TextureError if the file is missing, unreadable, grey, wholly transparent, or holds NaN
    or values outside [0, 1].
    """
    path = Path(path)
    values = _read(path)
    channels = values.shape[2]
    if channels == 4:
        values = _grow_islands(path, values)
    elif channels != 3:
        raise TextureError(f"{path}: has {channels} channel(s); save it with red, green, blue")
    if path.suffix.lower() == ".exr":
        values = _encode_srgb(values)
    return np.ascontiguousarray(values, np.float32)


def read_mask(path: str | Path) -> Bool[np.ndarray, "height width"]:
    """Read a picture whose bright half (channel mean > 0.5) means True; alpha is ignored.

    Raises TextureError as :func:`read_texture_srgb` does, save that one channel is fine.
    """
    values = _read(Path(path))
    colors = values[..., : 3 if values.shape[2] >= 3 else 1]
    return colors.mean(axis=2) > 0.5


def read_radiance(path: str | Path) -> Float[np.ndarray, "height width 3"]:
    """Read an HDR (Radiance) or EXR picture: linear RGB ≥ 0, float32.

    Compression and denoising leave some texels a little below zero: these are taken as black.
    Raises TextureError if the file is missing, unreadable or grey, or holds NaN or infinite values,
    or negative ones that count (:data:`MOST_NEGATIVE`).
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in RADIANT:
        raise TextureError(
            f"{path}: radiance is read from {' or '.join(RADIANT)}{did_you_mean(suffix, RADIANT)}"
        )
    if not os.path.isfile(path):
        raise TextureError(f"{path}: no such file; paths start at the scene file's folder")
    values = _read_exr(path) if suffix == ".exr" else _read_hdr(path)
    if values.shape[2] < 3:
        raise TextureError(
            f"{path}: has {values.shape[2]} channel(s); save it with red, green, blue"
        )
    values = values[..., :3]
    wrong = int(np.count_nonzero(~np.isfinite(values).all(axis=-1)))
    if wrong:
        raise TextureError(f"{path}: {wrong} texels are NaN or infinite; repair the picture")
    positive = np.ascontiguousarray(values.clip(min=0), np.float32)
    below = positive.sum(dtype=np.float64) - values.sum(dtype=np.float64)
    if below > MOST_NEGATIVE * positive.sum(dtype=np.float64):
        raise TextureError(f"{path}: has negative radiance down to {values.min():.3g}; repair it")
    return positive


def write_texture_srgb(path: str | Path, texture: SrgbArray) -> None:
    """Write an 8-bit PNG; the file appears whole or not at all.

    Raises TextureError for NaN, values outside [0, 1] or a shape that is not (height, width, 3).
    """
    path = Path(path)
    if path.suffix.lower() != ".png":
        raise TextureError(f"{path}: textures are written as PNG; end the name with .png")
    if texture.ndim != 3 or texture.shape[2] != 3:
        raise TextureError(f"{path}: expected shape (height, width, 3), got {texture.shape}")
    _check_range(path, texture)
    levels = np.rint(texture * 255).astype(np.uint8)
    encoded = cv2.imencode(".png", cv2.cvtColor(levels, cv2.COLOR_RGB2BGR))[1]
    with replacing(path) as temporary:  # OpenCV itself would not say that a disk is full
        temporary.write_bytes(encoded.tobytes())


def write_exr(path: str | Path, layers: Mapping[str, Float[np.ndarray, "height width *n"]]) -> None:
    """Write layers of float32 into one EXR; the file appears whole or not at all.

    A layer (height, width) becomes the channel NAME, a layer (height, width, 1 to 4) the channels
    NAME.R, NAME.G, NAME.B, NAME.A; the layer named ``""`` becomes R, G, B, A, the picture itself.
    Raises TextureError if there are no layers or if their sizes differ.
    """
    import OpenEXR

    path = Path(path)
    if len({layer.shape[:2] for layer in layers.values()}) != 1:
        sizes = {name: layer.shape for name, layer in layers.items()}
        raise TextureError(f"{path}: layers must share one height and width, got {sizes}")
    channels = {}
    for name, layer in layers.items():
        if layer.ndim == 2:
            channels[name or "Y"] = layer
            continue
        for letter, plane in zip("RGBA", np.moveaxis(layer, 2, 0), strict=False):
            channels[f"{name}.{letter}" if name else letter] = plane
    channels = {name: np.ascontiguousarray(plane, np.float32) for name, plane in channels.items()}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with replacing(path) as temporary, OpenEXR.File(header, channels) as file:
        file.write(str(temporary))


def _read(path: Path) -> Float[np.ndarray, "height width channels"]:
    """Values in [0, 1], channels in the order red, green, blue, alpha."""
    if path.suffix.lower() not in READABLE:
        hint = did_you_mean(path.suffix.lower(), READABLE)
        raise TextureError(f"{path}: not one of {', '.join(READABLE)}{hint}")
    if not os.path.isfile(path):  # also of names that no system takes
        raise TextureError(f"{path}: no such file; paths start at the scene file's folder")
    values = _read_exr(path) if path.suffix.lower() == ".exr" else _read_picture(path)
    _check_range(path, values)
    return values


def _read_picture(path: Path) -> Float[np.ndarray, "height width channels"]:
    try:
        with Image.open(path) as header:
            refuse_too_large(path, *header.size)
        pixels = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError, cv2.error):
        pixels = None
    if pixels is None:
        raise TextureError(f"{path}: cannot be decoded; is it really a {path.suffix} file?")
    scale = 65535 if pixels.dtype == np.uint16 else 255
    if pixels.ndim == 2:
        pixels = pixels[..., None]
    if pixels.shape[2] >= 3:  # OpenCV starts with blue
        pixels = pixels[..., [2, 1, 0, 3][: pixels.shape[2]]]
    return pixels.astype(np.float32) / scale


def _read_hdr(path: Path) -> Float[np.ndarray, "height width channels"]:
    """Only the header says how large it is; OpenCV refuses what is too large to be true."""
    try:
        pixels = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)
    except (OSError, cv2.error):
        pixels = None
    if pixels is None or pixels.dtype != np.float32 or pixels.ndim != 3:
        raise TextureError(f"{path}: cannot be decoded; is it really a {path.suffix} file?")
    refuse_too_large(path, pixels.shape[1], pixels.shape[0])
    return pixels[..., ::-1]


def _read_exr(path: Path) -> Float[np.ndarray, "height width channels"]:
    import OpenEXR

    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            low, high = file.header()["dataWindow"]
        width, height = (int(b) - int(a) + 1 for a, b in zip(low, high, strict=True))
        refuse_too_large(path, width, height)
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
        present = [name for name in "RGBA" if name in channels] or sorted(channels)[:1]
        return np.stack([np.asarray(channels[name], np.float32) for name in present], axis=-1)
    except (RuntimeError, ValueError, TypeError, KeyError) as error:
        raise TextureError(
            f"{path}: cannot be read as EXR: {' '.join(str(error).split())}"
        ) from None


def refuse_too_large(path: Path, width: int, height: int) -> None:
    """Raise TextureError for more pixels than a picture may have; a header can promise any."""
    if width * height > MOST_PIXELS:
        raise TextureError(f"{path}: has {width} × {height} pixels; make it at most 8192 × 8192")


def _grow_islands(
    path: Path, values: Float[np.ndarray, "height width 4"]
) -> Float[np.ndarray, "height width 3"]:
    outside = values[..., 3] == 0
    if outside.all():
        raise TextureError(f"{path}: every texel is transparent; save it without alpha")
    if not outside.any():
        return values[..., :3]
    from scipy.ndimage import distance_transform_edt  # slow to import, and few pictures need it

    rows, columns = distance_transform_edt(outside, return_distances=False, return_indices=True)
    return values[rows, columns, :3]


def _check_range(path: Path, values: Float[np.ndarray, "*shape"]) -> None:
    if not np.isfinite(values).all():
        count = int(np.count_nonzero(~np.isfinite(values)))
        raise TextureError(f"{path}: {count} values are NaN or infinite; repair the texture")
    if values.min() < 0 or values.max() > 1:
        span = f"[{values.min():.4g}, {values.max():.4g}]"
        raise TextureError(f"{path}: values span {span}; scale them into [0, 1]")


def _encode_srgb(linear: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """IEC 61966-2-1, as in ``cnca.core.color``, which is for tensors: scenes do without torch."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
