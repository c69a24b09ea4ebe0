"""How different two pictures look."""

from __future__ import annotations

from collections.abc import Sequence

import colour
import numpy as np
import torch

from cnca.core.color import encode
from cnca.jobs.accuracy.fidelity import Pixels


def mean_delta_e(pictures: Sequence[Pixels], references: Sequence[Pixels]) -> float:
    """Mean ΔE2000 (CIE 142:2001) between the means of both as sRGB pictures, D65."""
    mean, expected = (_lab(np.mean(images, axis=0)) for images in (pictures, references))
    return float(np.mean(colour.delta_E(mean, expected, method="CIE 2000")))


def _lab(linear: Pixels) -> Pixels:
    encoded = encode(torch.from_numpy(linear)).numpy()
    return np.asarray(colour.XYZ_to_Lab(colour.sRGB_to_XYZ(encoded)))
