"""Which violated property is told under which finding: once, as what follows from its cause."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from keystore_audit.findings import Finding
from keystore_audit.properties.property import Status
from keystore_audit.properties.result import PropertyResult


class Consequences:
    """The findings that `explained_by` hangs under others, for every format that people read.

    `present` in each method are the fingerprints of the findings that the format shows at all: a violated
    property whose causes are all hidden (`--min-severity`), accepted or unknown is told by itself, so that it
    never disappears.
    """

    def __init__(self, findings: Sequence[Finding], properties: Sequence[PropertyResult]) -> None:
        """Index the findings by their causes, in the report's order."""
        self._causes = frozenset(finding.fingerprint for finding in findings if finding.suppressed is None)
        self._results = {result.prop.id: result for result in properties}
        self._by_cause: dict[str, list[Finding]] = {}
        for finding in findings:
            for cause in finding.explained_by:
                self._by_cause.setdefault(cause, []).append(finding)

    def told_elsewhere(self, finding: Finding, present: frozenset[str]) -> bool:
        """Whether `finding` appears under one that is shown."""
        return any(cause in present and cause in self._causes for cause in finding.explained_by)

    def of(self, finding: Finding, present: frozenset[str]) -> Iterable[tuple[Finding, str]]:
        """The shown, unaccepted findings that `finding` explains, each with an example in words."""
        for consequence in self._by_cause.get(finding.fingerprint, ()):
            if consequence.fingerprint in present and consequence.suppressed is None:
                yield consequence, self._example(consequence)

    def rank(self, finding: Finding, present: frozenset[str]) -> int:
        """How early `finding` is shown: as early as the worst that hangs under it."""
        below = (consequence.severity.rank for consequence, _ in self.of(finding, present))
        return min((finding.severity.rank, *below))

    def _example(self, finding: Finding) -> str:
        """The counterexample under a profile that the finding holds for, else the finding's own words."""
        result = self._results.get(finding.name)
        for name, answer in result.profiles.items() if result else ():
            wanted = not finding.profiles or name in finding.profiles
            if wanted and answer.status is Status.VIOLATED and answer.counterexample is not None:
                return answer.counterexample.text
        return finding.message
