"""The folder of a run: claimed once, and gone on with only from what it was begun from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cnca.core.errors import RunError
from cnca.core.files import remove_unfinished
from cnca.core.manifest import Manifest

MANIFEST = "manifest.json"


@dataclass(frozen=True)
class RunFolder:
    """An output folder; what is in it is told by its ``manifest.json``."""

    path: Path
    job: str
    """The command that works in it."""

    @property
    def manifest(self) -> Path:
        """The file that says what the run was begun from."""
        return self.path / MANIFEST

    @property
    def occupied(self) -> bool:
        """Whether a run was begun here."""
        return self.manifest.exists()

    def claim(
        self, request: object, inputs: Mapping[str, str], *, resume: bool
    ) -> dict[str, tuple[str, str]]:
        """Begin a run here, or see that it is this very run that goes on.

        Args:
            request: everything that decides the result, as a mapping or dataclass.
            inputs: every file that is read → SHA-256 (:func:`cnca.core.manifest.hashes`).
            resume: whether to go on with a run that is there.

        Returns:
            Package → its version when the run was begun and now, where they differ: the outcome
            may then differ, too.

        Raises:
            RunError: the folder holds a run that is not to be resumed, another one, or one whose
                files have changed since; it cannot be written.
        """
        now = Manifest.of(self.job, request, inputs)
        others: dict[str, tuple[str, str]] = {}
        if not self.occupied:
            now.write(self.manifest)
        else:
            if not resume:
                raise RunError(
                    f"{self.path}: already holds a run; add --resume or choose another --out"
                )
            others = self._compare(now).other_versions()
        remove_unfinished(self.path)
        return others

    def renew(self, request: object, inputs: Mapping[str, str]) -> None:
        """Say what the folder is made from now, whatever it was made from before.

        For commands that keep each result under a key of its own (:mod:`cnca.judge.gallery`) and so
        may be asked for something else in the same folder.  Raises RunError where the folder
        belongs to another command, whose manifest would be lost.
        """
        if self.occupied:
            self._refuse_another_job(Manifest.read(self.manifest))
        Manifest.of(self.job, request, inputs).write(self.manifest)

    def _compare(self, now: Manifest) -> Manifest:
        """The manifest that is there; raises RunError for the first difference that matters."""
        then = Manifest.read(self.manifest)
        self._refuse_another_job(then)
        differing = differences(then.request, now.request)
        if differing:
            raise RunError(
                f"{self.path}: was started with another {', '.join(differing)}; "
                "ask for the same again or choose another --out"
            )
        refuse_changed_inputs(then.inputs, now.inputs, self.path)
        return then

    def _refuse_another_job(self, then: Manifest) -> None:
        if then.job and then.job != self.job:
            raise RunError(
                f"{self.path}: holds a run of cnca {then.job}, not of cnca {self.job}; "
                "choose another --out"
            )


def refuse_changed_inputs(
    then: Mapping[str, str],
    now: Mapping[str, str],
    run: Path,
    *,
    advice: str = "bring it back or choose another --out",
) -> None:
    """Compare the hashes of the files that a run was started from with today's.

    Args:
        run: its folder or manifest, for the message.
        advice: what to do about a file that is gone or has changed.

    Raises:
        RunError: for the first file that was added, has changed or is gone.
    """
    for name, digest in now.items():
        if name not in then:
            raise RunError(
                f"{name}: was not there when {run} was started; take it away or choose "
                "another --out"
            )
        if digest != then[name]:
            raise RunError(f"{name}: has changed since {run} was started; {advice}")
    for name in then:
        if name not in now:
            raise RunError(f"{name}: is gone, and {run} was started with it; {advice}")


def differences(then: Mapping[str, Any], now: Mapping[str, Any], prefix: str = "") -> list[str]:
    """``key (was A, now B)`` of everything in which two requests differ, section by section."""
    lines = []
    for key in dict.fromkeys([*now, *then]):
        before, after = then.get(key), now.get(key)
        if before == after and (key in then) == (key in now):
            continue
        if isinstance(before, dict) and isinstance(after, dict):
            lines += differences(before, after, f"{prefix}{key}.")
        else:
            lines.append(f"{prefix}{key} (was {_short(before)}, now {_short(after)})")
    return lines


def _short(value: object) -> str:
    text = "unset" if value is None else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
