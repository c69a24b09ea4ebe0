"""How others count, by name; nothing here needs torch.

Sources and rules stand in docs/evaluation.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

MEASURES: Mapping[str, str] = {
    "AP_001": "AP@0.5, COCO (101 points), from 0.001",
    "AP_05": "AP@0.5, VOC (area), from 0.05",
    "AP_25": "AP@0.5, VOC (area), from 0.25",
    "AP_50": "AP@0.5, VOC (area), from 0.5",
    "AP_rpga": "AP@0.5, R-PGA (11 points, whole picture)",
    "ASR_rpga": "attack success, R-PGA",
    "found_50": "share detected at 0.5, FCA",
    "ASR_padetbench": "attack success, PADetBench",
    "miss_01": "miss rate at 0.1 false alarms a clean picture",
    "LAMR": "log-average miss rate, Caltech",
}
"""Measure → what it is."""
PROTOCOLS: Mapping[str, Sequence[str]] = {
    "rpga": ("AP_rpga", "ASR_rpga"),
    "fca": ("found_50",),
    "padetbench": ("AP_001", "ASR_padetbench"),
    "coco": ("AP_001",),
}
"""What ``--protocol`` shows → its measures."""
