"""Names of the renderers that a loop may have; nothing here loads Mitsuba."""

from __future__ import annotations

from cnca.core.errors import CncaError, did_you_mean
from cnca.core.plugins import is_plugin

BACKENDS = ("mitsuba", "raster", "cached")


def parse_backend(spec: str) -> tuple[str, int | None]:
    """``NAME`` or ``cached:N``: the backend, and after how many renders a view is shaded anew.

    Raises CncaError for another name or number.
    """
    name, colon, refresh = spec.partition(":")
    if name not in BACKENDS:
        hint = did_you_mean(name, BACKENDS)
        raise CncaError(f"backend '{name}': unknown; there is {', '.join(BACKENDS)}{hint}")
    if not colon:
        return name, None
    if name != "cached" or not refresh.isdecimal() or int(refresh) < 1:
        raise CncaError(f"backend '{spec}': only cached is refreshed, such as cached:8")
    return name, int(refresh)


def is_own_backend(spec: str) -> bool:
    """Whether a backend is the user's ``module:attribute``, not one of ours with an argument."""
    return is_plugin(spec) and spec.partition(":")[0] not in BACKENDS
