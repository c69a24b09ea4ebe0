"""YAML: a key stands once, and every text of YAML's is read."""

import pytest
import yaml

from cnca.core.errors import SceneError
from cnca.core.yaml_text import read_yaml


@pytest.mark.parametrize(
    "text", ["sun: 1\nsky: 2\nsun: 3\n", "a: {sun: 1, sun: 2}", "sun: 1\r\nsun: 2"]
)
def test_a_key_that_stands_twice_is_an_error(tmp_path, text):
    (tmp_path / "a.yaml").write_bytes(text.encode())
    with pytest.raises(yaml.YAMLError, match="'sun' stands in line 1 and in line"):
        read_yaml(tmp_path / "a.yaml", SceneError)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_encodings_and_merged_keys(tmp_path, encoding):
    text = "base: &base {größe: 1, x: 2}\nsame: {<<: *base, x: 3}\n"
    (tmp_path / "a.yaml").write_bytes(text.replace("\n", "\r\n").encode(encoding))
    assert read_yaml(tmp_path / "a.yaml", SceneError)["same"] == {"größe": 1, "x": 3}


def test_a_foreign_byte_is_named(tmp_path):
    (tmp_path / "a.yaml").write_bytes("größe: 1".encode("latin-1"))
    with pytest.raises(SceneError, match=r"byte 2 \(0xf6, line 1\) is not UTF-8"):
        read_yaml(tmp_path / "a.yaml", SceneError)
