"""`keystore-audit rules`."""

from __future__ import annotations

import click

from keystore_audit.cli import once


@click.command("rules", cls=once.Command)
def command() -> int:
    """List the rules: code, severity and name.

    The names of the KA7 rules are the properties that the engines decide.
    """
    from keystore_audit.cli.output import write_stdout
    from keystore_audit.rules import RULES

    write_stdout("".join(f"{rule.code}  {rule.severity.value:<8}  {rule.name}\n" for rule in RULES))
    return 0
