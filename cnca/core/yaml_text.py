"""YAML as people write it, in which no key may stand twice."""

from __future__ import annotations

from collections.abc import Hashable
from pathlib import Path
from typing import Any

import yaml

from cnca.core.errors import CncaError
from cnca.core.text import read_text


class _OnceOnly(yaml.SafeLoader):  # type: ignore[misc]
    """Refuses a mapping in which a key stands twice; PyYAML would take the last one."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        lines: dict[Hashable, int] = {}
        for key, _ in node.value if isinstance(node, yaml.MappingNode) else ():
            if key.tag == "tag:yaml.org,2002:merge" or not isinstance(key, yaml.ScalarNode):
                continue
            line = key.start_mark.line + 1
            if key.value in lines:
                first = lines[key.value]
                raise yaml.YAMLError(f"'{key.value}' stands in line {first} and in line {line}")
            lines[key.value] = line
        return super().construct_mapping(node, deep)


def read_yaml(path: str | Path, error: type[CncaError]) -> Any:
    """The content of a YAML file.

    Raises OSError; ``error`` for text that is not UTF-8; whatever PyYAML raises for invalid
    YAML, and YAMLError for a key that stands twice in a mapping.
    """
    return yaml.load(read_text(path, error), _OnceOnly)
