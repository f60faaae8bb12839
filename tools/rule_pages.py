"""Writes docs/rules/: a page for each rule and property, from the registry and the samples, and an index.

`python tools/rule_pages.py` writes them again, `--check` says which are not what it would write.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from shlex import quote
from typing import Any, Final

ROOT: Final = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from keystore_audit.properties import BY_ID  # noqa: E402
from keystore_audit.report.junit import FAMILIES  # noqa: E402
from keystore_audit.rules import RULES  # noqa: E402
from keystore_audit.rules.registry import Rule  # noqa: E402
from tools.samples import catalogue  # noqa: E402
from tools.samples.made_at_test_time import RECIPES  # noqa: E402
from tools.samples.story import AT, Story  # noqa: E402

PAGES: Final = ROOT / "docs" / "rules"
INDEX: Final = "README.md"


def pages() -> Mapping[str, str]:
    """Return the text of every page by its name."""
    samples: dict[str, list[Story]] = {}
    for story in catalogue.stories():
        samples.setdefault(story.rule or "", []).append(story)
    found = {f"{rule.code}.md": page(rule, samples.get(rule.code, [])) for rule in RULES}
    return {INDEX: index(), **found}


def index() -> str:
    """Return the list of all properties, and of all rules by family."""
    lines = [
        "# Rules and properties",
        "",
        "`keystore-audit explain CODE` prints the page of one. A finding can say another severity than its page.",
        "[Accept a finding](../settings.md#accepted-findings) until a day, if you cannot fix it now.",
        "",
        "Try a sample in `sample_keystores/`, with the options that its page names:",
        "",
        "```sh",
        f"keystore-audit rules/{RULES[0].code}-{RULES[0].name}/bad --at {AT}",
        "```",
        "",
        "## Properties",
        "",
        "Both engines decide these of every keystore ([definitions](../model.md)).",
        "",
    ]
    lines += ["| property | page | statement |", "|---|---|---|"]
    codes = {rule.name: rule.code for rule in RULES}
    lines += [f"| {prop.id} | [{codes[prop.id]}]({codes[prop.id]}.md) | {prop.statement} |" for prop in BY_ID.values()]
    lines.append("")
    for family, title in FAMILIES.items():
        lines += [f"## {family}: {title}", "", "| code | severity | name |", "|---|---|---|"]
        lines += [
            f"| [{rule.code}]({rule.code}.md) | {rule.severity.value} | {rule.name} |"
            for rule in RULES
            if rule.family == family
        ]
        lines.append("")
    return "\n".join(lines).rstrip("\n") + "\n"


def page(rule: Rule[Any], stories: list[Story]) -> str:
    """Return the page of one rule: what, why, fix, clause and samples."""
    lines = [f"# {rule.code} {rule.name}", "", f"Severity: {rule.severity.value}.", "", rule.description, ""]
    prop = BY_ID.get(rule.name)
    if prop is not None:
        statement = [] if rule.description.startswith(prop.statement) else [prop.statement]
        lines += ["## Property", "", " ".join([*statement, f"Attacker: {prop.attacker}."]), ""]
    lines += ["## Fix", "", rule.remedy.text, "", "## Clause", "", rule.clause, ""]
    if rule.explains:
        lines += ["## Can violate", "", f"{', '.join(sorted(rule.explains))}.", ""]
    lines += [*_samples(rule, stories)]
    return "\n".join(lines).rstrip("\n") + "\n"


def _samples(rule: Rule[Any], stories: list[Story]) -> Iterator[str]:
    if not stories and rule.code not in RECIPES:
        return
    yield "## Samples"
    yield ""
    if not stories:
        yield "Made by the tests (`tools/samples/made_at_test_time.py`): git cannot hold them."
    for story in stories:
        side = story.directory.rpartition("/")[2].capitalize()
        more = f" Options: `{' '.join(map(quote, story.options))}`." if story.options else ""
        yield f"- [{side}](../../sample_keystores/{story.directory}): {story.text}{more}"


def main() -> int:
    """Write or compare; return 1 where `--check` finds another text."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing, say what differs")
    check = parser.parse_args().check
    wanted = pages()
    PAGES.mkdir(parents=True, exist_ok=True)
    there = {path.name for path in PAGES.glob("*.md")}
    differing = sorted(
        name
        for name in {*wanted, *there}
        if name not in wanted or name not in there or (PAGES / name).read_text("utf-8") != wanted[name]
    )
    if check:
        for name in differing:
            print(f"docs/rules/{name} is not what tools/rule_pages.py writes")
        return 1 if differing else 0
    for name in there - set(wanted):
        (PAGES / name).unlink()
    for name in differing:
        if name in wanted:
            (PAGES / name).write_text(wanted[name], "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
