"""A glTF file's JSON and its buffers, from a ``.gltf`` or a ``.glb``.

Source: Khronos, "glTF 2.0 Specification", sections 3.6.1 (buffers) and 4 (GLB).
"""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

from cnca.core.errors import CncaError, MeshError
from cnca.core.text import decode_text

Entry = dict[str, Any]
"""An object of the file's JSON, such as a mesh or a material; its keys are the specification's."""

MAGIC, JSON, BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942
READ = (
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_texture_transform",
)
"""Extensions that are read, or that may be left out without harm to shape and colors."""
LOOKS = "KHR_materials_"
"""How extensions begin that refine how a surface reflects light."""


@dataclass
class Container:
    """A file's content; ``read`` gives the bytes of a file that it names."""

    content: Mapping[str, Any]
    read: Callable[[str], bytes]
    binary: bytes = b""
    """The binary chunk of a GLB."""
    _kept: dict[int, bytes] = field(default_factory=dict)

    @classmethod
    def of(cls, data: bytes, read: Callable[[str], bytes]) -> Container:
        """Raises ValueError for what is no glTF 2, MeshError for what it requires and we lack."""
        binary = b""
        if data[:4] == struct.pack("<I", MAGIC):
            data, binary = _chunks(data)
        try:
            content = json.loads(decode_text(data, "its JSON"))
        except CncaError as error:
            raise ValueError(str(error)) from None
        if not isinstance(content, dict):
            raise ValueError("its JSON is no object")
        missing = [
            name
            for name in content.get("extensionsRequired", [])
            if name not in READ and not str(name).startswith(LOOKS)
        ]
        if missing:
            raise MeshError(
                f"requires {', '.join(map(str, missing))}, which is not read; export without it"
            )
        return cls(content, read, binary)

    def entries(self, key: str) -> Sequence[Entry]:
        """A list of the file's; empty where there is none."""
        return self.content.get(key, [])

    def buffer(self, index: int) -> bytes:
        """All bytes of a buffer."""
        if index not in self._kept:
            uri = self.entries("buffers")[index].get("uri")
            self._kept[index] = self.binary if uri is None else self.resource(uri)
        return self._kept[index]

    def resource(self, uri: str) -> bytes:
        """The bytes of a data URI, or of the file of a percent-encoded one."""
        if not uri.startswith("data:"):
            return self.read(unquote(uri))
        kind, _, text = uri.partition(",")
        raw = unquote_to_bytes(text)
        return base64.b64decode(raw) if kind.endswith(";base64") else raw


def _chunks(data: bytes) -> tuple[bytes, bytes]:
    """The JSON chunk and the binary one."""
    version, at = struct.unpack_from("<I", data, 4)[0], 12
    found: dict[int, bytes] = {}
    if version != 2:
        raise ValueError(f"is version {version} of GLB, not 2")
    while at + 8 <= len(data):
        length, kind = struct.unpack_from("<II", data, at)
        found.setdefault(kind, data[at + 8 : at + 8 + length])
        at += 8 + length
    if JSON not in found:
        raise ValueError("holds no JSON")
    return found[JSON], found.get(BINARY, b"")
