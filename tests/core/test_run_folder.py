"""A folder is claimed once, and gone on with only from what it was begun from."""

import json
from pathlib import Path

import pytest

from cnca.core.errors import RunError
from cnca.core.manifest import Manifest, hashes
from cnca.core.run_folder import RunFolder, differences

REQUEST = {"scene": Path("scene.yaml"), "settings": {"steps": 3, "tau": 1.0}}


@pytest.fixture
def files(tmp_path):
    """Two inputs of a run."""
    paths = [tmp_path / "in" / name for name in ("scene.yaml", "detector.weights")]
    paths[0].parent.mkdir()
    for path in paths:
        path.write_text(path.name)
    return paths


@pytest.fixture
def folder(tmp_path, files):
    claimed = RunFolder(tmp_path / "out", "optimize")
    claimed.claim(REQUEST, hashes(files), resume=False)
    return claimed


def test_the_manifest_says_all_and_is_read_back(folder, files):
    manifest = Manifest.read(folder.manifest)
    assert manifest.job == "optimize"
    assert manifest.request == {"scene": "scene.yaml", "settings": {"steps": 3, "tau": 1.0}}
    assert set(manifest.inputs) == {str(file) for file in files}
    assert "torch" in manifest.versions
    assert manifest.other_versions() == {}


def test_an_occupied_folder_is_refused_unless_it_is_resumed(folder, files):
    before = folder.manifest.read_bytes()
    with pytest.raises(RunError, match="out: already holds a run; add --resume or choose"):
        folder.claim(REQUEST, hashes(files), resume=False)
    assert folder.claim(REQUEST, hashes(files), resume=True) == {}
    assert folder.manifest.read_bytes() == before


def test_what_an_interrupted_write_left_is_cleared(folder, files):
    (folder.path / ".writing-x").mkdir()
    folder.claim(REQUEST, hashes(files), resume=True)
    assert not (folder.path / ".writing-x").exists()


def refusal(folder, files, request=REQUEST) -> str:
    with pytest.raises(RunError) as caught:
        folder.claim(request, hashes(files), resume=True)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_changed_option_is_named_with_both_values(folder, files):
    other = REQUEST | {"settings": {"steps": 9, "tau": 1.0}}
    message = refusal(folder, files, other)
    assert "was started with another settings.steps (was 3, now 9); ask for the same" in message


def test_a_changed_file_is_named(folder, files):
    files[1].write_text("other weights")
    message = refusal(folder, files)
    assert message.startswith(f"{files[1]}: has changed since")
    assert "bring it back or choose another --out" in message


def test_a_file_of_the_same_length_and_time_is_a_change_all_the_same(folder, files):
    import os

    stat = files[0].stat()
    files[0].write_text(files[0].read_text()[::-1])
    os.utime(files[0], ns=(stat.st_atime_ns, stat.st_mtime_ns))
    assert "scene.yaml: has changed since" in refusal(folder, files)


def test_a_file_that_is_gone_or_new_is_named(folder, files):
    assert refusal(folder, files[:1]).startswith(f"{files[1]}: is gone, and")
    more = files[0].with_name("detector.names")
    more.write_text("car")
    assert refusal(folder, [*files, more]).startswith(f"{more}: was not there when")


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(RunError, match=r"gone\.yaml: cannot be read \(No such file"):
        hashes([tmp_path / "gone.yaml"])


def test_a_folder_of_another_command_is_left_alone(folder, files):
    other, before = RunFolder(folder.path, "evaluate"), folder.manifest.read_bytes()
    for work in (
        lambda: other.renew(REQUEST, hashes(files)),
        lambda: other.claim(REQUEST, hashes(files), resume=True),
    ):
        with pytest.raises(RunError, match="holds a run of cnca optimize, not of cnca evaluate"):
            work()
    assert folder.manifest.read_bytes() == before


def test_a_renewed_folder_says_what_it_is_made_from_now(tmp_path, files):
    folder = RunFolder(tmp_path / "evidence", "evaluate")
    folder.renew(REQUEST, hashes(files))
    folder.renew(REQUEST | {"views": 4}, hashes(files[:1]))
    manifest = Manifest.read(folder.manifest)
    assert manifest.request["views"] == 4
    assert list(manifest.inputs) == [str(files[0])]


def test_other_versions_are_told_not_refused(folder, files):
    content = json.loads(folder.manifest.read_text())
    now = content["versions"]["torch"]
    content["versions"]["torch"] = "1.0"
    folder.manifest.write_text(json.dumps(content))
    assert folder.claim(REQUEST, hashes(files), resume=True) == {"torch": ("1.0", now)}


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"request": 3, "versions": {}}', "3"])
def test_a_manifest_that_is_none_is_named(folder, files, text):
    folder.manifest.write_text(text)
    assert refusal(folder, files).startswith(str(folder.manifest))


def test_differences_go_into_sections():
    then, now = {"a": {"b": 1, "c": {"d": 2}}, "e": None}, {"a": {"b": 1, "c": {"d": 3}}, "f": "x"}
    assert differences(then, now) == [
        "a.c.d (was 2, now 3)",
        "f (was unset, now x)",
        "e (was unset, now unset)",
    ]
    assert differences(then, then) == []
