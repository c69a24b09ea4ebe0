"""Configurations that are wrong say where."""

import pytest

from cnca.core.errors import DetectorError
from cnca.detect.cfg import read_config
from cnca.detect.darknet import Darknet
from tests.detect.conftest import TINY


def network_of(tmp_path, text):
    path = tmp_path / "wrong.cfg"
    path.write_text(text)
    return Darknet(read_config(path))


def test_values_and_comments(tmp_path):
    path = tmp_path / "a.cfg"
    path.write_text("# note\n[net]\nwidth = 64 # px\nheight=32\nlearning_rate=1e-3\n;\n[dropout]\n")
    config = read_config(path)
    assert config.size == (32, 64)
    assert [section.kind for section in config.layers] == ["dropout"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[maxpool]", "[maxpol]", r"layer 1 \[maxpol\].*is not supported; did you mean 'maxpool'"),
        ("filters=6", "filter=6", r"layer 0 .*unknown key 'filter' .*did you mean 'filters'"),
        ("activation=mish", "activation=mush", r"layer 2 .*unknown activation 'mush'; .*'mish'"),
        ("filters=6", "filters=six", r"layer 0 .*filters=six must be integers"),
        ("filters=6", "filters=0", r"layer 0 .*at least 1"),
        ("filters=6\n", "", r"layer 0 .*key 'filters' is missing"),
        ("groups=2\nactivation", "groups=5\nactivation", r"layer 2 .*groups=5 must divide 6"),
        ("from=-4", "from=-40", r"layer 7 .*must name earlier layers"),
        ("from=-4", "from=0", r"layer 7 .*cannot add shapes 8×8×8 and 6×32×32"),
        ("layers=-1,2", "layers=-1,0", r"layer 8 .*cannot be joined"),
        ("group_id=1", "group_id=2", r"layer 11 .*must lie below groups=2"),
        ("filters=14", "filters=15", r"layer 10 .*need 14 filters in the layer before, found 15"),
        ("mask=1,2", "mask=1,3", r"layer 10 .*mask must pick from the 3 anchors"),
        ("14,20\nclasses=2\nnum=3\nscale", "14\nclasses=2\nnum=3\nscale", r"anchors must be num"),
        ("channels=3", "channels=1", r"\[net\].*channels must be 3"),
        ("width=32", "width", r"\[net\].*'width' is no key=value"),
        ("[maxpool]", "[local_avgpool]", r"is not supported: Darknet has it, this reader does not"),
        ("filters=6", "filters=6\ndilation=2", r"unknown key 'dilation' at line \d+: Darknet has"),
        ("filters=6", "filters=6\nfilters=8", r"line \d+: filters=8, but filters=6 before"),
        ("activation=mish", "activation=norm_chan", r"unknown activation 'norm_chan'$"),
        ("[net]", "[dropout]", r"\[net\] must be the first section"),
        ("[net]", "size=3\n[net]", r"stands before any \[section\]"),
    ],
)
def test_wrong_configurations(tmp_path, old, new, message):
    assert old in TINY
    with pytest.raises(DetectorError, match=message) as caught:
        network_of(tmp_path, TINY.replace(old, new, 1))
    assert "wrong.cfg" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_network_without_heads(tmp_path):
    with pytest.raises(DetectorError, match=r"no \[yolo\] layer"):
        network_of(tmp_path, TINY.partition("[yolo]")[0])


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00"])
def test_no_configuration_at_all(tmp_path, content):
    path = tmp_path / "noise.cfg"
    path.write_bytes(content)
    with pytest.raises(DetectorError, match=r"noise\.cfg"):
        read_config(path)
    with pytest.raises(DetectorError, match=r"none\.cfg: cannot be read"):
        read_config(tmp_path / "none.cfg")
