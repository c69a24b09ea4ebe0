"""Names by which the parts of the generator are chosen; nothing here needs torch."""

from __future__ import annotations

from cnca.core.errors import GeneratorError, did_you_mean

CONCAT, REPLACE = "concat", "replace"
KINDS = (CONCAT, REPLACE)
"""What F_adv does to the text; see :mod:`cnca.gen.feature`."""

UPDATE_NAMES = ("adam", "sign")
"""How F_adv moves; see :data:`cnca.gen.feature.UPDATES`."""


def check_kind(kind: str) -> str:
    """Return ``kind``; raises :class:`GeneratorError` where it is none of :data:`KINDS`."""
    if kind not in KINDS:
        hint = did_you_mean(kind, KINDS)
        raise GeneratorError(f"feature '{kind}': unknown; there is {' and '.join(KINDS)}{hint}")
    return kind
