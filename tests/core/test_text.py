"""Text of every system is read, or its first foreign byte is named."""

import pytest

from cnca.core.errors import CncaError, SceneError
from cnca.core.text import decode_names, decode_text, read_text

TEXT = "größe: 1\nlack: 2\n"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32"])
@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
def test_marks_and_line_ends(tmp_path, encoding, ending):
    path = tmp_path / "a.txt"
    path.write_bytes(TEXT.replace("\n", ending).encode(encoding))
    assert read_text(path) == TEXT


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
def test_utf_16_without_a_mark(encoding):
    assert decode_text(("[net]\n" * 9 + TEXT).encode(encoding), "a.cfg") == "[net]\n" * 9 + TEXT
    assert decode_text(b"", "a.cfg") == ""


def test_the_first_foreign_byte_is_named():
    data = "sun: 1\nlack: grün\n".encode("latin-1")
    with pytest.raises(SceneError, match=r"a\.yaml: byte 15 \(0xfc, line 2\) is not UTF-8"):
        decode_text(data, "a.yaml", SceneError)
    with pytest.raises(CncaError, match="UTF-16"):
        decode_text(b"\xff\xfea\x00\x00\xd8", "a.yaml")


def test_names_of_other_encodings_stay_different():
    names = ["车身", "车窗", "轮胎", "Größe"]
    for encoding in ("gbk", "shift_jis", "latin-1", "utf-16"):
        coded = [name.encode(encoding, errors="ignore") for name in names]
        assert len({decode_names(one) for one in coded}) == len(set(coded))
