"""A sample: a keystore and, beside it, what it is for and what an audit of it finds."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from msgspec import Struct

from keystore_audit import toml
from keystore_audit.rules import BY_CODE

from .store import Store, Tree

AT = "2026-11-21T12:00:00Z"
"""The audit instant unless a story says otherwise: the stock samples were made three weeks before."""


class Story(Struct, frozen=True, kw_only=True):
    """One sample keystore.

    `directory` is relative to `sample_keystores/`; `text` says what is built, what is wrong or right, and why
    it matters; `at` and `options` are those of the audit. `rule`: the code of the rule that the sample is
    for. `key_mode`: the mode of private keys, which git does not keep. `by_meaning`: its signed documents
    have a time and a nonce of their own at every build. `beside`: files that its options name, by their paths
    below `sample_keystores/`.
    """

    directory: str
    text: str
    tree: Tree
    at: str = AT
    options: tuple[str, ...] = ()
    rule: str | None = None
    key_mode: int = 0o600
    by_meaning: bool = False
    beside: Mapping[str, bytes] = {}

    def description(self, expectation: Mapping[str, Any]) -> str:
        """The `.toml` beside the sample.

        `expectation` holds `exit_code` and `findings`, or nothing before the first audit.
        """
        lines = [
            f"story = {_toml(self.text)}",
            f"at = {_toml(self.at)}",
            f"options = {_toml(list(self.options))}",
            f'key_mode = "{self.key_mode:04o}"',
        ]
        if self.rule is not None:
            lines.append(f"rule = {_toml(self.rule)}")
        if "exit_code" in expectation:
            lines.append(f"exit_code = {expectation['exit_code']}")
        if "findings" in expectation:
            lines.append("findings = [")
            lines += [f"  {_toml(finding)}," for finding in expectation["findings"]]
            lines.append("]")
        return "\n".join(lines) + "\n"


class Case(NamedTuple):
    """One side of a pair: what to say of it, and the keystore; options of its own, if the two are audited otherwise,
    and the files that these name.
    """

    text: str
    keystore: Store | Tree
    options: tuple[str, ...] = ()
    beside: Mapping[str, bytes] = {}

    def tree(self) -> Tree:
        """The keystore's files."""
        return self.keystore.tree() if isinstance(self.keystore, Store) else self.keystore


def pair(rule: str, *, bad: Case, good: Case, options: tuple[str, ...] = ()) -> Iterator[Story]:
    """The bad and the good sample of a rule."""
    for side, case in (("bad", bad), ("good", good)):
        yield Story(
            directory=f"rules/{rule}-{BY_CODE[rule].name}/{side}",
            rule=rule,
            text=case.text,
            tree=case.tree(),
            options=case.options or options,
            beside=case.beside,
        )


def description_of(sample: Path) -> Path:
    """The `.toml` beside the directory `sample`."""
    return sample.with_name(sample.name + ".toml")


def read_description(sample: Path) -> dict[str, Any]:
    """The fields of the `.toml` beside `sample`; empty where there is none."""
    path = description_of(sample)
    return toml.loads(path.read_text("utf-8")) if path.is_file() else {}


def _toml(value: object) -> str:
    """A string or list of strings in TOML: its basic strings are JSON's for the characters that samples
    use.
    """
    return json.dumps(value, ensure_ascii=False)
