"""Which violated property is told under which finding: once, as what follows from its cause."""

from __future__ import annotations

from collections.abc import Sequence

from keystore_audit.findings import Finding
from keystore_audit.properties.property import Status
from keystore_audit.properties.result import PropertyResult


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
        self._hanging: set[str] = set()
        for finding in shown:
            causes = [cause for cause in finding.explained_by if cause in order]
            if causes and not finding.suppressed:
                self._under.setdefault(min(causes, key=order.__getitem__), []).append(finding)
                self._hanging.add(finding.fingerprint)

    def told_elsewhere(self, finding: Finding) -> bool:
        """Whether `finding` appears under another one."""
        return finding.fingerprint in self._hanging

    def of(self, finding: Finding) -> tuple[tuple[Finding, str], ...]:
        """The findings that `finding` explains, each with an example in words."""
        below = self._under.get(finding.fingerprint, ())
        return tuple((consequence, self._example(consequence)) for consequence in below)

    def rank(self, finding: Finding) -> int:
        """How early `finding` is shown: as early as the worst that hangs under it."""
        told = [finding, *self._under.get(finding.fingerprint, [])]
        return min(each.severity.rank for each in told)

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
