"""Values in JSON as every report writes them: a line of ASCII that every reader takes."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from keystore_audit.properties.counterexample import Counterexample

_SURROGATE: Final = re.compile("[\ud800-\udfff]")


def encoded(value: Any) -> str:
    r"""One value on one line. Lone surrogates (bytes that are no text), which readers refuse, are shown: `\udc80`."""
    text = json.dumps(value)  # without arguments: the one form for which Python keeps its encoder
    if r"\ud" not in text:
        return text
    shown = _SURROGATE.sub(lambda match: rf"\\u{ord(match[0]):04x}", json.dumps(value, ensure_ascii=False))
    return json.dumps(json.loads(shown))


def told(counterexample: Counterexample | None) -> dict[str, Any] | None:
    """A counterexample, or a way of data, as every report tells it."""
    if counterexample is None:
        return None
    names = ("enclave", "channel", "witness", "path", "line")
    steps = [{name: getattr(step, name) for name in names} for step in counterexample.steps]
    return {"text": counterexample.text, "steps": steps}
