"""How wide the marks of a pattern are."""

from __future__ import annotations

import numpy as np

from cnca.core.types import SrgbTexture

FLAT = 1e-6
"""Least power per texel of what is a pattern: display values about 0.001 off their mean."""


def period(texture: SrgbTexture) -> float:
    """Pixels from one mark of the pattern to the next: one over its mean spatial frequency.

    The mean is over the power spectrum of the channels' mean, windowed (Hann) so that what does not
    repeat has no edges.  Infinite for a plain texture.
    """
    values = texture.detach().mean(dim=0).double().cpu().numpy()
    rows, columns = values.shape
    window = np.outer(np.hanning(rows + 2)[1:-1], np.hanning(columns + 2)[1:-1])
    values = (values - np.average(values, weights=window)) * window
    power = np.abs(np.fft.rfft2(values)) ** 2
    down, right = np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns)[None]
    frequency = np.hypot(down, right)
    power[frequency == 0] = 0
    total = power.sum()
    return float(total / (power * frequency).sum()) if total > FLAT * values.size else float("inf")
