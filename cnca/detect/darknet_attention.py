"""Darknet's layers that weight others (squeeze-and-excitation, spatial attention), and reorg."""

from __future__ import annotations

from torch import nn

from cnca.detect.cfg import Section
from cnca.detect.darknet_keys import Features, Outputs, activation, shape, sources


class AveragePool(nn.Module):
    """The mean of each channel (Hu et al. 2018: squeeze)."""

    def forward(self, x: Features, outputs: Outputs) -> Features:
        """Average rows and columns."""
        return x.mean(dim=(2, 3), keepdim=True)


class Weighted(nn.Module):
    """The values of an earlier layer, each times the weight that enters.

    ``[scale_channels]`` has one weight for each channel (or, with ``scale_wh``, for each place),
    ``[sam]`` one for each value (Woo et al. 2018, as YOLOv4 has it).
    """

    def __init__(self, section: Section, index: int) -> None:
        super().__init__()
        self.sources = sources(section, "from", index)[:1]
        self.activation = activation(section, "linear")

    def forward(self, x: Features, outputs: Outputs) -> Features:
        """Multiply."""
        source = outputs[self.sources[0]]
        if any(a not in (1, b) for a, b in zip(x.shape[1:], source.shape[1:], strict=True)):
            raise ValueError(f"cannot weigh {shape(source)} by {shape(x)}")
        return self.activation(source * x)


class Reorganized(nn.Module):
    """YOLOv2's passthrough: blocks of ``stride`` × ``stride`` places become channels.

    Darknet reads its input as if it had fewer, larger channels, which mixes places; networks are
    trained with this, so it is done here, too.
    """

    def __init__(self, section: Section) -> None:
        super().__init__()
        self.stride = section.integer("stride", 1, least=1)
        if section.integer("reverse", 0):
            raise section.error("reverse=1 is not supported; no published detector has it")

    def forward(self, x: Features, outputs: Outputs) -> Features:
        """Reinterpret, then move blocks into channels, as Darknet's ``reorg_cpu``."""
        s = self.stride
        batch, channels, rows, columns = x.shape
        if channels % s**2 or rows % s or columns % s:
            raise ValueError(f"stride={s} does not divide {shape(x)}")
        blocks = x.reshape(batch, channels // s**2, rows, s, columns, s)
        moved = blocks.permute(0, 3, 5, 1, 2, 4)
        return moved.reshape(batch, channels * s**2, rows // s, columns // s)


def attention_layer(section: Section, index: int) -> nn.Module:
    """The layer of one of these kinds."""
    match section.kind:
        case "avgpool":
            return AveragePool()
        case "reorg":
            return Reorganized(section)
        case _:
            return Weighted(section, index)
