"""Weights by the names that people know: fetched once, afterwards read without a network.

``hf:OWNER/NAME`` or ``hf:OWNER/NAME@REVISION`` comes from the Hugging Face hub into its own cache;
single files come from a stated address with a stated SHA-256.  ``HF_HUB_OFFLINE=1`` forbids both.
"""

from __future__ import annotations

import hashlib
import os
import re
import sys
import urllib.error
import urllib.request
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NoReturn

from cnca.core.errors import CncaError
from cnca.core.files import replacing

HUB = "hf:"
WEIGHTS = "*.safetensors"
_NAME = re.compile(r"[\w.-]+(/[\w.-]+)?(@[\w./-]+)?")
CHUNK = 2**20
"""Number of bytes read at once."""


def is_hub_name(spec: str) -> bool:
    """Whether ``spec`` is meant as a name on the hub."""
    return spec.startswith(HUB)


def hub_folder(spec: str, patterns: Sequence[str], error: type[CncaError]) -> Path:
    """The folder of a model on the hub, fetched unless it is in the cache.

    Args:
        patterns: the files that are wanted; weights as safetensors alone.

    Raises ``error``, in one line, for an invalid or unknown name, without a network, or where
    the model has no such weights.
    """
    name = spec.removeprefix(HUB)
    if not _NAME.fullmatch(name):
        raise error(f"'{spec}': write hf:OWNER/NAME, as the model's page has it")
    repository, _, revision = name.partition("@")
    from huggingface_hub import snapshot_download  # loads a web client

    fetch = partial(
        snapshot_download,
        repository,
        revision=revision or None,
        allow_patterns=[*patterns, "README.md"],
        # Weights of half precision, and those kept for further training, beside the usual ones.
        ignore_patterns=["*.fp16.*", "*non_ema*", "safety_checker/*"],
    )
    try:
        folder = Path(fetch(local_files_only=True))
    except Exception:  # not in the cache; the hub's errors share no base class
        folder = _fetch_snapshot(spec, fetch, error)
        _say(f"{spec}: fetched into {folder}; license: {_license(folder)}")
    if not any(folder.rglob(WEIGHTS)):
        raise error(f"'{spec}': has no safetensors weights; other formats could run code")
    return folder


def _fetch_snapshot(spec: str, fetch: Callable[[], str], error: type[CncaError]) -> Path:
    from huggingface_hub import errors

    refuse_offline(spec, error)
    _say(f"{spec}: fetching from the Hugging Face hub")
    try:
        return Path(fetch())
    except errors.GatedRepoError:
        raise error(
            f"'{spec}': its license must be agreed to on its page, then run hf auth login"
        ) from None
    except (errors.RepositoryNotFoundError, errors.RevisionNotFoundError):
        raise error(f"'{spec}': the hub has no such model, or it is private") from None
    except Exception as problem:  # the web client's errors, of which there are many
        _unreachable(spec, problem, error)


def fetched_file(
    name: str, address: str, sha256: str, error: type[CncaError], *, license_name: str
) -> Path:
    """The file at ``address`` in the user's cache, fetched unless it is there.

    Raises ``error`` without a network, or where the content has another hash.
    """
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    path = base / "cnca" / address.rpartition("/")[2]
    if path.is_file():
        return path
    refuse_offline(name, error)
    _say(f"{name}: fetching {address}; license: {license_name}")
    digest = hashlib.sha256()
    try:
        with urllib.request.urlopen(address) as source, replacing(path) as temporary:
            with temporary.open("wb") as file:
                while part := source.read(CHUNK):
                    digest.update(part)
                    file.write(part)
            if digest.hexdigest() != sha256:
                raise error(
                    f"'{name}': {address} has SHA-256 {digest.hexdigest()}, expected {sha256}; "
                    "fetch the file elsewhere and give its path"
                )
    except (urllib.error.URLError, TimeoutError, ConnectionError) as problem:
        _unreachable(name, problem, error)
    return path


def refuse_offline(name: str, error: type[CncaError]) -> None:
    """Raise ``error`` where the user forbids fetching by ``HF_HUB_OFFLINE``."""
    from huggingface_hub import constants

    if constants.is_offline_mode():
        raise error(
            f"'{name}': not in the cache, and HF_HUB_OFFLINE forbids fetching it; unset it once"
        )


def _unreachable(name: str, problem: Exception, error: type[CncaError]) -> NoReturn:
    reason = (str(problem) or type(problem).__name__).splitlines()[0][:120]
    raise error(
        f"'{name}': cannot be fetched ({reason}); is there a network? otherwise copy its files "
        "here and give their path"
    ) from problem


def _license(folder: Path) -> str:
    """What the model's card says in its first lines."""
    card = folder / "README.md"
    text = card.read_text(encoding="utf-8", errors="replace") if card.is_file() else ""
    line = re.search(r"^license:\s*(\S.*)$", text, re.MULTILINE)
    return line[1].strip() if line else "not stated, see its page"


def _say(text: str) -> None:
    """One line beside the results."""
    print(text, file=sys.stderr)
