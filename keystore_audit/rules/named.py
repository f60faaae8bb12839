"""Rules by the codes and names that users write."""

from __future__ import annotations

from collections.abc import Sequence

from keystore_audit.errors import UsageError
from keystore_audit.findings import OF_THE_AUDIT
from keystore_audit.rules import RULES
from keystore_audit.text import meant


def rule_code(word: str) -> str:
    """The code of a rule or of a family (`KA2`), in capitals.

    Raises UsageError for an unknown one, and for one of KA9, the audit itself, which always runs.
    """
    code = word.upper()
    known = sorted({rule.family for rule in RULES} | {rule.code for rule in RULES})
    if code.startswith(OF_THE_AUDIT):
        raise UsageError(f"{word!r}: KA9 says what became of the audit itself, and always runs.")
    if code not in known:
        hint = rule_meant(word, known)
        raise UsageError(f"{word!r} is no rule's code.{hint} `keystore-audit rules` lists them.")
    return code


def rule_meant(word: str, known: Sequence[str]) -> str:
    """` Did you mean …?` with the code or name among `known` that is nearest to `word`, or nothing.

    Codes are compared place by place: the letters of all of them are alike. Another family is never meant.
    """
    family = [code for code in known if code[:3] == word.upper()[:3]]
    if family:
        nearest = max(family, key=lambda code: sum(a == b for a, b in zip(code, word.upper(), strict=False)))
        return f" Did you mean {nearest}?"
    return meant(word.lower(), (name for name in known if name.islower()))
