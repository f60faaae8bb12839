"""All that is known beside the causes, for people who asked for it: one section each, in full."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Final

from msgspec.structs import replace

from keystore_audit.findings import Outcomes, Result
from keystore_audit.grouped import grouped
from keystore_audit.model.question import Usability
from keystore_audit.properties.result import ProfileResult, PropertyResult, Status
from keystore_audit.report.content import EnclaveEntry, Report, Verdict, none_here
from keystore_audit.report.page import Page, by_answer, worst_first
from keystore_audit.report.view_model import (
    ENGINE_WORDS,
    HOW,
    assumed,
    declaring,
    nodes_beside,
    sentence,
    starting,
    until,
)
from keystore_audit.text import counted, instant, some
from keystore_audit.truth import Truth

if TYPE_CHECKING:
    from keystore_audit.model.blast_radius import Ranked, Ranking

MAX_ENCLAVES: Final = 20
"""Enclaves listed by name where all is well; those that cannot start are always named."""

MAX_RANKED: Final = 5
"""Enclaves of a ranking that are listed; `flow --from-compromised` tells all of one."""

COLUMN: Final = 13
"""Where the text of labelled lines begins."""

UNCHANGED: Final = "No date on these files changes this answer."

_STATUS_STYLE: Final = {Status.HOLDS: "green", Status.VIOLATED: "bold red", Status.UNKNOWN: "bold yellow"}
_STARTS: Final = {
    Truth.YES: "a DDS participant starts",
    Truth.NO: "CANNOT START",
    Truth.UNKNOWN: "UNKNOWN whether it can start,",
}


def put_details(page: Page, report: Report) -> None:
    """Add the sections."""
    _enclaves(page, report)
    if beside := nodes_beside(report.findings):
        page.put(beside, indent=2)
    _properties(page, report.properties)
    _authorities(page, report)
    _rankings(page, report.blast_radius or ())
    _outcomes(page, report.outcomes)
    page.blank()
    put_rows(page, "Assumed", assumed(report))
    _checked(page, report)


def put_rows(page: Page, label: str, said: Iterable[str]) -> None:
    """Add paragraphs beside one label."""
    for number, each in enumerate(said):
        page.labelled("" if number else label, each, column=COLUMN, style="bold")


def _title(page: Page, title: str) -> None:
    page.blank()
    page.put((title, "bold underline"))


def _enclaves(page: Page, report: Report) -> None:
    """Who can start: those that cannot by their reasons, the others in one line."""
    if not report.enclaves:
        return
    _title(page, "Enclaves")
    well, refused = starting(report)
    for same, alike in grouped(refused, _own_words).items():
        entry, several = alike[0], len(alike) > 1
        paths = ", ".join(each.path for each in alike)
        page.put((paths, "bold"), "" if several else f"  ({entry.directory})", indent=2)
        for usability, names in by_answer(dict(same) if several else entry.profiles).items():
            reasons = "; ".join(reason.rstrip(".") for reason in usability.reasons)
            under = "all profiles" if len(names) == len(same) else ", ".join(names)
            page.put(f"{_STARTS[usability.usable]} under {under}{reasons and f': {reasons}'}.", indent=4)
    if well:
        paths = some((entry.path for entry in well), MAX_ENCLAVES)
        page.put(f"{paths}: a DDS participant starts under all profiles.", indent=2)


def _own_words(entry: EnclaveEntry) -> tuple[tuple[str, Usability], ...]:
    """Whether it starts, as it would be said of any other enclave for which the same is so."""
    own = entry.subject or entry.path
    return tuple(
        (name, replace(use, reasons=tuple(reason.replace(own, "its identity") for reason in use.reasons)))
        for name, use in entry.profiles.items()
    )


def _properties(page: Page, results: Sequence[PropertyResult]) -> None:
    """One line a property and answer: equal answers of several profiles are one."""
    if not results:
        return
    _title(page, "Properties")
    column = 14 + max(len(result.prop.id) for result in results)
    for result in results:
        groups = worst_first(result.profiles, lambda each: _engines(each) + _needs(each))
        for answer, names in groups:
            status = answer.status
            holds = status is Status.HOLDS
            label = f"{status.value if holds else status.value.upper():<10}{result.prop.id}"
            whose = ", all profiles" if len(groups) == 1 else ", all others" if names is groups[-1][1] else ""
            told = f"{_engines(answer)}{whose}{_needs(answer)}"
            page.labelled(label, told, indent=2, column=column, style=_STATUS_STYLE[status])
            if not whose:
                page.put(f"under {', '.join(names)}", indent=12)
        if result.beside:
            page.put(result.beside, indent=12)


def _needs(answer: ProfileResult) -> str:
    """What it needs to hold, and what not."""
    sets = (("if", answer.needs), ("survives without", answer.survives_without))
    return "".join(f"; {word} {', '.join(each.value for each in names)}" for word, names in sets if names)


def _engines(answer: ProfileResult) -> str:
    """Who gave it; where they do not agree, what each says."""
    each = (f"{engine} says {status.value}" for engine, status in answer.engines.items())
    agree = set(answer.engines.values()) <= {answer.status}
    return ", ".join(answer.engines if agree else each) or "no engine"


def _authorities(page: Page, report: Report) -> None:
    """The trusted authorities with their fingerprints; undeclared ones with what declares them."""
    _title(page, f"Authorities, {'declared' if report.authorities_declared else 'as found'}")
    for anchors in report.authorities:
        page.put(f"{anchors.role} CA", "" if anchors.here else f": {none_here(anchors)}", indent=2)
        for each in anchors.here:
            page.put(f"{each.subject}, {each.path}", indent=4)
            page.labelled("certificate", f"sha256:{each.sha256}", indent=4, column=6)
            page.labelled("its key", f"sha256:{each.key}", indent=4, column=6)
    lines = [*declaring(report)]
    for line in [HOW, *lines] if lines else []:
        page.put(line, indent=2)


def _rankings(page: Page, rankings: Sequence[Ranking]) -> None:
    """Whose keys open most: the first of the ranking under most profiles, and of each other one the first alone."""
    page.blank()
    page.put(("Blast radius, what the private key of an enclave opens", "bold"))
    if not rankings:
        page.put("Not worked out here: too many enclaves. The HTML report ranks up to 2,000 of them.", indent=2)
    for place, ranking in enumerate(rankings):
        page.put(f"Under {', '.join(ranking.profiles) if len(rankings) > 1 else 'every profile'}:", indent=2)
        listed = ranking.enclaves[: 1 if place else MAX_RANKED]
        for one in listed:
            page.put(_radius(one), indent=4)
        if more := len(ranking.enclaves) - len(listed):
            page.put(f"and {more} more with no larger one", indent=4)


def _radius(one: Ranked) -> str:
    endless = ", names without end among them" if one.endless else ""
    more = one.enclaves_reached > one.enclaves_reached_alone
    alone = f" ({one.enclaves_reached_alone} while the others stay honest)" if more else ""
    posed = f", passes for {one.passes_for}" if one.passes_for else ""
    topics = f"writes {one.topics_written}, forges {one.topics_forged}, reads {one.topics_read} DDS topics{endless}"
    return f"{one.path}: reaches {counted(one.enclaves_reached, 'enclave')}{alone}{posed}; {topics}"


def _outcomes(page: Page, outcomes: Outcomes) -> None:
    """How often each rule passed, failed, did not apply or stayed open, and what stayed open: equal ones together."""
    _title(page, "Outcomes: of how many subjects, of which rules")
    equal: dict[str, list[str]] = {}
    for rule, each in sorted(grouped(outcomes, lambda outcome: outcome.rule).items()):
        counts = Counter(outcome.outcome for outcome in each)
        names = {result: result.value for result in Result} | {Result.NOT_APPLICABLE: "not applicable"}
        words = ", ".join(f"{counts[result]} {name}" for result, name in names.items() if counts[result])
        opened = ", ".join(outcome.subject for outcome in each if outcome.outcome is Result.OPEN)
        equal.setdefault(words + (opened and f": {opened}"), []).append(rule)
    for words, rules in equal.items():
        page.put((f"{words}: ", "bold"), ", ".join(rules), indent=2)


def _checked(page: Page, report: Report) -> None:
    """What was looked at, by whom, what was not, and when the answer changes by itself."""
    checked = report.checked
    page.blank()
    profiles = ", ".join(report.judged_profiles) or "no profile"
    links = f", links into {', '.join(report.roots)} followed" if report.roots else ""
    looked_at = (
        f"{checked.certificates} certificates, {checked.documents} signed documents, {checked.channels} topic "
        f"channels, with {checked.rules} rules, under {profiles}{links}."
    )
    put_rows(page, "Checked", [looked_at])
    for run in report.engines:
        version = f" {run.version}" if run.version else ""
        reason = f": {run.reason}" if run.reason else ""
        size = f", asked about {run.atoms[1]} of {run.atoms[0]} atoms" if run.atoms else ""
        put_rows(page, "Engine", [sentence(f"{run.name}{version} {ENGINE_WORDS[run.status]}{size}{reason}")])
    put_rows(page, "Not checked", checked.not_checked)
    dates = UNCHANGED
    if report.safe_until is not None:
        holds = "Holds until" if report.verdict is Verdict.PASS else "Changes at"
        dates = f"{holds} {instant(report.safe_until)}: {until(report)}"
    put_rows(page, "Dates", [dates])
