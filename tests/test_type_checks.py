"""The shape checks are on in every room, and stay away from what bears no wrapper."""

import numpy as np
import pytest
import torch
from beartype.roar import BeartypeCallHintParamViolation, BeartypeCallHintReturnViolation
from jaxtyping import Float
from torch import Tensor

from cnca.core import boxes
from cnca.gen import repeats
from cnca.mi_bridge import bridge, fog, integrator
from cnca.train import style_judge
from cnca.world.builtin import meshes
from tests.type_checks import check


@pytest.mark.parametrize(
    ("function", "arguments"),
    [
        (boxes.iou_matrix, (torch.zeros(2, 3), torch.zeros(2, 4))),
        (repeats.rolled, (torch.zeros(3), 0)),
        (fog.henyey_greenstein, ([0.5], 0.85)),
        (style_judge.shrunk, (np.zeros((2, 8, 8, 3)),)),  # no whole numbers
        (meshes.quads, (np.zeros((2, 4, 2)),)),
        (bridge.render, (torch.zeros(2, 3, 3), [])),  # not square
    ],
)
def test_a_wrong_array_is_refused(function, arguments):
    with pytest.raises(BeartypeCallHintParamViolation):
        function(*arguments)


def test_a_result_of_another_shape_is_refused():
    def twice(x: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        return torch.cat([x, x])

    with pytest.raises(BeartypeCallHintReturnViolation, match="dimension n"):
        check(twice)(torch.zeros(3))


@pytest.mark.parametrize(
    "function", [bridge._Render.eval, bridge._Render.backward, integrator.lamplight]
)
def test_what_takes_no_arrays_stays_as_it_is(function):
    assert not hasattr(function, "__wrapped__")
