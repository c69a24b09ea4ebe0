"""One line of a checkup: how bad it is, what it is, a number, and what mends it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Literal

import yaml

Severity = Literal["fault", "warning", "note"]
"""A fault stops an attack or makes its numbers meaningless; a warning makes it weaker or uglier."""


@dataclass(frozen=True)
class Finding:
    """One line of a checkup."""

    severity: Severity
    what: str
    number: str
    mend: str = ""
    """The command that mends it, or what to do elsewhere."""
    keys: Mapping[str, object] = field(default_factory=dict)
    """Keys of the scene's vehicle section that mend it."""

    def line(self) -> str:
        """Severity, what, number and remedy."""
        keys = [f"vehicle.{key}: {as_yaml(value)}" for key, value in self.keys.items()]
        mend = "; ".join([", ".join(keys)] * bool(keys) + [self.mend] * bool(self.mend))
        return f"{self.severity:8}{self.what}: {self.number}" + (f" → {mend}" if mend else "")


def as_yaml(value: object) -> str:
    """A value or mapping on one line, as a scene file may have it."""
    return (
        yaml.safe_dump(
            value, default_flow_style=True, allow_unicode=True, sort_keys=False, width=1_000_000
        )
        .removesuffix("\n")
        .removesuffix("\n...")
    )


def listed(names: Collection[str]) -> str:
    """The first names, and how many more there are."""
    more = f" and {len(names) - 4} more" if len(names) > 4 else ""
    return ", ".join(list(names)[:4]) + more
