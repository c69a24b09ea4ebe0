"""Darknet networks (Redmon 2013–2018; Bochkovskiy 2020) as differentiable torch modules.

A layer is called with the previous layer's output and the outputs that later layers refer to.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from cnca.core.errors import did_you_mean
from cnca.detect.anchor_free import AnchorFreeHead, anchor_free_head
from cnca.detect.cfg import SECTIONS, Config, Section
from cnca.detect.darknet_attention import attention_layer
from cnca.detect.darknet_keys import Features, Outputs, activation, shape, sources
from cnca.detect.yolo import YoloHead, yolo_head

BATCH_NORM_EPSILON = 1e-5
"""Added to the variance, as Darknet does on GPUs and when it fuses layers."""

MOST_VALUES = 2**28
"""Weights of a network, or values between two layers for one picture: 1 GiB."""

Head = YoloHead | AnchorFreeHead


class Convolution(nn.Module):
    """Convolution, optional batch normalization, activation."""

    def __init__(self, section: Section, channels: int) -> None:
        super().__init__()
        size, stride = section.integer("size", 1, least=1), section.integer("stride", 1, least=1)
        padding = size // 2 if section.integer("pad", 0) else section.integer("padding", 0)
        normalised = bool(section.integer("batch_normalize", 0))
        filters, groups = section.integer("filters", least=1), section.integer("groups", 1, least=1)
        if channels % groups or filters % groups:
            raise section.error(f"groups={groups} must divide {channels} inputs, {filters} filters")
        self.convolution = nn.Conv2d(
            channels, filters, size, stride, padding, groups=groups, bias=not normalised
        )
        self.norm = nn.BatchNorm2d(filters, BATCH_NORM_EPSILON) if normalised else None
        self.activation = activation(section, "logistic")

    def forward(self, x: Features, outputs: Outputs) -> Features:
        """Convolve, normalize, activate."""
        x = self.convolution(x)
        return self.activation(self.norm(x) if self.norm is not None else x)


class MaxPool(nn.Module):
    """Maximum over windows; the border is padded with −∞, more on the right and at the bottom."""

    def __init__(self, section: Section) -> None:
        super().__init__()
        self.stride = section.integer("stride", 1, least=1)
        self.size = section.integer("size", self.stride, least=1)
        padding = section.integer("padding", self.size - 1)
        before, after = padding // 2, padding - padding // 2
        self.padding = (before, after, before, after)

    def forward(self, x: Features, outputs: Outputs) -> Features:
        """Pad and take maxima."""
        padded = functional.pad(x, self.padding, value=-torch.inf)
        return functional.max_pool2d(padded, self.size, self.stride)


class Shortcut(nn.Module):
    """Sum with earlier layers."""

    def __init__(self, section: Section, index: int) -> None:
        super().__init__()
        self.sources = sources(section, "from", index)
        self.activation = activation(section, "linear")

    def forward(self, x: Features, outputs: Outputs) -> Features:
        """Add the sources."""
        for source in self.sources:
            if outputs[source].shape != x.shape:
                raise ValueError(f"cannot add shapes {shape(x)} and {shape(outputs[source])}")
            x = x + outputs[source]
        return self.activation(x)


class Route(nn.Module):
    """Earlier layers, or one of ``groups`` equal parts of each, joined along the channels."""

    def __init__(self, section: Section, index: int) -> None:
        super().__init__()
        self.sources = sources(section, "layers", index)
        self.groups = section.integer("groups", 1, least=1)
        self.group = section.integer("group_id", 0)
        if self.group >= self.groups:
            raise section.error(f"group_id={self.group} must lie below groups={self.groups}")

    def forward(self, x: Features, outputs: Outputs) -> Features:
        """Join the sources."""
        parts = [outputs[source] for source in self.sources]
        if any(part.shape[1] % self.groups for part in parts):
            raise ValueError(f"groups={self.groups} does not divide the channels of its sources")
        if len({part.shape[2:] for part in parts}) > 1:
            raise ValueError(f"shapes {', '.join(map(shape, parts))} cannot be joined")
        return torch.cat([part.chunk(self.groups, dim=1)[self.group] for part in parts], dim=1)


class Upsample(nn.Module):
    """Every value repeated ``stride`` times in both directions."""

    def __init__(self, section: Section) -> None:
        super().__init__()
        self.factor = section.integer("stride", 2, least=1)

    def forward(self, x: Features, outputs: Outputs) -> Features:
        """Repeat every value."""
        return functional.interpolate(x, scale_factor=self.factor, mode="nearest")


class Dropout(nn.Module):
    """Zeroes values at random in training; the identity otherwise."""

    def __init__(self, section: Section) -> None:
        super().__init__()
        self.probability = section.number("probability", 0.5)

    def forward(self, x: Features, outputs: Outputs) -> Features:
        """Zero at random while training."""
        return functional.dropout(x, self.probability, self.training)


class Darknet(nn.Module):
    """The network of a configuration, with random weights drawn from ``generator``.

    ``heads`` holds its ``[yolo]`` or ``[anchor_free]`` layers; the network returns their raw
    inputs in that order.

    Raises:
        DetectorError: a layer cannot be built, or its inputs do not fit together.
    """

    def __init__(self, config: Config, generator: torch.Generator | None = None) -> None:
        super().__init__()
        self.config = config
        # Built on the meta device first: running each layer there infers every shape at no cost.
        with torch.device("meta"):
            self.layers = _build_layers(config)
        self.heads = [layer for layer in self.layers if isinstance(layer, Head)]
        if not self.heads:
            raise config.net.error("the network has no [yolo] layer; add one")
        weights = sum(parameter.numel() for parameter in self.parameters())
        if weights > MOST_VALUES:
            raise config.net.error(f"the network has {weights} weights, more than {MOST_VALUES}")
        self.kept = {s for layer in self.layers for s in getattr(layer, "sources", ())}
        self.to_empty(device="cpu")
        self.reset_parameters(generator or torch.Generator().manual_seed(0))

    def reset_parameters(self, generator: torch.Generator) -> None:
        """Draw weights after He et al. (2015); biases and normalizations become neutral."""
        for layer in self.layers:
            if isinstance(layer, Convolution):
                weight = layer.convolution.weight
                nn.init.kaiming_normal_(weight, nonlinearity="leaky_relu", generator=generator)
                if layer.convolution.bias is not None:
                    nn.init.zeros_(layer.convolution.bias)
                if layer.norm is not None:
                    layer.norm.reset_parameters()

    def forward(
        self, images: Float[Tensor, "batch 3 height width"]
    ) -> list[Float[Tensor, "batch _ _ _"]]:
        """Return the raw output of each head for RGB images in [0, 1] of the network's size."""
        x, raw = images, []
        kept: dict[int, Tensor] = {}
        for index, layer in enumerate(self.layers):
            x = layer(x, kept)
            if index in self.kept:
                kept[index] = x
            if isinstance(layer, Head):
                raw.append(x)
        return raw


def _build_layers(config: Config) -> nn.ModuleList:
    if config.net.integer("channels", 3) != 3:
        raise config.net.error("channels must be 3 (RGB)")
    if math.prod(config.size) > MOST_VALUES:
        raise config.net.error(f"width and height make more than {MOST_VALUES} pixels")
    x = torch.empty(1, 3, *config.size)
    layers = nn.ModuleList()
    outputs: dict[int, Tensor] = {}
    for index, section in enumerate(config.layers):
        try:
            layer = _build_layer(section, index, x.shape[1])
            x = outputs[index] = layer.eval()(x, outputs)
        except (ValueError, TypeError, OverflowError, RuntimeError) as error:
            raise section.error(str(error).splitlines()[0]) from error
        if x.numel() > MOST_VALUES:
            raise section.error(f"makes {x.numel()} values, more than {MOST_VALUES}")
        layers.append(layer.train())
    return layers


def _build_layer(section: Section, index: int, channels: int) -> nn.Module:
    match section.kind:
        case "convolutional":
            return Convolution(section, channels)
        case "maxpool":
            return MaxPool(section)
        case "shortcut":
            return Shortcut(section, index)
        case "route":
            return Route(section, index)
        case "upsample":
            return Upsample(section)
        case "dropout":
            return Dropout(section)
        case "avgpool" | "scale_channels" | "sam" | "reorg":
            return attention_layer(section, index)
        case "yolo":
            return yolo_head(section, channels)
        case "anchor_free":
            return anchor_free_head(section, channels)
    raise section.error(f"is not supported{did_you_mean(section.kind, SECTIONS)}")
