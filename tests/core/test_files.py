"""Files appear whole or not at all."""

import pytest

from cnca.core.errors import RunError
from cnca.core.files import append_text, remove_unfinished, replacing


def test_a_file_appears_only_when_it_is_complete(tmp_path):
    path = tmp_path / "new" / "a.txt"
    with replacing(path) as temporary:
        temporary.write_text("half")
        assert not path.exists()
        temporary.write_text("whole")
    assert path.read_text() == "whole"
    assert list(path.parent.iterdir()) == [path]


def _write_half_and_fail(path):
    with replacing(path) as temporary:
        temporary.write_text("half")
        raise ZeroDivisionError


def test_an_error_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError):
        _write_half_and_fail(path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_is_a_file_is_one_clear_line(tmp_path):
    (tmp_path / "a").write_text("")
    with pytest.raises(RunError, match=r"a/b\.txt: cannot be written \(.*exists"):
        _write_half_and_fail(tmp_path / "a" / "b.txt")


def test_text_is_appended_or_refused_in_one_line(tmp_path):
    for line in ("one\n", "two\n"):
        append_text(tmp_path / "log", line)
    assert (tmp_path / "log").read_text() == "one\ntwo\n"
    with pytest.raises(RunError, match=r"cannot be written \(Is a directory\); check disk"):
        append_text(tmp_path, "three\n")


def test_leftovers_of_a_killed_process_go(tmp_path):
    (tmp_path / "a.txt").write_text("whole")
    (tmp_path / ".writing-abc").mkdir()
    (tmp_path / ".writing-abc" / "a.txt").write_text("half")
    remove_unfinished(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
