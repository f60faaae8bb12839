"""`keystore-audit explain CODE`."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any, Final

import click

from keystore_audit.cli import options as opt
from keystore_audit.cli import output, types
from keystore_audit.cli.program import Command
from keystore_audit.findings import SEVERITIES

if TYPE_CHECKING:
    from keystore_audit.properties import Property
    from keystore_audit.rules.registry import Rule

MIN_PART: Final = 3
"""Characters of a part of a code or name: fewer fit nearly everything."""


@click.command("explain", cls=Command, short_help="Explain a rule or property.")
@click.argument("word", metavar="CODE-OR-NAME", type=types.Known(str, types.codes))
@click.option(
    "--for",
    "keystore",
    type=types.keystore_path,
    metavar="KEYSTORE",
    help="Print a shell script that does what is to do about it in this keystore.",
)
@opt.interpretation_options
@opt.file_options
@click.option("--deployed", is_flag=True, help="As of the audit.")
def command(word: str, keystore: str | None, **given: Any) -> int:
    """Explain a rule or property: why it matters, its clause, and what to do.

    CODE-OR-NAME is a rule's code or name; a property's id is the name of its rule. The beginning of a code or a part
    of a name (KA2, one-ca) lists the rules that fit. With --for KEYSTORE it prints a script instead. Read it, then run
    it where the private keys are. The exit code is 1 if the keystore does not have the finding. The other options are
    those of the audit that found it.
    """
    from keystore_audit.properties import BY_ID
    from keystore_audit.rules import RULES
    from keystore_audit.rules.registry import rule_meant

    rules = {key: rule for rule in RULES for key in (rule.code, rule.name)}
    rule = rules.get(word.upper()) or rules.get(word.lower())
    alike = [each for each in RULES if each.code.startswith(word.upper()) or word.lower() in each.name]
    if rule is None and alike and len(word) >= MIN_PART:
        output.write_stdout("".join(map(line, alike)))
        return 0
    if rule is None:
        hint = rule_meant(word, list(rules))
        raise click.UsageError(f"{word!r} is no rule and no property.{hint} `keystore-audit rules` lists them.")
    if keystore is not None:
        return _print_script(rule, keystore, given)
    output.write_stdout(_explanation(rule, BY_ID.get(rule.name)))
    return 0


def _print_script(rule: Rule[Any], path: str, given: dict[str, Any]) -> int:
    from keystore_audit.keystore.keystore import read_keystore
    from keystore_audit.options import Options, now
    from keystore_audit.pipeline import audit
    from keystore_audit.report.script import script

    named = {name: given[name] for name in ("profiles", "domain", "time_zone", "roots", "deployed")}
    options = Options(at=given["at"] or now(), settings=opt.named_settings(given, path), engine="native", **named)
    report = audit(path, options)
    found = [finding for finding in report.findings if finding.code == rule.code]
    if not found:
        output.say(f"{rule.code} {rule.name} is not found in {path}.")
        return 1
    output.write_stdout(script(found, read_keystore(path, declared=options.files)))
    return 0


def _explanation(rule: Rule[Any], prop: Property | None) -> str:
    parts = [f"{rule.code} {rule.name} ({rule.severity.value})"]
    parts += [_paragraph(paragraph) for paragraph in rule.description.split("\n\n")]
    if prop is not None:
        parts.append(f"{_paragraph(f'Property: {prop.statement}')}\n{_paragraph(f'Attacker: {prop.attacker}')}")
    parts.append(f"{_paragraph(f'Clause: {rule.clause}')}\n{_paragraph(f'Remedy: {rule.remedy.text}')}")
    if rule.explains:
        parts.append(_paragraph(f"May be why these are violated: {', '.join(sorted(rule.explains))}"))
    return "\n\n".join(parts) + "\n"


def _paragraph(text: str) -> str:
    """Return the text in lines of 80 columns; lists and what is indented stay as they are."""
    if any(line.startswith((" ", "- ")) for line in text.split("\n")):
        return text
    return fill(text, 80, break_on_hyphens=False, break_long_words=False)


@click.command("rules", cls=Command)
@opt.choice("--severity", words=SEVERITIES, help="Only rules of this severity.")
@click.option("--family", type=types.rule_family, metavar="CODE", help="Only rules of this family, e.g. KA2.")
def rules_command(severity: str | None, family: str | None) -> int:
    """List the rules: code, severity and name.

    The names of the KA7 rules are the properties that the engines decide. Some findings weigh more or less than their
    rule does in general: `explain` says when.
    """
    from keystore_audit.rules import RULES

    of_severity = (rule for rule in RULES if severity is None or rule.severity.value == severity)
    output.write_stdout("".join(line(rule) for rule in of_severity if family is None or rule.family == family))
    return 0


def line(rule: Rule[Any]) -> str:
    """The rule in a list of rules."""
    return f"{rule.code}  {rule.severity.value:<8}  {rule.name}\n"
