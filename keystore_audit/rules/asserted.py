"""KA740 to KA742: what users assert of their keystore, in keystore-audit.toml and in Alloy."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from msgspec.structs import replace

from keystore_audit.findings import Severity
from keystore_audit.model.formal.system import System
from keystore_audit.properties.result import AlloyResult, AssertedResult, LabelResult, UserResult
from keystore_audit.remedy import decision
from keystore_audit.rules.context import Context
from keystore_audit.rules.formal import steps, violated
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.wording import quoted


@rule(
    "KA740",
    Severity.HIGH,
    clause="keystore-audit, docs/settings.md: what is asserted in keystore-audit.toml",
    remedy=decision(
        "Change what lets it through at one of the lines named (or give what `able` lacks), or change what is asserted."
    ),
)
def asserted_property_violated(result: AssertedResult, context: Context) -> Iterator[Violation]:
    """A property that the settings assert is violated, with the shortest way found.

    The severity is the one given there, high where none is. A flow is the absence or presence of explicit flows over
    topics, whatever the nodes do; timing, acknowledgements and matching are not in it.
    """
    yield from _violated(result, result.breaches, context, partial(_told, result))


@rule(
    "KA741",
    Severity.HIGH,
    clause="keystore-audit, docs/alloy-properties.md: what is asserted with --alloy-property",
    remedy=decision(
        "Look at the places named; `keystore-audit model KEYSTORE -o DIR --alloy-property FILE` writes all "
        "of it for the Analyzer's window."
    ),
)
def asserted_alloy_property_violated(result: AlloyResult, context: Context) -> Iterator[Violation]:
    """A property that a user asserts in Alloy is violated: a check has a counterexample, or a run no instance.

    Alloy alone decides it: no second engine has checked the answer, and what the file says is taken at its word. The
    severity is the one given there, high where none is.
    """
    yield from _violated(result, None, context, partial(_told, result))


def _told(result: UserResult, example: str) -> str:
    said = f"{quoted(result.prop.id)} is violated. Asserted: {result.prop.statement}"
    return " ".join(filter(None, (said, f"Found: {example}" if example else "", result.beside)))


@rule(
    "KA742",
    Severity.HIGH,
    clause="keystore-audit, docs/settings.md: the lattice and the labels in keystore-audit.toml",
    remedy=decision("Change what lets it through at one of the lines named, or declare who is trusted to pass it on."),
)
def label_flow_violated(result: LabelResult, context: Context) -> Iterator[Violation]:
    """What has one label can reach what has another, though the lattice of the settings lets nothing through there.

    One finding for each two labels, with the shortest way; others between the same labels may remain. The severity is
    the one that the lattice gives, high where it gives none (Denning, A lattice model of secure information flow).
    """
    flow = f"What is labelled {quoted(result.source)} can reach what is labelled {quoted(result.target)}"
    yield from _violated(
        result, result.breaches, context, lambda example: f"{flow}: {example}" if example else f"{flow}.", "the lattice"
    )


def _violated(
    result: UserResult,
    breaches: tuple[str, ...] | None,
    context: Context,
    says: Callable[[str], str],
    where: str = "asserted here",
) -> Iterator[Violation]:
    """A violation where it does not hold under some profile, with an example."""
    found = violated(result)
    if found is None:
        return
    profiles, example = found
    yield Violation(
        message=says(example.text if example else ""),
        locations=(replace(result.location, message=where), *(steps(example) if example else ())),
        severity=result.severity,
        profiles=profiles,
        key=f"{result.prop.id}\0{result.meaning}\0{breach(breaches, context)}",
        contents=False,
        properties=(result.prop.id,),
    )


def breach(breaches: tuple[str, ...] | None, context: Context) -> str:
    """What somebody accepts who accepts the violation: all that violates the property now, else the whole keystore.

    An example is told, and another one may be worse; so nobody accepts a property's violation whatever comes. The whole
    is the keystore between two of its dates, and the nodes that graphs, launch files and policies have in it.
    """
    if breaches is not None:
        return "\0".join(breaches)
    return f"{context.keystore.digest}\0{[(each.now, [*_wired(each)]) for each in context.meaning.systems]}"


def _wired(system: System) -> Iterator[tuple[object, ...]]:
    """What each node is, and what it is to use."""
    for node in system.nodes:
        used = ((system.channels[number] for number in sorted(each)) for each in (node.publishes, node.subscribes))
        yield node.label, node.enclave, *([(c.domain, c.topic, c.partition) for c in channels] for channels in used)
