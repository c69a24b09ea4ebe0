"""A second Darknet, in NumPy alone and as plain as its formulas: what tests compare with.

It reads the same ``.cfg`` and ``.weights`` with code of its own and returns the raw heads.
"""

from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view


def sections(text):
    """[(kind, {key: value})] of a configuration."""
    found = []
    for line in filter(None, (line.split("#")[0].strip() for line in text.splitlines())):
        if line[0] == "[":
            found.append((line[1:-1], {}))
        else:
            key, value = line.split("=")
            found[-1][1][key.strip()] = value.strip()
    return found


class Stream:
    """Numbers of a weight file, taken from the front."""

    def __init__(self, path):
        self.values = np.frombuffer(Path(path).read_bytes()[20:], "<f4").astype(float)

    def take(self, *shape):
        count = int(np.prod(shape))
        part, self.values = self.values[:count], self.values[count:]
        return part.reshape(shape)


def convolution(x, options, stream):
    filters, size = int(options["filters"]), int(options["size"])
    stride, groups = int(options.get("stride", 1)), int(options.get("groups", 1))
    pad = size // 2 if options.get("pad") == "1" else int(options.get("padding", 0))
    bias = stream.take(filters)
    scale, mean, variance = 1.0, 0.0, 1.0 - 1e-5
    if options.get("batch_normalize") == "1":
        scale, mean, variance = stream.take(filters), stream.take(filters), stream.take(filters)
    weights = stream.take(filters, x.shape[0] // groups, size, size)
    padded = np.pad(x, ((0, 0), (pad, pad), (pad, pad)))
    windows = sliding_window_view(padded, (size, size), axis=(1, 2))[:, ::stride, ::stride]
    parts = zip(np.split(windows, groups), np.split(weights, groups), strict=True)
    y = np.concatenate([np.einsum("cyxij,fcij->fyx", *part, optimize=True) for part in parts])
    column = [np.reshape(v, (-1, 1, 1)) for v in (mean, variance, scale, bias)]
    y = (y - column[0]) / np.sqrt(column[1] + 1e-5) * column[2] + column[3]
    return activate(y, options["activation"])


def activate(y, name):
    if name == "leaky":
        return np.where(y > 0, y, 0.1 * y)
    if name == "mish":
        return y * np.tanh(np.log1p(np.exp(y)))
    if name == "logistic":
        return 1 / (1 + np.exp(-y))
    return np.maximum(y, 0) if name == "relu" else y


def maxpool(x, options):
    """Windows start at −(size − 1) // 2; what lies outside does not count."""
    size, stride = int(options["size"]), int(options["stride"])
    height, width = x.shape[1:]
    rows, columns = (height - 1) // stride + 1, (width - 1) // stride + 1
    y = np.empty((x.shape[0], rows, columns))
    for i in range(rows):
        for j in range(columns):
            top, left = i * stride - (size - 1) // 2, j * stride - (size - 1) // 2
            window = x[:, max(top, 0) : top + size, max(left, 0) : left + size]
            y[:, i, j] = window.max(axis=(1, 2))
    return y


def route(outputs, options):
    groups, group = int(options.get("groups", 1)), int(options.get("group_id", 0))
    parts = [outputs[int(n)] for n in options["layers"].split(",")]
    return np.concatenate([np.split(part, groups)[group] for part in parts])


def run(cfg, weights, image):
    """Raw heads (outputs, rows, columns) for one image (3, height, width)."""
    stream, outputs, heads = Stream(weights), [], []
    x = image
    for kind, options in sections(Path(cfg).read_text())[1:]:
        if kind == "convolutional":
            x = convolution(x, options, stream)
        elif kind == "maxpool":
            x = maxpool(x, options)
        elif kind == "shortcut":
            x = activate(x + outputs[int(options["from"])], options["activation"])
        elif kind == "route":
            x = route(outputs, options)
        elif kind == "upsample":
            x = x.repeat(int(options["stride"]), axis=1).repeat(int(options["stride"]), axis=2)
        elif kind == "yolo":
            heads.append(x)
        outputs.append(x)
    assert len(stream.values) == 0
    return heads
