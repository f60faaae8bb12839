"""`keystore-audit explain CODE`."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from keystore_audit.properties import Property
    from keystore_audit.rules.registry import Rule


@click.command("explain", short_help="Explain a rule or property.")
@click.argument("word", metavar="CODE-OR-NAME")
def command(word: str) -> int:
    """Explain a rule or property: why it matters, its clause, and what to do.

    CODE-OR-NAME is a rule's code or name; a property's id is the name of its rule.
    """
    from keystore_audit.cli.options import unknown
    from keystore_audit.cli.output import write_stdout
    from keystore_audit.properties import BY_ID
    from keystore_audit.rules import RULES

    rules = {key: rule for rule in RULES for key in (rule.code.lower(), rule.name)}
    rule = rules.get(word.lower())
    if rule is None:
        known = [key.upper() if key.startswith("ka") else key for key in rules]
        nearest = unknown("", word.upper() if word.lower().startswith("ka") else word.lower(), known)
        hint = nearest[nearest.index(" Did you mean") :] if " Did you mean" in nearest else ""
        raise click.UsageError(f"{word!r} is no rule and no property.{hint} `keystore-audit rules` lists them.")
    write_stdout(_explanation(rule, BY_ID.get(rule.name)))
    return 0


def _explanation(rule: Rule[Any], prop: Property | None) -> str:
    parts = [f"{rule.code} {rule.name} ({rule.severity.value})", rule.description]
    if prop is not None:
        parts.append(fill(f"Property: {prop.statement}", 80) + "\n" + fill(f"Attacker: {prop.attacker}", 80))
    parts.append(fill(f"Clause: {rule.clause}", 80) + "\n" + fill(f"Remedy: {rule.remedy}", 80))
    if rule.explains:
        parts.append(fill(f"May be why these are violated: {', '.join(sorted(rule.explains))}", 80))
    return "\n\n".join(parts) + "\n"
