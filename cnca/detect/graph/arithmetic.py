"""Operations on single values: arithmetic, comparisons, activations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import reduce

import torch
from torch import Tensor
from torch.nn import functional

from cnca.detect.graph.node import Node, Operation, Values, at, needed


def unary(function: Callable[[Tensor], Tensor]) -> Operation:
    """An operation with one input and without attributes."""
    return lambda node, values: function(needed(values))


def binary(function: Callable[[Tensor, Tensor], Tensor]) -> Operation:
    """An operation with two inputs, broadcast against each other."""
    return lambda node, values: function(needed(values, 0), needed(values, 1))


def variadic(function: Callable[[Tensor, Tensor], Tensor]) -> Operation:
    """An operation that joins any number of inputs, pair by pair."""
    return lambda node, values: reduce(function, [v for v in values if v is not None])


def divide(node: Node, values: Values) -> Tensor:
    """Quotients; those of whole numbers are truncated towards zero."""
    a, b = needed(values, 0), needed(values, 1)
    return a / b if a.is_floating_point() else torch.div(a, b, rounding_mode="trunc")


def power(node: Node, values: Values) -> Tensor:
    """x^y in the type of x."""
    base, exponent = needed(values, 0), needed(values, 1)
    return base.pow(exponent).to(base.dtype)


def modulo(node: Node, values: Values) -> Tensor:
    """The remainder with the sign of the divisor, or of the dividend with ``fmod``."""
    function = torch.fmod if node.get("fmod", 0) else torch.remainder
    return function(needed(values, 0), needed(values, 1))


def clip(node: Node, values: Values) -> Tensor:
    """Values between two bounds, either of which may be missing."""
    x = needed(values)
    low, high = at(values, 1), at(values, 2)
    if node.opset < 11:
        low, high = (
            None if bound is None else x.new_tensor(bound)
            for bound in (node.get("min", None), node.get("max", None))
        )
    if low is not None:
        x = torch.maximum(x, low.to(x.dtype))
    return x if high is None else torch.minimum(x, high.to(x.dtype))


def where(node: Node, values: Values) -> Tensor:
    """Values of the second input where the first holds, else of the third."""
    return torch.where(needed(values, 0), needed(values, 1), needed(values, 2))


def prelu(node: Node, values: Values) -> Tensor:
    """x, or slope · x where x < 0; slopes are broadcast."""
    x, slope = needed(values, 0), needed(values, 1)
    return torch.where(x < 0, x * slope, x)


def hard_sigmoid(node: Node, values: Values) -> Tensor:
    """A straight line, clipped to [0, 1]."""
    return (needed(values) * node.get("alpha", 0.2) + node.get("beta", 0.5)).clamp(0, 1)


def swish(node: Node, values: Values) -> Tensor:
    """x · σ(α x)."""
    x = needed(values)
    return x * torch.sigmoid(node.get("alpha", 1.0) * x)


def gelu(node: Node, values: Values) -> Tensor:
    """x · Φ(x), exactly or by tanh."""
    kind = node.get("approximate", b"none")
    return functional.gelu(needed(values), approximate=kind.decode())


def selu(node: Node, values: Values) -> Tensor:
    """γ · ELU(x) with the scale α."""
    alpha = node.get("alpha", 1.67326319217681884765625)
    gamma = node.get("gamma", 1.05070102214813232421875)
    return functional.elu(needed(values), alpha=alpha) * gamma


def leaky_relu(node: Node, values: Values) -> Tensor:
    """x, or α · x where x < 0."""
    return functional.leaky_relu(needed(values), node.get("alpha", 0.01))


def elu(node: Node, values: Values) -> Tensor:
    """x, or α · (eˣ − 1) where x < 0."""
    return functional.elu(needed(values), node.get("alpha", 1.0))


def first_input(node: Node, values: Values) -> Tensor:
    """The first input unchanged, for operations that do nothing outside training."""
    return needed(values)


OPERATIONS: Mapping[str, Operation] = {
    "Abs": unary(torch.abs),
    "Add": binary(torch.add),
    "And": binary(torch.logical_and),
    "Ceil": unary(torch.ceil),
    "Clip": clip,
    "Cos": unary(torch.cos),
    "Div": divide,
    "Dropout": first_input,
    "Elu": elu,
    "Equal": binary(torch.eq),
    "Erf": unary(torch.erf),
    "Exp": unary(torch.exp),
    "Floor": unary(torch.floor),
    "Gelu": gelu,
    "Greater": binary(torch.gt),
    "GreaterOrEqual": binary(torch.ge),
    "HardSigmoid": hard_sigmoid,
    "HardSwish": unary(lambda x: x * (x / 6 + 0.5).clamp(0, 1)),
    "Identity": first_input,
    "IsNaN": unary(torch.isnan),
    "LeakyRelu": leaky_relu,
    "Less": binary(torch.lt),
    "LessOrEqual": binary(torch.le),
    "Log": unary(torch.log),
    "Max": variadic(torch.maximum),
    "Min": variadic(torch.minimum),
    "Mish": unary(functional.mish),
    "Mod": modulo,
    "Mul": binary(torch.mul),
    "Neg": unary(torch.neg),
    "Not": unary(torch.logical_not),
    "Or": binary(torch.logical_or),
    "PRelu": prelu,
    "Pow": power,
    "Reciprocal": unary(torch.reciprocal),
    "Relu": unary(torch.relu),
    "Round": unary(torch.round),
    "Selu": selu,
    "Sigmoid": unary(torch.sigmoid),
    "Sign": unary(torch.sign),
    "Sin": unary(torch.sin),
    "Softplus": unary(functional.softplus),
    "Softsign": unary(functional.softsign),
    "Sqrt": unary(torch.sqrt),
    "Sub": binary(torch.sub),
    "Sum": variadic(torch.add),
    "Swish": swish,
    "Tanh": unary(torch.tanh),
    "Where": where,
    "Xor": binary(torch.logical_xor),
}
