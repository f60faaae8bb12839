"""The properties: which hold, and of each that is violated how that can be seen, in words and lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from keystore_audit.properties.counterexample import Counterexample, Step
from keystore_audit.properties.property import Status
from keystore_audit.properties.result import ProfileResult, PropertyResult
from keystore_audit.report.content import STATUSES
from keystore_audit.report.html.element import NOTHING, Html, element, folded, joined, lines, name, place
from keystore_audit.report.html.sheet import Sheet, status
from keystore_audit.report.paragraph import worst_first
from keystore_audit.text import counted, shorten

MAX_STEPS: Final = 30
"""Steps of one counterexample."""

MAX_TEXT: Final = 2000
"""Characters of a counterexample's sentence."""


def properties(sheet: Sheet) -> Html:
    """Return every property; those that do not hold with their counterexamples, the others in one line each."""
    results = sheet.report.properties
    if not results:
        return element("p", "No property was decided.", class_="soft")
    failed = [result for result in results if result.status is not Status.HOLDS]
    failed.sort(key=lambda result: STATUSES.index(result.status))
    parts = [_failed(sheet, result) for result in failed]
    holding = [result for result in results if result.status is Status.HOLDS]
    if holding:
        rows = [element("li", status(Status.HOLDS), _statement(result)) for result in holding]
        held = folded(
            joined(
                [element("strong", f"{counted(len(holding), 'property', 'properties')} that hold"), _engines(holding)]
            ),
            element("ul", lines(rows), class_="holding"),
            open_=not failed,
            class_="findings",
        )
        parts.append(held)
    return joined(parts)


def _statement(result: PropertyResult) -> Html:
    identity = element("span", result.prop.id, class_="identity")
    return joined([" ", shorten(result.prop.statement, MAX_TEXT), " ", identity, *_beside(result)])


def _beside(result: PropertyResult) -> list[Html]:
    return [element("p", shorten(result.beside, MAX_TEXT), class_="under")] if result.beside else []


def _engines(results: Sequence[PropertyResult]) -> Html:
    """Which engines decided them all."""
    deciding = dict.fromkeys(
        engine for result in results for answer in result.profiles.values() for engine in answer.engines
    )
    return element("span", f"decided by {' and '.join(deciding)}", class_="soft") if deciding else NOTHING


def _failed(sheet: Sheet, result: PropertyResult) -> Html:
    answers = worst_first(result.profiles, lambda each: (frozenset(each.engines.items()), each.counterexample))
    body = [_answer(sheet, answer, names, len(answers)) for answer, names in answers]
    title = joined([status(result.status), element("strong", shorten(result.prop.statement, MAX_TEXT))])
    identity = element("p", result.prop.id, class_="identity")
    return folded(
        title, element("div", identity, lines([*body, *_beside(result)]), class_="rule"), open_=True, class_="findings"
    )


def _answer(sheet: Sheet, answer: ProfileResult, names: Sequence[str], groups: int) -> Html:
    """One answer, and for whom it is."""
    parts: list[Html] = []
    if groups > 1:
        under = sheet.under(tuple(names)) or "under every profile"
        parts.append(element("p", status(answer.status), " ", under, class_="under"))
    if len(set(answer.engines.values())) > 1:
        said = ", ".join(f"{engine} says {each.value}" for engine, each in answer.engines.items())
        parts.append(element("p", f"The engines disagree: {said}.", class_="under"))
    if answer.counterexample is not None:
        parts += _told(answer.counterexample)
    return element("article", joined(parts))


def _told(counterexample: Counterexample) -> list[Html]:
    steps = [element("li", _step(step)) for step in counterexample.steps[:MAX_STEPS]]
    if len(counterexample.steps) > MAX_STEPS:
        steps.append(element("li", f"and {len(counterexample.steps) - MAX_STEPS} more", class_="soft"))
    told = [element("p", shorten(counterexample.text, MAX_TEXT))]
    return [*told, element("ol", lines(steps), class_="steps")] if steps else told


def _step(step: Step) -> Html:
    parts: list[Html | str] = []
    if step.enclave is not None:
        parts += [element("span", name(step.enclave), class_="who")]
    parts.append(shorten(step.channel or step.witness, MAX_TEXT))
    if step.path is not None:
        parts += [" ", place(step.path, step.line)]
    return joined(parts)
