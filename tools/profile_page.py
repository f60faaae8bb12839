"""Writes the tables of docs/profiles.md from keystore_audit/profiles/quirks.toml; the text around them is by hand.

`python tools/profile_page.py` writes them again, `--check` says whether they are what it would write.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from keystore_audit.profiles import ALIASES, QUIRKS, SPEC, VARIANTS, Evidence, Profile  # noqa: E402
from keystore_audit.profiles.table import FAMILIES, GROUP, answer, inflected, sharing  # noqa: E402

PAGE: Final = ROOT / "docs" / "profiles.md"
_TABLE: Final = re.compile(r"(<!-- table: (\w+) -->).*?(<!-- end -->)", re.DOTALL)
_LETTERS: Final = {"tested": "T", "measured": "M", "read": "R", "assumed": "A", "": ""}
_ROWS: Final = {Evidence.TESTED: "T", Evidence.MEASURED: "M", Evidence.READ: "R"}
_NAMES: Final = {each.title: each.name for each in VARIANTS.values() if each.title != FAMILIES[each.family].title} | {
    FAMILIES[SPEC.family].title: SPEC.name
}
_ASKED: Final = "vendors/test_local_decisions.py"
"""The test that asks most rows."""


def page(text: str) -> str:
    """Return the page with its tables as the rows say."""
    tables = {"names": _names(), "aliases": _aliases(), **{group: _of(group) for group in {*GROUP.values()}}}
    return _TABLE.sub(lambda found: "\n".join((found[1], *tables[found[2]], found[3])), text)


def _names() -> Iterator[str]:
    yield "| profile | versions | ROS 2 | rows |"
    yield "|---|---|---|---|"
    for profile in VARIANTS.values():
        shipped = ", ".join(map(str.capitalize, profile.distributions))
        known = "the text" if profile is SPEC else _ROWS[profile.evidence]
        yield f"| {profile.name} | {profile.versions} | {shipped} | {known} |"


def _aliases() -> Iterator[str]:
    yield "| `--profile` | profiles |"
    yield "|---|---|"
    for alias, names in ALIASES.items():
        yield f"| `{alias}` | {', '.join(names)} |"


def _of(group: str) -> Iterator[str]:
    """A row for each peculiarity and value: what it is about, what is done, who does it and how that is known."""
    yield "| about | what is done | by whom |"
    yield "|---|---|---|"
    notes = []
    for name, quirk in QUIRKS.items():
        if GROUP[name] != group:
            continue
        sources = [quirk.clause.removeprefix(f"{SPEC.title}, "), *({quirk.oracle} - {_ASKED})]
        about = f"**{quirk.what}** (`{name}`; {'; '.join(sources)})"
        by_answer: dict[str, list[Profile]] = {}
        for profile in VARIANTS.values():
            by_answer.setdefault(answer(name, profile), []).append(profile)
        for told, alike in by_answer.items():
            yield f"| {about} | {inflected(told, several=False)} | {'; '.join(_whom(name, alike))} |"
            about = ""
        if quirk.note:
            notes.append(f"- `{name}`: {quirk.note}")
    yield from ["", *notes] if notes else []


def _whom(name: str, alike: list[Profile]) -> Iterator[str]:
    """Those that do the same, together where it is known in one way: `Fast DDS (T)`, `fastdds-2.6 (M)`."""
    by_letter: dict[str, list[Profile]] = {}
    for profile in alike:
        letter = "" if profile is SPEC else _LETTERS[QUIRKS[name].known(profile)]
        by_letter.setdefault(letter, []).append(profile)
    for letter, known in by_letter.items():
        told = _known(name, known[0])
        named = sharing(known, lambda each, told=told: _known(name, each) == told)  # type: ignore[misc]
        yield ", ".join(_NAMES.get(each, each) for each in named) + (f" ({letter})" if letter else "")


def _known(name: str, profile: Profile) -> tuple[str, str]:
    return answer(name, profile), QUIRKS[name].known(profile)


def main() -> int:
    """Write or compare; return 1 where `--check` finds another text."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing, say whether the page is current")
    check = parser.parse_args().check
    there = PAGE.read_text("utf-8")
    if (wanted := page(there)) == there:
        return 0
    if check:
        print("docs/profiles.md is not what tools/profile_page.py writes")
        return 1
    PAGE.write_text(wanted, "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
