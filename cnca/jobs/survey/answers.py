"""A survey's key, and the sheets of answers: checked, and kept so that none is lost."""

from __future__ import annotations

import json
import re
import sqlite3
import threading
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from cnca.core.errors import RunError
from cnca.core.records import read_record

KEY, STORE, FILES = "survey.json", "answers.sqlite", "answers"
"""In a survey's folder: the key, what a server collected, and the folder for saved files."""
LOWEST, HIGHEST = 1, 5
MOST_PARTICIPANTS = 10_000


@dataclass(frozen=True)
class Survey:
    """What is asked, and the source and the file of each picture by its key on the page."""

    id: str
    question: str
    sources: Mapping[str, str]
    names: Mapping[str, str]


@dataclass(frozen=True)
class Sheet:
    """One participant's answers; a higher revision of them replaces a lower one."""

    participant: str
    """Random, made by the page; nothing else is known of a participant."""
    revision: int
    answers: Mapping[str, int]
    """Picture → 1 (not natural at all) … 5 (very natural)."""


def read_survey(folder: Path) -> Survey:
    """The survey in a folder; raises RunError where there is none."""
    try:
        return read_record(Survey, folder / KEY)
    except RunError as error:
        raise RunError(
            f"{folder / KEY}: no survey; make one with cnca survey build ({error})"
        ) from None


def read_sheet(text: bytes, survey: Survey) -> Sheet:
    """Check a sheet that came as JSON; raises RunError, without saying where it came from."""
    try:
        given = json.loads(text)
    except (ValueError, RecursionError):
        raise RunError("no JSON") from None
    if not isinstance(given, dict) or set(given) != {
        "survey",
        "participant",
        "revision",
        "answers",
    }:
        raise RunError("not the answers of a survey")
    if given["survey"] != survey.id:
        raise RunError("answers to another survey")
    participant, revision, answers = (given[k] for k in ("participant", "revision", "answers"))
    if not isinstance(participant, str) or not re.fullmatch("[0-9a-f]{32}", participant):
        raise RunError("participant: not 32 hexadecimal digits")
    if type(revision) is not int or not 0 <= revision < 2**53:
        raise RunError("revision: not a number of 0 or more")
    if not isinstance(answers, dict) or not answers.keys() <= survey.sources.keys():
        raise RunError("answers: name a picture that the survey does not have")
    if any(type(score) is not int or not LOWEST <= score <= HIGHEST for score in answers.values()):
        raise RunError(f"answers: a score is not one of {LOWEST} to {HIGHEST}")
    return Sheet(participant, revision, answers)


class Store:
    """Sheets in SQLite; what :meth:`keep` returned from survives a kill and a loss of power."""

    def __init__(self, path: Path) -> None:
        self._lock = threading.Lock()
        self._database = sqlite3.connect(path, check_same_thread=False, timeout=30)
        self._database.execute("PRAGMA journal_mode = WAL")
        self._database.execute("PRAGMA synchronous = FULL")
        self._database.execute(
            "CREATE TABLE IF NOT EXISTS sheets "
            "(participant TEXT PRIMARY KEY, revision INTEGER NOT NULL, answers TEXT NOT NULL)"
        )

    def keep(self, sheet: Sheet) -> None:
        """Store a sheet unless a later revision is there; raises RunError if the store is full."""
        row = (sheet.participant, sheet.revision, json.dumps(sheet.answers))
        with self._lock, self._database:
            known = "SELECT count(*), max(participant = ?) FROM sheets"
            count, there = self._database.execute(known, row[:1]).fetchone()
            if count >= MOST_PARTICIPANTS and not there:
                raise RunError(f"there are {MOST_PARTICIPANTS} participants already")
            self._database.execute(
                "INSERT INTO sheets VALUES (?, ?, ?) ON CONFLICT (participant) DO UPDATE "
                "SET revision = excluded.revision, answers = excluded.answers "
                "WHERE excluded.revision > revision",
                row,
            )

    def sheets(self) -> list[Sheet]:
        """All of them."""
        with self._lock:
            rows = self._database.execute("SELECT participant, revision, answers FROM sheets")
            return [Sheet(who, revision, json.loads(answers)) for who, revision, answers in rows]

    def close(self) -> None:
        """Let go of the file."""
        self._database.close()


def read_sheets(folder: Path, survey: Survey) -> list[Sheet]:
    """The latest sheet of each participant: from the server's store and from saved files.

    Raises RunError, which names the file, where one is damaged or answers another survey.
    """
    sheets: list[Sheet] = []
    if (folder / STORE).exists():
        try:
            store = Store(folder / STORE)
            sheets += store.sheets()
            store.close()
        except sqlite3.DatabaseError as error:
            raise RunError(f"{folder / STORE}: damaged ({error})") from None
    for file in sorted((folder / FILES).glob("*.json")):
        try:
            sheets.append(read_sheet(file.read_bytes(), survey))
        except RunError as error:
            raise RunError(f"{file}: {error}; take it away") from None
    return _latest(sheets)


def _latest(sheets: Iterable[Sheet]) -> list[Sheet]:
    latest: dict[str, Sheet] = {}
    for sheet in sorted(sheets, key=lambda sheet: sheet.revision):
        latest[sheet.participant] = sheet
    return [latest[participant] for participant in sorted(latest)]
