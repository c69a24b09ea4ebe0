"""Weights of Darknet networks: Darknet's own files, and safetensors of the same tensors."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor

from cnca.core.errors import DetectorError, did_you_mean
from cnca.core.files import replacing
from cnca.detect.darknet import Convolution, Darknet

SUFFIXES = (".safetensors", ".weights")


def load_weights(network: Darknet, path: Path) -> None:
    """Fill ``network`` from a ``.weights`` or ``.safetensors`` file.

    Raises:
        DetectorError: the file cannot be read, belongs to another network, or is not finite.
    """
    try:
        if path.suffix == ".safetensors":
            _load_safetensors(network, path)
        elif path.suffix == ".weights":
            _load_darknet(network, path)
        else:
            raise DetectorError(f"{path}: weights must end in {' or '.join(SUFFIXES)}")
    except (OSError, SafetensorError) as error:
        raise DetectorError(f"{path}: weights cannot be read ({error})") from error
    for name, tensor in stored_tensors(network).items():
        if not bool(tensor.isfinite().all()):
            raise DetectorError(f"{path}: tensor '{name}' is not finite; fetch the weights again")


def save_weights(network: Darknet, path: Path, *, dtype: torch.dtype = torch.float32) -> None:
    """Write ``.safetensors`` under a temporary name, then rename."""
    tensors = {
        name: tensor.detach().to("cpu", dtype).contiguous()
        for name, tensor in stored_tensors(network).items()
    }
    with replacing(path) as temporary:
        temporary.write_bytes(save(tensors))


def stored_tensors(network: Darknet) -> dict[str, Tensor]:
    """All weights and statistics by name, without counters of training steps."""
    state = network.state_dict()
    return {name: t for name, t in state.items() if not name.endswith("num_batches_tracked")}


def _load_safetensors(network: Darknet, path: Path) -> None:
    found, expected = load_file(path), stored_tensors(network)
    for name in expected.keys() - found.keys():
        raise DetectorError(f"{path}: tensor '{name}' is missing; export the weights again")
    for name in found.keys() - expected.keys():
        hint = did_you_mean(name, expected)
        raise DetectorError(f"{path}: tensor '{name}' is not in {network.config.path}{hint}")
    for name, tensor in expected.items():
        if found[name].shape != tensor.shape:
            shapes = f"{tuple(found[name].shape)}, expected {tuple(tensor.shape)}"
            raise DetectorError(f"{path}: tensor '{name}' of {network.config.path} has {shapes}")
        tensor.copy_(found[name])


def _load_darknet(network: Darknet, path: Path) -> None:
    content = path.read_bytes()
    start = _header_length(content, path)
    tensors = [t.data for t in _in_file_order(network) if t is not None]
    expected = sum(tensor.numel() for tensor in tensors)
    found = (len(content) - start) / 4
    if found != expected:
        raise DetectorError(
            f"{path}: {network.config.path} needs {expected} weights, the file holds {found:.12g}; "
            "is it truncated, or of another network?"
        )
    values = torch.from_numpy(np.frombuffer(content, "<f4", offset=start).copy())
    for tensor, part in zip(tensors, values.split([t.numel() for t in tensors]), strict=True):
        tensor.copy_(part.view(tensor.shape))


def _header_length(content: bytes, path: Path) -> int:
    """Three 32-bit version numbers, then the images seen: 64 bits since version 0.2."""
    if len(content) < 20:
        raise DetectorError(f"{path}: holds {len(content)} bytes, too few for Darknet weights")
    major, minor = np.frombuffer(content, "<i4", count=2).tolist()
    return 20 if major * 10 + minor >= 2 else 16


def _in_file_order(network: Darknet) -> Iterator[Tensor | None]:
    """Darknet stores each convolution as biases, scales, means, variances, weights."""
    for layer in network.layers:
        if not isinstance(layer, Convolution):
            continue
        norm, bias = layer.norm, layer.convolution.bias
        if norm is not None:
            yield from (norm.bias, norm.weight, norm.running_mean, norm.running_var)
        else:
            yield bias
        yield layer.convolution.weight
