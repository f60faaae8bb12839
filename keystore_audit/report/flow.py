"""The answers of `flow` for people: by attacker or by stolen key, profiles that answer alike together."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

from msgspec.structs import replace

from keystore_audit.assumptions import Needed, holds_if
from keystore_audit.findings import Location
from keystore_audit.grouped import grouped
from keystore_audit.model.blast_radius import BlastRadius, Ground, Topic
from keystore_audit.model.formal.asked import Attacker
from keystore_audit.model.names import PARAMETER_SERVICES, RosKind, parse_dds_name, ros_name
from keystore_audit.model.tables.access_table import Named
from keystore_audit.properties.result import (
    AssertedResult,
    Change,
    CompromiseAnswer,
    Counterexample,
    EngineRun,
    EngineStatus,
    FallResult,
    KeyAnswer,
    ProfileRadius,
    ProfileResult,
    Status,
    Step,
    Stolen,
)
from keystore_audit.report.content import answered_if, conditions_of
from keystore_audit.report.json import encoded, picked, told
from keystore_audit.report.page import by_answer, profiles, rests_on, unbroken, worst_first, wrapped
from keystore_audit.report.routed_answer import APART, ASSUMED
from keystore_audit.text import MAX_EXPRESSION, counted, instant, shorten, some, terminal

_WORDS: Final = {Status.VIOLATED: "FLOW", Status.HOLDS: "no flow", Status.UNKNOWN: "UNKNOWN"}
_ASSUMED: Final = {
    Attacker.HONEST: "nobody attacks; nodes may pass on whatever they read",
    Attacker.SOURCE: "the source attacks with the keys that it holds",
    Attacker.RELAYS: "everybody on the way attacks with the keys that it holds, and so does an outsider",
}
_WHOSE: Final = {
    Stolen.ENCLAVE: "the enclave {}",
    Stolen.IDENTITY_CA: "the identity CA {}",
    Stolen.PERMISSIONS_CA: "the permissions CA {}",
}

MAX_LISTED: Final = 8
"""Names that are listed; the rest are counted."""

_PARAMETERS: Final = tuple(f"/{service}" for service in PARAMETER_SERVICES)


class Told(NamedTuple):
    """What is said of a question, before how it was decided. `sections`: a heading each, and what is told below it.
    `every`: the profiles asked about.
    """

    title: str
    conditions: Sequence[Needed]
    first: Sequence[str]
    sections: Sequence[tuple[str, AssertedResult]]
    every: Collection[str]


def by_attacker(title: str, results: Sequence[tuple[Attacker, AssertedResult]]) -> Told:
    """By who attacks."""
    sections = [(f"If {_ASSUMED[attacker]}", result) for attacker, result in results]
    return Told(title, assumptions(results), (), sections, results[0][1].profiles)


MAX_SHOWN: Final = 3
"""Sets of compromised enclaves that are shown, each with its flow: as many as there are attackers."""


def by_fall(title: str, most: int, every: Sequence[str], falls: Sequence[FallResult], change: Change | None) -> Told:
    """By who is compromised. `most`: how many at most; `every`: the profiles asked about."""
    survived = _survived(most, every, falls)
    first = []
    for number, names in grouped(survived, survived.__getitem__).items():
        whom = f"any {counted(number, 'compromised enclave')}" if number else "while no enclave is compromised"
        first.append(f"Survives {whom}: {profiles(names, every)}.")
    first += _restoring(change)
    sections = [(_together(fallen, result), result) for fallen, result in falls]
    return Told(title, answered_if(survived) if survived else (), first, sections, every)


def _restoring(change: Change | None) -> Iterator[str]:
    """What to take from whom, so that it survives."""
    if change is None:
        return
    if change.take is None:
        yield "No small change of rights restores it."
        return
    took = (f"`{each.expression}` ({each.path}:{each.line}) from {each.enclave}" for each in change.take)
    keeps = f" It keeps what {counted(change.keeps, 'claim')} `able` of the settings held." if change.keeps else ""
    said = f"The smallest change of rights that restores it: take {', and '.join(took)}.{keeps}"
    yield f"{said} What was signed before still counts until it ends."


def _survived(most: int, every: Sequence[str], falls: Sequence[FallResult]) -> dict[str, int]:
    """How many compromised enclaves break nothing, whichever they are, up to `most`; by profile where any number do."""
    fewest = {name: len(fallen) for fallen, result in reversed(falls) for name in result.profiles}
    return {name: fewest.get(name, most + 1) - 1 for name in every if fewest.get(name) != 0}


def _together(fallen: Sequence[str], result: AssertedResult) -> str:
    verb = "may break" if result.status is Status.UNKNOWN else "break" if len(fallen) > 1 else "breaks"
    if not fallen:
        return f"It {verb} with nobody compromised"
    return f"{' and '.join(fallen)} {'together' if len(fallen) > 1 else 'alone'} {verb} it"


def text(
    told: Told, engines: Sequence[EngineRun], doubts: Sequence[Location], *, at: str, ambient: bool, folder: str
) -> str:
    """Lines of 80 columns at most, as far as names allow. `at`: the instant asked about; `folder`: whose files decide,
    where they do.
    """
    lines = [terminal(told.title)]
    if not ambient:
        lines.append("(apart from /clock, /parameter_events, /rosout and ros_discovery_info)")
    if folder:
        lines.append(unbroken(ASSUMED.format(folder)))
    if conditions := holds_if(told.conditions):
        lines.append(unbroken(f"That there is no flow {conditions}."))
    every = {each for _heading, result in told.sections for each in result.survives_without}
    if spared := sorted(every.difference(each.assumption for each in told.conditions)):
        lines.append(unbroken(f"It survives without: {', '.join(each.value for each in spared)}."))
    lines += ["", *map(unbroken, told.first)] if told.first else []
    shown: set[tuple[Step, ...]] = set()
    for heading, result in told.sections[:MAX_SHOWN]:
        lines += ["", unbroken(f"{heading}:"), *answers(result, told.every, _WORDS, shown)]
    if others := [heading for heading, _result in told.sections[MAX_SHOWN:]]:
        lines += ["", unbroken(f"Not shown: {some(others, MAX_LISTED)}.")]
    lines.append("")
    if doubts:
        lines.append(unbroken(rests_on(doubts)))
    if not all(result.engines_agree for _heading, result in told.sections):
        lines.append("The engines disagree, so that it is not decided.")
    lines += deciding(engines)
    later = "dates may change it, and a property with `until` in the settings asks about later days too."
    lines.append(unbroken(f"As of {at}: {later}"))
    return "\n".join(lines) + "\n"


def deciding(engines: Iterable[EngineRun]) -> Iterator[str]:
    """A line for each engine: whether it decided, and why not."""
    for run in engines:
        reason = "" if run.status is EngineStatus.OK else f" ({run.status.value}: {run.reason})"
        yield unbroken(f"{'Not decided' if reason else 'Decided'} by {run.name}{reason}.")


def engines_told(engines: Iterable[EngineRun]) -> dict[str, dict[str, Any]]:
    """What became of each, for JSON."""
    return {run.name: picked(run, "version", "status", "reason") for run in engines}


def answers(
    result: AssertedResult, every: Collection[str], words: Mapping[Status, str], shown: set[tuple[Step, ...]]
) -> Iterator[str]:
    """What is answered under which of `every` profile asked about, and how it is violated, save what is `shown`."""
    for answer, names in worst_first(result.profiles, lambda each: each.counterexample and each.counterexample.text):
        yield unbroken(profiles(names, every), f"  {words.get(answer.status, answer.status.value):<8} ", " " * 11)
        if answer.counterexample is not None:
            yield from path_lines(answer.counterexample, shown, certain=answer.status is Status.VIOLATED)


def path_lines(path: Counterexample, shown: set[tuple[Step, ...]], *, certain: bool) -> list[str]:
    """The way with its lines, these once: a flow without an attack is one with any."""
    lines = [unbroken(path.text if certain else f"Perhaps: {path.text}", " " * 11, " " * 11)]
    if path.steps and path.steps in shown:
        return [*lines, unbroken("by the same lines as above", " " * 13, " " * 15)]
    shown.add(path.steps)
    for step in path.steps:
        if step.path is not None:
            line = "" if step.line is None else f":{step.line}"
            who = f"{step.enclave}, " if step.enclave is not None else ""
            by = f" by {shorten(step.expression, MAX_EXPRESSION)}" if step.expression else ""
            place = f"{step.path}{line}  ({who}{step.witness}{by})"
            lines.append(unbroken(place, " " * 13, " " * 15))
    return lines


def stolen_text(answer: CompromiseAnswer) -> str:
    """What a stolen key opens, by key, profiles that answer alike together."""
    conditions = holds_if(stolen_if(answer))
    lines = [wrapped(f"That it opens no more {conditions}."), ""] if conditions else []
    for key in answer.keys:
        lines += [*_key(answer, key), ""]
    if not answer.keys:
        lines += [wrapped("No certificate of such an authority could be read: what its key opens is unknown."), ""]
    if not answer.include_ambient:
        lines.append(wrapped(APART))
    if answer.status is Status.UNKNOWN and answer.doubts:
        lines.append(wrapped(rests_on(answer.doubts)))
    return "\n".join(lines).rstrip("\n") + "\n"


def _key(answer: CompromiseAnswer, key: KeyAnswer) -> Iterator[str]:
    where = f" ({key.location.path})" if key.location is not None and key.stolen is not Stolen.ENCLAVE else ""
    where += f" ({answer.declared})" if answer.declared else ""
    holder = f"Whoever holds the private key of {_WHOSE[key.stolen].format(key.name)}{where}"
    yield wrapped(f"{holder}{' alone' if key.with_an_enclave is not None else ''}:")
    yield from _profiles(answer, key.alone)
    if key.with_an_enclave is not None:
        yield ""
        yield wrapped("With the private key of an enclave as well, whichever it is:")
        yield from _profiles(answer, key.with_an_enclave)


def _profiles(answer: CompromiseAnswer, by_profile: Mapping[str, ProfileRadius]) -> Iterator[str]:
    for each, names in by_answer(by_profile).items():
        under = f"{'under' if each.certain else 'UNKNOWN, perhaps, under'} {profiles(names, by_profile)}"
        yield wrapped(under, "  ", "    ")
        for line in _said(answer.ground, answer.enclaves, each.radius):
            yield wrapped(line, "    ", "      ")


def _said(ground: Ground, enclaves: int, radius: BlastRadius) -> Iterator[str]:
    """One sentence for each thing it can do."""
    if not (radius.written or radius.forged or radius.read or radius.passes_for or radius.reached):
        yield "can do nothing with it that anybody on the network cannot do without"
        return
    for verb, channels in (
        ("writes {} by right", radius.written),
        ("forges {} more without a right", radius.forged),
        ("reads {}", radius.read),
    ):
        number = ground.count(channels)
        told = verb.format(counted(number, "DDS topic") if number else "no topic")
        yield f"{told}: {_topic_words(ground.topics(channels))}" if number else told
    unmanaged = {enclave.label for system in ground.systems for enclave in system.enclaves if enclave.unmanaged}
    posed, others = sorted(radius.passes_for - unmanaged), sorted(radius.passes_for & unmanaged)
    if posed or not others:
        whom = f"{len(posed)} of {enclaves} enclaves: {some(posed, MAX_LISTED)}" if posed else "no other enclave"
        yield f"passes for {whom}"
    if others:
        yield f"passes for {some(others, MAX_LISTED)}{' too' if posed else ''}"
    if not radius.reached:
        yield "reaches no enclave"
        return
    alone, reached = sorted(radius.reached_alone), sorted(radius.reached)
    honest = f"reaches {len(alone)} of {enclaves} enclaves" if alone else "reaches no enclave"
    honest = f"{honest} while the others stay honest"
    yield f"{honest}: {some(alone, MAX_LISTED)}" if alone else honest
    further = sorted(radius.reached - radius.reached_alone)
    if further:
        yield f"reaches {len(reached)} if all on the way are compromised too: also {some(further, MAX_LISTED)}"


def _topic_words(topics: Iterable[Topic]) -> str:
    """Some of the names, plain topics first, parameter services counted alone; raw text."""
    topics = list(topics)
    others = [topic for topic in topics if not _of_parameters(topic.name)]
    names = sorted(map(_words, others), key=lambda words: (not words.endswith("(topic)"), words))
    listed = some((words.removesuffix(" (topic)") for words in names), MAX_LISTED)
    parameters = len(topics) - len(others)
    return ", and ".join(filter(None, [listed, f"{parameters} of parameter services" if parameters else ""]))


def _of_parameters(name: Named) -> bool:
    parsed = parse_dds_name(name.topic)
    return parsed is not None and parsed.kind is RosKind.SERVICE and parsed.name.endswith(_PARAMETERS)


def _words(topic: Topic) -> str:
    name = ros_name(topic.name.topic)
    inside = f', partition "{topic.name.partition}"' if topic.name.partition else ""
    return f"{f'all names such as {name}' if topic.name.several else name}{inside}"


# The same as JSON: `schemas/flow.schema.json`, `schemas/fallen.schema.json`, and of a stolen key
# `schemas/compromise.schema.json`.


FOUND: Final[Mapping[Status, bool | None]] = {Status.VIOLATED: True, Status.HOLDS: False, Status.UNKNOWN: None}
"""Whether there is a flow, or a key opens anything of somebody else's."""


def json(
    asked: Mapping[str, Any], results: Sequence[tuple[Attacker, AssertedResult]], engines: Iterable[EngineRun]
) -> str:
    """One line; `asked`: the question."""
    document = {
        **asked,
        "engines": engines_told(engines),
        "attackers": {
            attacker: {
                "flow": FOUND[result.status],
                "profiles": {
                    name: {**_answer(answer), **picked(answer, "needs", "survives_without")}
                    for name, answer in result.profiles.items()
                },
            }
            for attacker, result in results
        },
        "assumptions": [each.described for each in assumptions(results)],
    }
    return encoded(document) + "\n"


def falls_json(
    asked: Mapping[str, Any],
    most: int,
    every: Sequence[str],
    falls: Sequence[FallResult],
    engines: Iterable[EngineRun],
    change: Change | None,
) -> str:
    """By profile, which smallest sets of compromised enclaves break it: one line."""
    survived = _survived(most, every, falls)

    document = {
        **asked,
        "compromised": most,
        "engines": engines_told(engines),
        "profiles": {
            name: {
                "survives": survived.get(name),
                "sets": [
                    {"enclaves": fallen, **_answer(result.profiles[name])}
                    for fallen, result in falls
                    if name in result.profiles
                ],
            }
            for name in every
        },
        "take": [each._asdict() for each in change.take] if change is not None and change.take is not None else None,
        "assumptions": [each.described for each in (answered_if(survived) if survived else ())],
    }
    return encoded(document) + "\n"


def assumptions(results: Iterable[tuple[Attacker, AssertedResult]]) -> tuple[Needed, ...]:
    """What it rests on that there is no flow, under the profiles that have none."""
    return conditions_of(
        replace(result, profiles={n: each for n, each in result.profiles.items() if each.status is Status.HOLDS})
        for _attacker, result in results
    )


def _answer(answer: ProfileResult) -> dict[str, Any]:
    return {
        "flow": FOUND[answer.status],
        "engines": {name: FOUND[status] for name, status in answer.engines.items()},
        "path": told(answer.counterexample),
    }


def stolen_json(answer: CompromiseAnswer) -> str:
    """What a stolen key opens: one line."""
    document = {
        "from_compromised": answer.who,
        "include_ambient": answer.include_ambient,
        "at": instant(answer.at),
        "enclaves": answer.enclaves,
        **({"declared": answer.declared} if answer.declared else {}),
        "beyond_itself": FOUND[answer.status],
        "assumptions": [each.described for each in stolen_if(answer)],
        "keys": [_of_key(answer.ground, key) for key in answer.keys],
    }
    return encoded(document) + "\n"


def stolen_if(answer: CompromiseAnswer) -> tuple[Needed, ...]:
    """What it rests on that a key opens no more."""
    return answered_if(dict.fromkeys(name for key in answer.keys for name in key.alone))


def _of_key(ground: Ground, key: KeyAnswer) -> dict[str, Any]:
    def radii(by_profile: Mapping[str, ProfileRadius]) -> dict[str, Any]:
        return {name: _radius(ground, each) for name, each in by_profile.items()}

    return {
        "of": key.stolen,
        "name": key.name,
        "path": key.location and key.location.path,
        "alone": radii(key.alone),
        "with_an_enclave": None if key.with_an_enclave is None else radii(key.with_an_enclave),
    }


def _radius(ground: Ground, each: ProfileRadius) -> dict[str, Any]:
    def topics(channels: int) -> list[dict[str, Any]]:
        found = ground.topics(channels)
        return [{**picked(one.name, "topic", "partition", "several"), "domains": one.domains} for one in found]

    radius = each.radius
    return {
        "certain": each.certain,
        "topics_written": topics(radius.written),
        "topics_forged": topics(radius.forged),
        "topics_read": topics(radius.read),
        "passes_for": sorted(radius.passes_for),
        "enclaves_reached_alone": sorted(radius.reached_alone),
        "enclaves_reached": sorted(radius.reached),
    }
