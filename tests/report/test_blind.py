"""A detector that finds nothing in plain paint is a warning, never a bare 0.00."""

from types import SimpleNamespace

from cnca.judge.records import Estimate
from cnca.report.tables import blind


def test_only_blind_detectors_are_named():
    values = {"sees": Estimate(0.8, 0.7, 0.9), "blind": Estimate(0.0, 0.0, 0.0)}
    normal = {name: {"car": {"AP_voc": value}} for name, value in values.items()}
    results = SimpleNamespace(all={"normal": normal}, detectors=list(values), label="car")
    (warning,) = blind(results)
    assert warning.startswith("warning: blind finds no car in plain paint (AP@0.5 0.00)")
    assert "classes, boxes, units, channels, white" in warning
    assert blind(SimpleNamespace(all={"photograph": {}}, detectors=["d"], label="car")) == []
