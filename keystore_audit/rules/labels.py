"""KA742: what has one label reaches what has another, and the lattice of the settings lets nothing through."""

from __future__ import annotations

from collections.abc import Iterator

from keystore_audit.dataclass import replace
from keystore_audit.findings import Severity
from keystore_audit.properties.label_result import LabelResult
from keystore_audit.rules.asserted import breach
from keystore_audit.rules.context import Context
from keystore_audit.rules.formal import steps, violated
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.wording import quoted


@rule(
    "KA742",
    "label-flow-violated",
    Severity.HIGH,
    on=LabelResult,
    clause="keystore-audit, docs/settings.md: the lattice and the labels in keystore-audit.toml",
    remedy="Change what lets it through at one of the lines named, or declare who is trusted to pass it on.",
)
def label_flow_violated(result: LabelResult, context: Context) -> Iterator[Violation]:
    """What has one label can reach what has another, though the lattice of the settings lets nothing through there.

    One finding for each two labels, with the shortest way; others between the same labels may remain. The severity is
    the one that the lattice gives, high where it gives none (Denning, A lattice model of secure information flow).
    """
    found = violated(result)
    if found is None:
        return
    profiles, example = found
    said = f": {example.text}" if example else "."
    yield Violation(
        message=f"What is labelled {quoted(result.source)} can reach what is labelled {quoted(result.target)}{said}",
        locations=(replace(result.location, message="the lattice"), *(steps(example) if example else ())),
        severity=result.severity,
        profiles=profiles,
        key=f"{result.prop.id}\0{result.meaning}\0{breach(result.breaches, context)}",
        properties=(result.prop.id,),
    )
