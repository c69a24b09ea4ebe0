"""How wide the marks of a pattern are."""

from __future__ import annotations

import numpy as np

from cnca.core.types import SrgbTexture

FLAT = 1e-6
"""Least power per texel of what is a pattern: display values about 0.001 off their mean."""


def period(texture: SrgbTexture) -> float:
    """Pixels from one mark of the pattern to the next: one over its median spatial frequency.

    Half of the power lies below the median: for stripes with sharp edges it is that of the stripes,
    whose harmonics would pull a mean up.  The power spectrum is that of the channels' mean,
    windowed (Hann) so that what does not repeat has no edges.  Infinite for a plain texture.
    """
    values = texture.detach().mean(dim=0).double().cpu().numpy()
    rows, columns = values.shape
    window = np.outer(np.hanning(rows + 2)[1:-1], np.hanning(columns + 2)[1:-1])
    values = (values - np.average(values, weights=window)) * window
    finer = 2 * rows, 2 * columns  # zeros around it tell frequencies between the bins
    power = np.abs(np.fft.fft2(values, finer)) ** 2
    frequency = np.hypot(np.fft.fftfreq(finer[0])[:, None], np.fft.fftfreq(finer[1])[None])
    power[frequency == 0] = 0
    if power.sum() <= FLAT * values.size:
        return float("inf")
    rising = np.argsort(frequency, axis=None)
    shares = np.cumsum(power.ravel()[rising]) / power.sum()
    return float(1 / frequency.ravel()[rising][np.searchsorted(shares, 0.5)])
