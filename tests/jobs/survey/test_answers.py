"""Sheets of answers: which are refused, and which of several counts."""

import json

import pytest

from cnca.core.errors import RunError
from cnca.jobs.survey import answers
from cnca.jobs.survey.answers import FILES, STORE, Sheet, Store, Survey, read_sheet, read_sheets

SURVEY = Survey("5" * 16, "How?", {"a": "Normal", "b": "FCA"}, {"a": "1.png", "b": "1.png"})
GOOD = {"survey": SURVEY.id, "participant": "0" * 32, "revision": 3, "answers": {"a": 5, "b": 1}}


def test_a_good_sheet_is_read():
    assert read_sheet(json.dumps(GOOD).encode(), SURVEY) == Sheet("0" * 32, 3, {"a": 5, "b": 1})


@pytest.mark.parametrize(
    "change",
    [
        {"survey": "6" * 16},
        {"participant": "Alice"},
        {"participant": "0" * 33},
        {"participant": None},
        {"revision": -1},
        {"revision": 1.0},
        {"revision": True},
        {"revision": 2**53},
        {"answers": {"c": 3}},
        {"answers": {"a": 0}},
        {"answers": {"a": 6}},
        {"answers": {"a": True}},
        {"answers": {"a": "5"}},
        {"answers": [1]},
        {"name": "Alice"},
    ],
)
def test_bad_sheets_are_refused(change):
    with pytest.raises(RunError):
        read_sheet(json.dumps(GOOD | change).encode(), SURVEY)


@pytest.mark.parametrize("text", [b"", b"[]", b"{", b"\xff", b"[" * 30_000, b"9" * 30_000])
def test_what_is_no_sheet_is_refused(text):
    with pytest.raises(RunError):
        read_sheet(text, SURVEY)


def test_the_latest_revision_counts(tmp_path):
    store = Store(tmp_path / STORE)
    for revision, score in ((2, 4), (5, 1), (3, 2)):
        store.keep(Sheet("0" * 32, revision, {"a": score}))
    store.close()
    assert read_sheets(tmp_path, SURVEY) == [Sheet("0" * 32, 5, {"a": 1})]


def test_saved_files_and_the_store_are_one(tmp_path):
    store = Store(tmp_path / STORE)
    store.keep(Sheet("0" * 32, 2, {"a": 4}))
    store.keep(Sheet("1" * 32, 9, {"a": 3}))
    store.close()
    (tmp_path / FILES).mkdir()
    (tmp_path / FILES / "saved.json").write_text(json.dumps(GOOD))
    assert read_sheets(tmp_path, SURVEY) == [
        Sheet("0" * 32, 3, {"a": 5, "b": 1}),
        Sheet("1" * 32, 9, {"a": 3}),
    ]


def test_a_damaged_file_is_named(tmp_path):
    (tmp_path / FILES).mkdir()
    (tmp_path / FILES / "saved.json").write_text("{")
    with pytest.raises(RunError, match=r"saved\.json: no JSON; take it away"):
        read_sheets(tmp_path, SURVEY)


def test_a_damaged_store_is_named(tmp_path):
    (tmp_path / STORE).write_bytes(b"no database" * 100)
    with pytest.raises(RunError, match=r"answers\.sqlite: damaged"):
        read_sheets(tmp_path, SURVEY)


def test_a_full_store_still_takes_those_it_knows(tmp_path, monkeypatch):
    monkeypatch.setattr(answers, "MOST_PARTICIPANTS", 1)
    store = Store(tmp_path / STORE)
    store.keep(Sheet("0" * 32, 1, {}))
    store.keep(Sheet("0" * 32, 2, {"a": 1}))
    with pytest.raises(RunError, match="participants already"):
        store.keep(Sheet("1" * 32, 1, {}))
    assert store.sheets() == [Sheet("0" * 32, 2, {"a": 1})]
    store.close()
