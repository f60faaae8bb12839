"""`keystore-audit rules`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from keystore_audit.cli import once
from keystore_audit.cli import options as opt
from keystore_audit.findings import SEVERITIES

if TYPE_CHECKING:
    from keystore_audit.rules.registry import Rule


@click.command("rules", cls=once.Command)
@opt.choice("--severity", words=SEVERITIES, help="Only rules of this severity.")
@click.option("--family", type=opt.rule_family, metavar="CODE", help="Only rules of this family, e.g. KA2.")
def command(severity: str | None, family: str | None) -> int:
    """List the rules: code, severity and name.

    The names of the KA7 rules are the properties that the engines decide. Some findings weigh more or less than their
    rule does in general: `explain` says when.
    """
    from keystore_audit.cli.output import write_stdout
    from keystore_audit.rules import RULES

    of_severity = (rule for rule in RULES if severity is None or rule.severity.value == severity)
    write_stdout("".join(line(rule) for rule in of_severity if family is None or rule.family == family))
    return 0


def line(rule: Rule[Any]) -> str:
    """The rule in a list of rules."""
    return f"{rule.code}  {rule.severity.value:<8}  {rule.name}\n"
