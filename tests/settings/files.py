"""Settings files of the tests' making: what is read, and what is said of wrong ones."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from operator import methodcaller
from pathlib import Path

import pytest

from keystore_audit import toml
from keystore_audit.errors import UsageError
from keystore_audit.settings.settings import Settings, read_settings


def file(folder: Path, text: str | bytes, name: str = "keystore-audit.toml") -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def read(folder: Path, text: str) -> Settings:
    return read_settings(file(folder, text), ())


def wrong(folder: Path, text: str | bytes, reader: Callable[[Path, Iterable[str]], object] = read_settings) -> str:
    """What is said, after the file's path."""
    path = file(folder, text)
    with pytest.raises(UsageError) as caught:
        reader(path, ())
    assert caught.value.message.startswith(str(path))
    return caught.value.message.removeprefix(str(path))


def plain(text: str) -> object:
    """What the file says, in the types of JSON: dates are strings."""
    return json.loads(json.dumps(toml.loads(text), default=methodcaller("isoformat")))
