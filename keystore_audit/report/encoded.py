"""Values in JSON as every report writes them: a line of ASCII that every reader takes."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from keystore_audit.properties.counterexample import Counterexample

_SURROGATE: Final = re.compile("[\ud800-\udfff]")
_MARKER: Final = re.compile("#(?=#)|:(?=:)")
"""Where what runners of pipelines take for a command begins (`##vso[`, `::error::`), as `text.terminal` has it."""


def encoded(value: Any) -> str:
    r"""One value on one line. Lone surrogates (bytes that are no text), which readers refuse, are shown: `\udc80`.

    Nothing in it is a command to the runner of a pipeline: the first sign of one is written as `\u0023` or `\u003a`.
    """
    text = json.dumps(value)  # without arguments: the one form for which Python keeps its encoder
    if r"\ud" in text:
        shown = _SURROGATE.sub(lambda match: rf"\\u{ord(match[0]):04x}", json.dumps(value, ensure_ascii=False))
        text = json.dumps(json.loads(shown))
    if "##" in text or "::" in text:  # in strings alone, in which a reader takes the one form for the other
        text = _MARKER.sub(lambda match: rf"\u{ord(match[0]):04x}", text)
    return text


def picked(value: object, *names: str) -> dict[str, Any]:
    """The fields of a value that a report calls as we do. JSON takes our words for strings, and tuples for arrays."""
    return {name: getattr(value, name) for name in names}


def keys(values: Mapping[str, Any]) -> list[str]:
    """A line for each key of a document."""
    return [f"  {encoded(key)}: {encoded(value)}" for key, value in values.items()]


BETWEEN: Final = ",\n    "
"""What stands between items of a key of a document."""


def array(key: str, items: Sequence[str], indent: int = 2) -> str:
    """A key of a document with a line for each of its items, which are JSON already."""
    space = " " * indent
    inner = f",\n{space}  ".join(items)
    return f"{space}{encoded(key)}: [\n{space}  {inner}\n{space}]" if items else f"{space}{encoded(key)}: []"


def document(parts: Iterable[str]) -> str:
    """Lines for keys as one document: fit to read and to diff, ten times faster than indenting."""
    return "{\n" + ",\n".join(parts) + "\n}\n"


def told(counterexample: Counterexample | None) -> dict[str, Any] | None:
    """A counterexample, or a way of data, as every report tells it."""
    if counterexample is None:
        return None
    steps = [picked(step, "enclave", "channel", "witness", "path", "line") for step in counterexample.steps]
    return {"text": counterexample.text, "steps": steps}
