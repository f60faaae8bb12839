"""Brings the claims that labels make together: one answer about each two labels."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import replace

from keystore_audit.model.claims.stated import Claim, LabelPair
from keystore_audit.properties.property import Status
from keystore_audit.properties.result import AssertedResult, LabelResult, ProfileResult, PropertyResult


def with_label_answers(claims: Sequence[Claim], results: Sequence[AssertedResult]) -> tuple[PropertyResult, ...]:
    """The results, parallel to `claims`, with one in place of all that the same two labels make."""
    pairs: dict[str, tuple[LabelPair, list[AssertedResult]]] = {}
    told: list[PropertyResult] = []
    for claim, result in zip(claims, results, strict=True):
        if claim.labels is None:
            told.append(result)
        else:
            pairs.setdefault(claim.labels.id, (claim.labels, []))[1].append(result)
    return (*told, *(_joint(pair, parts) for pair, parts in pairs.values()))


def _joint(pair: LabelPair, parts: Sequence[AssertedResult]) -> LabelResult:
    """Violated if one part is."""
    first = parts[0]
    return LabelResult(
        prop=replace(first.prop, id=pair.id),
        profiles={name: _worst([part.profiles[name] for part in parts]) for name in first.profiles},
        source=pair.source,
        target=pair.target,
        meaning="\0".join(part.meaning for part in parts),
        severity=first.severity,
        location=first.location,
        breaches=_together([part.breaches for part in parts]),
    )


def _together(parts: Sequence[tuple[str, ...] | None]) -> tuple[str, ...] | None:
    """What violates them; None where that of one is not known."""
    known = [part for part in parts if part is not None]
    return (
        tuple(f"{number}: {each}" for number, part in enumerate(known) for each in part)
        if len(known) == len(parts)
        else None
    )


def _worst(parts: Sequence[ProfileResult]) -> ProfileResult:
    """Of the parts under one profile; where engines contradict each other about one part, that is the answer."""
    disputed = next((part for part in parts if len(set(part.engines.values())) > 1), None)
    if disputed is not None:
        return disputed
    order = (Status.VIOLATED, Status.UNKNOWN, Status.HOLDS)
    status = min((part.status for part in parts), key=order.index)
    alike = [part for part in parts if part.status is status]
    examples = [part.counterexample for part in alike if part.counterexample is not None]
    decided = frozenset.intersection(*(frozenset(part.engines) for part in parts)) or {"native"}
    return ProfileResult(
        status=status,
        engines=dict.fromkeys(sorted(decided), status),
        counterexample=min(examples, key=lambda example: len(example.steps), default=None),
    )
