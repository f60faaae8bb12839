"""What is new of implementations, as a newcomer writes it into a copy: forgotten nowhere, or an error."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tools import profile_page

QUIRKS = "keystore_audit/profiles/quirks.toml"
FIELDS = "keystore_audit/profiles/peculiarities.py"
SEMANTICS = "keystore_audit/model/semantics.py"

ROW = """
[quirk.ignores_deny_rules]
what = "deny rules"
clause = "DDS-Security 1.1, 9.4.1.3 (deny_rule)"
cause = "{cause}"
matters = "{matters}"
read = ["newdds"]
[quirk.ignores_deny_rules.answers]
true = "[passes|pass] them over"
false = "[applies|apply] them"

[family.newdds]
title = "New DDS"

[implementation.newdds]
title = "New DDS 1"
versions = "1.0"
evidence = "read"
family = "newdds"
like = "spec"
ignores_deny_rules = true
"""
OF_SPEC = "[implementation.spec]\n", "[implementation.spec]\nignores_deny_rules = false\n"
FIELD = "    honours_default: bool\n", "    honours_default: bool\n    ignores_deny_rules: bool\n"
HONOURED = (
    "    return tuple(_rules(grant.rules, access, partitions, relay))\n",
    """    rules = tuple(rule for rule in grant.rules if rule.allow or not access.ignores_deny_rules)
    return tuple(_rules(rules, access, partitions, relay))
""",
)
DENIED = "sample_keystores/rules/KA605-deny-rule-without-partitions/bad"
"""A deny rule takes /cmd_vel from the talker, a later rule allows it in the partition lab."""

RELEASE = """
[implementation."fastdds-4.0"]
title = "Fast DDS 4.0"
versions = "4.0.0"
evidence = "read"
like = "fastdds-3.6"
"""
DEFAULT_ALLOW = "sample_keystores/rules/KA509-default-allow/bad"
DENIED_IN_PARTITION = "sample_keystores/rules/KA604-deny-rule-with-partitions/bad"


class Copy:
    """A copy of the package that can be edited, and asked in a process of its own."""

    def __init__(self, folder: Path, repository: Path) -> None:
        self._folder = folder
        self._repository = repository
        shutil.copytree(repository / "keystore_audit", folder / "keystore_audit")
        for name in ("schemas", "alloy", "pyproject.toml"):
            (folder / name).symlink_to(repository / name)
        for name in ("tools/profile_page.py", "docs/profiles.md"):
            (folder / name).parent.mkdir()
            shutil.copy(repository / name, folder / name)

    def edit(self, path: str, change: tuple[str, str] | str) -> None:
        """Replaces a text, or writes one behind the last line."""
        text = (self._folder / path).read_text("utf-8")
        if isinstance(change, str):
            (self._folder / path).write_text(text + change, "utf-8")
            return
        assert text.count(change[0]) == 1, change[0]
        (self._folder / path).write_text(text.replace(*change), "utf-8")

    def python(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, *arguments],
            cwd=self._repository,
            env={"PYTHONPATH": str(self._folder), "PATH": "/usr/bin:/bin"},
            capture_output=True,
            text=True,
            timeout=300,
        )

    def error(self, module: str) -> str:
        """What importing the module says last."""
        done = self.python("-P", "-c", f"import {module}")
        return done.stderr.strip().splitlines()[-1] if done.returncode else ""

    def said(self, *arguments: str) -> str:
        return self.python("-P", "-m", "keystore_audit", *arguments, "--at", "2026-11-21T12:00:00Z").stdout

    def page(self) -> str:
        """The page of profiles that its rows give."""
        assert self.python(str(self._folder / "tools/profile_page.py")).returncode == 0
        return (self._folder / "docs/profiles.md").read_text("utf-8")


@pytest.fixture
def copy(tmp_path: Path, repository: Path) -> Copy:
    return Copy(tmp_path, repository)


def with_switch(copy: Copy, *, matters: str = "always", cause: str = "other") -> None:
    copy.edit(QUIRKS, ROW.format(matters=matters, cause=cause))
    copy.edit(QUIRKS, OF_SPEC)
    copy.edit(FIELDS, FIELD)


@pytest.mark.parametrize("matters", ["always", "as read"])
def test_a_new_peculiarity_that_is_honoured_changes_what_can_says(copy: Copy, matters: str) -> None:
    """It was honoured, and profiles were folded by the peculiarities known before: `can` said that it is denied."""
    with_switch(copy, matters=matters)
    copy.edit(SEMANTICS, HONOURED)
    question = ("can", DENIED, "/talker", "publish", "/cmd_vel", "--partition", "lab")
    assert "deny" in copy.said(*question, "--profile", "spec").lower()
    said = copy.said(*question, "--profile", "newdds", "--profile", "spec").lower()
    assert "allow" in said
    assert "deny" in said
    found = copy.said("audit", DENIED, "--engine", "native", "--profile", "newdds", "--profile", "spec", "-v")
    assert "Implementations decide differently (New DDS passes them over)" in " ".join(found.split())


def test_a_new_peculiarity_is_in_the_page_of_profiles(copy: Copy) -> None:
    with_switch(copy)
    rows = [line.split("|")[2:4] for line in copy.page().splitlines() if "| passes them over |" in line]
    assert rows == [[" passes them over ", " New DDS (R) "]]


def _without_field(copy: Copy) -> None:
    copy.edit(QUIRKS, ROW.format(matters="always", cause="other"))
    copy.edit(QUIRKS, OF_SPEC)


def _without_row(copy: Copy) -> None:
    copy.edit(FIELDS, FIELD)


def _without_values(copy: Copy) -> None:
    copy.edit(QUIRKS, ROW.format(matters="always", cause="other"))
    copy.edit(FIELDS, FIELD)


def _without_sentence(copy: Copy) -> None:
    with_switch(copy)
    copy.edit(QUIRKS, ('true = "[passes|pass] them over"\n', ""))


def _without_cause(copy: Copy) -> None:
    with_switch(copy, cause="")


def _unknown_to_folding(copy: Copy) -> None:
    with_switch(copy, matters="a full moon")


def _unknown_to_divergence(copy: Copy) -> None:
    with_switch(copy, cause="a full moon")


def _misspelt_value(copy: Copy) -> None:
    copy.edit(QUIRKS, RELEASE + "honors_default = true\n")


@pytest.mark.parametrize(
    ("forget", "named"),
    [
        (_without_field, ("quirks.toml", "ignores_deny_rules", "peculiarities.py")),
        (_without_row, ("peculiarities.py", "ignores_deny_rules", "quirks.toml")),
        (_without_values, ("ignores_deny_rules", "spec")),
        (_without_sentence, ("ignores_deny_rules", "sentence", "'true'")),
        (_without_cause, ("ignores_deny_rules", "'cause'")),
        (_unknown_to_folding, ("model.occasions", "ignores_deny_rules", "a full moon")),
        (_unknown_to_divergence, ("model.divergence", "ignores_deny_rules", "a full moon")),
        (_misspelt_value, ("honors_default", "fastdds-4.0")),
    ],
)
def test_what_is_forgotten_is_an_error_at_import(
    copy: Copy, forget: Callable[[Copy], None], named: tuple[str, ...]
) -> None:
    forget(copy)
    error = copy.error("keystore_audit.api")
    assert "TableError" in error
    for word in named:
        assert word in error


def test_a_new_release_is_one_edit(copy: Copy) -> None:
    """Nothing that is told of it is another implementation's: a sentence about Fast DDS was, of its default."""
    copy.edit(QUIRKS, RELEASE + "honours_default = true\n")
    found = " ".join(copy.said("audit", DEFAULT_ALLOW, "--engine", "native", "--profile", "fastdds-4.0", "-v").split())
    assert "whatever no rule denies: <default> is ALLOW" in found
    both = ("--profile", "fastdds-4.0", "--profile", "fastdds-3.6")
    found = " ".join(copy.said("audit", DEFAULT_ALLOW, "--engine", "native", *both, "-v").split())
    assert "on Fast DDS 4.0 clause" in found, "and on no other"
    assert "| fastdds-4.0 | 4.0.0 |  | R |" in copy.page()


def test_who_no_longer_has_a_peculiarity_is_not_named_by_its_family(copy: Copy) -> None:
    copy.edit(QUIRKS, RELEASE + 'partitions = "of-the-criterion"\n')
    both = ("--profile", "spec", "--profile", "fastdds-4.0", "--profile", "fastdds-3.6")
    found = " ".join(copy.said("audit", DENIED_IN_PARTITION, "--engine", "native", *both, "-v").split())
    assert "Fast DDS 3.6 does not look at the partitions of a deny rule" in found
    alone = copy.said("audit", DENIED_IN_PARTITION, "--engine", "native", *both[:4], "-v")
    assert "does not look at the partitions" not in alone


def test_the_page_of_profiles_is_what_the_rows_say() -> None:
    text = profile_page.PAGE.read_text("utf-8")
    assert profile_page.page(text) == text, "run tools/profile_page.py"
