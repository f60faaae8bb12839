"""What is told where: a violated property under its cause, and of enclaves of which the same is to be said, one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Final

from keystore_audit.findings import OF_THE_AUDIT, Finding, Severity
from keystore_audit.properties.property import Status
from keystore_audit.properties.result import PropertyResult

_COMMON_WORD: Final = re.compile("[A-Z][a-z]* (?!DDS)")
"""What a sentence begins with, unless it is a name such as Fast DDS or CN=/talker."""

_Words = tuple[str, Severity, tuple[str, ...], tuple[str, ...], str]
"""What is told of a finding but its places: of private keys of one mode and copies of one document the same."""


def within(sentence: str) -> str:
    """The sentence as a part of another: its first word begins small, unless it is a name."""
    return sentence[:1].lower() + sentence[1:] if _COMMON_WORD.match(sentence) else sentence


class Consequences:
    """The findings that `explained_by` hangs under others, for every format that people read.

    Each hangs under the first of its causes that the format shows: one whose causes are all hidden
    (`--min-severity`), accepted or unknown is told by itself, so that it never disappears.
    """

    def __init__(self, shown: Sequence[Finding], properties: Sequence[PropertyResult]) -> None:
        """Find the place of each finding among those `shown`, which come in the report's order, worst first."""
        self._results = {result.prop.id: result for result in properties}
        order = {
            finding.fingerprint: place
            for place, finding in enumerate(shown)
            if not finding.suppressed and not finding.explained_by  # two that explain each other would vanish
        }
        self._under: dict[str, list[Finding]] = {}
        told: list[Finding] = []
        for finding in shown:
            causes = [cause for cause in finding.explained_by if cause in order]
            if finding.suppressed is None and causes:
                self._under.setdefault(min(causes, key=order.__getitem__), []).append(finding)
            elif finding.suppressed is None:
                told.append(finding)
        self.told: Final = tuple(sorted(told, key=self.rank))
        """Those that are told by themselves, worst first, else in the report's order."""

    def of(self, finding: Finding) -> tuple[tuple[Finding, str], ...]:
        """The findings that `finding` explains, each with an example in words."""
        below = self._under.get(finding.fingerprint, ())
        return tuple((consequence, self._example(consequence)) for consequence in below)

    def so(self, finding: Finding) -> tuple[tuple[Severity, str], ...]:
        """The same, each in one sentence behind its severity."""
        return tuple(
            (each.severity, f"{each.code}: property {each.name} is violated, e.g. {within(example)}")
            for each, example in self.of(finding)
        )

    def alike(self, findings: Iterable[Finding]) -> dict[str, list[Finding]]:
        """By its fingerprint, each finding that is told, with those that say the same of another enclave."""
        also: dict[str, list[Finding]] = {}
        told: dict[_Words, str] = {}
        for finding in findings:
            words = finding.code, finding.severity, finding.profiles, _of_any(finding), finding.remedy
            if finding.enclave and words in told and finding.fingerprint not in self._under:
                also[told[words]].append(finding)
            else:
                also.setdefault(finding.fingerprint, [])
                if finding.enclave:
                    told.setdefault(words, finding.fingerprint)
        return also

    def rank(self, finding: Finding) -> tuple[int, bool]:
        """How early `finding` is shown: as the worst that hangs under it, and causes before what they leave open."""
        told = [finding, *self._under.get(finding.fingerprint, [])]
        return min(each.severity.rank for each in told), finding.code.startswith(OF_THE_AUDIT)

    def is_example(self, finding: Finding) -> bool:
        """Whether `finding` tells one way in which a property is violated, of perhaps many."""
        result = self._results.get(finding.name)
        return result is not None and any(each.counterexample is not None for each in result.profiles.values())

    def _example(self, finding: Finding) -> str:
        """The counterexample under a profile that the finding holds for, else the finding's own words."""
        result = self._results.get(finding.name)
        for name, answer in result.profiles.items() if result else ():
            wanted = not finding.profiles or name in finding.profiles
            if wanted and answer.status is Status.VIOLATED and answer.counterexample is not None:
                return answer.counterexample.text
        return finding.message


def _of_any(finding: Finding) -> tuple[str, ...]:
    """The message around the enclave's name: a word in its place might be a name, too."""
    return tuple(finding.message.split(finding.enclave)) if finding.enclave else (finding.message,)
