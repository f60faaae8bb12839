"""KA6: what implementations read and order in their own ways, whether anything follows from it today or not."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from keystore_audit.findings import Severity
from keystore_audit.grouped import grouped
from keystore_audit.keystore.document import Text
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.divergence.substitution import Cause
from keystore_audit.model.matching.expression import parse
from keystore_audit.model.validity import read_date
from keystore_audit.profiles import TESTED_ON, DateReading, Profile, contrasted, facts, implementations
from keystore_audit.rules.divergence import MEASURED, said, spoken_of
from keystore_audit.rules.registry import Context, Violation, more_like, quoted, rule
from keystore_audit.rules.remedies import in_permissions
from keystore_audit.rules.subjects import DocumentUse, GovernanceUse, PermissionsUse, instant_of, speaks, taken

_NO_DENIAL: Final = (
    "Remove the deny rule, and name the needed topics and partitions in the allow rules; every implementation denies "
    "what no rule allows"
)


@rule(
    "KA604",
    Severity.MEDIUM,
    f"DDS-Security 1.1, 9.4.1.3.2.3 (partitions of a criterion); {MEASURED}",
    in_permissions(_NO_DENIAL),
)
def deny_rule_with_partitions(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A deny rule lists partitions, and Fast DDS denies its topics in every partition.

    Later rules for other partitions are never reached.
    """
    yield from said(context, Cause.DENY_IN_PARTITION)


@rule(
    "KA605",
    Severity.MEDIUM,
    f"DDS-Security 1.1, 9.4.1.3.2.3 (a deny rule without partitions denies in all); {MEASURED}",
    in_permissions(_NO_DENIAL),
)
def deny_rule_without_partitions(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A deny rule lists no partitions: the specification denies in all, Cyclone DDS only in the default partition.

    A later rule that allows the topic in a partition then counts there. ROS 2 nodes use the default partition, but
    whoever controls a node chooses.
    """
    yield from said(context, Cause.DENY_WITHOUT_PARTITION)


@rule(
    "KA606",
    Severity.MEDIUM,
    f"DDS-Security 1.1, 9.4.1.3.2.3 (partitions of a criterion); {MEASURED}",
    in_permissions("Give each set of partitions its own <allow_rule>"),
)
def partitions_of_several_criteria(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """An allow rule has several criteria with partitions: Fast DDS allows the topics of each in those of all.

    Peers on Fast DDS accept it too, so what was meant for one partition reaches another.
    """
    yield from said(context, Cause.CROSSED_PARTITIONS)


@rule(
    "KA607",
    Severity.MEDIUM,
    f"DDS-Security 1.1, 9.4.1.3 (rules in order); {MEASURED}",
    in_permissions("List a topic in one rule, with all its partitions"),
)
def later_rule_for_other_partitions(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Two rules list a topic in different partitions, and Fast DDS stops at the first.

    Once a rule lists the topic, in any partition, Fast DDS asks no later one; others do.
    """
    yield from said(context, Cause.FINAL_RULE)


@rule(
    "KA608",
    Severity.MEDIUM,
    f"DDS-Security 1.1, 9.4.1.3 (deny_rule); {MEASURED}",
    in_permissions(_NO_DENIAL),
)
def deny_rule_blocks_topic(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A deny rule for one operation, or one partition, takes the whole topic away on Cyclone DDS 0.10.

    With read and write access control on, the first rule that lists a topic decides whether it is created: denying
    publish denies subscribe. Cyclone DDS 11 does it right.
    """
    yield from said(context, Cause.TOPIC_DENIED)


_RELAY: Final = f"Implementations read <relay> differently ({contrasted('relay')})"


@rule(
    "KA609",
    Severity.MEDIUM,
    f"DDS-Security 1.1, 9.4.1.3.2.3 (relay); {facts.RELAY_MEASURED}",
    in_permissions("Remove the <relay> criteria; no ROS 2 implementation relays"),
)
def relay_read_differently(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A rule is about relaying: on Fast DDS, peers then send a reader plain data, as to a subscriber.

    High if that lets somebody read. Cyclone DDS and OpenDDS ignore the element, so nothing relays there.
    """
    yield from said(context, Cause.RELAY, _RELAY)


@rule(
    "KA610",
    Severity.MEDIUM,
    f"DDS-Security 1.1, 9.4.1.2.6 and 9.4.1.3.2.3 (expressions as of POSIX fnmatch); {facts.EXPRESSIONS_MEASURED}",
    in_permissions("Name each topic, or use one * at the end and neither brackets nor backslashes"),
)
def expression_read_differently(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """An expression matches names under one implementation that it does not match under another.

    Brackets with ^, classes or a ] first, and backslashes, are read in four ways. The sets of all names are compared,
    not the text. Names beyond ASCII are matched by character here, and by octet on Cyclone DDS.
    """
    yield from said(context, Cause.EXPRESSION, "An expression matches different names")


_MAY_BE_MALFORMED: Final = frozenset("[\\")


def _expressions(use: DocumentUse, but: frozenset[int | None]) -> Iterator[Text]:
    """Every expression of the document, except those of rules at the lines `but`."""
    if isinstance(use, GovernanceUse):
        for domain_rule in use.document.domain_rules:
            yield from (topic.expression for topic in domain_rule.topic_rules if topic.line not in but)
    if isinstance(use, PermissionsUse):
        for grant in use.document.grants:
            for permission_rule in grant.rules:
                for criterion in permission_rule.criteria if permission_rule.line not in but else ():
                    yield from criterion.topics
                    yield from criterion.partitions or ()


def _faults(text: str, profiles: tuple[Profile, ...]) -> str:
    """What is wrong with an expression, and to whom; empty where nothing is."""
    if _MAY_BE_MALFORMED.isdisjoint(text):
        return ""
    faults: dict[str, list[Profile]] = {}
    for profile in profiles:
        fault = parse(text, profile.access.matcher).malformed
        if fault is not None:
            faults.setdefault(fault, []).append(profile)
    said: dict[str, str] = {}  # by what is wrong: to whom it means what
    for fault, who in faults.items():
        what, comma, follows = fault.partition(", ")
        begun = said.get(what, "")
        said[what] = f"{begun}{' and ' if begun else comma}{follows} ({implementations(who)})"
    return "; ".join(f"{what}{whom}" for what, whom in said.items())


@rule(
    "KA611",
    Severity.LOW,
    "DDS-Security 1.1, 9.4.1.2.6 and 9.4.1.3.2.3; POSIX 1003.1, 2.13.1 (bracket expressions)",
    in_permissions("Close each [, or name each topic"),
    applies=taken,
)
def expression_malformed(use: DocumentUse, context: Context) -> Iterator[Violation]:
    """An expression is no pattern for an implementation, which still gives it a meaning.

    Every decision here uses that meaning; the author may have had another in mind. If implementations decide
    differently because of it, see expression-read-differently.
    """
    malformed: dict[str, Text] = {}
    for expression in _expressions(use, spoken_of(use, context, Cause.EXPRESSION)):
        if expression.text not in malformed and _faults(expression.text, context.profiles):
            malformed[expression.text] = expression
    if malformed:
        texts = list(malformed)
        yield Violation(
            f"The expression {quoted(texts[0])}{more_like(texts)} {_faults(texts[0], context.profiles)}.",
            [use.at(each.line) for each in malformed.values()],
            key="\n".join(sorted(malformed)),
        )


def _reading(date: Text, reading: DateReading) -> object:
    """What an implementation takes a date for, to the second, on a robot that is set to UTC."""
    dated = read_date(date.text, reading, None)
    if dated is None:
        return "nothing, and it refuses the document"
    return dated.instant.replace(microsecond=0) if dated.readable else "long past"


@rule(
    "KA613",
    Severity.LOW,
    f"DDS-Security 1.1, 9.4.1.3.2.2 (validity, xs:dateTime); measured on {TESTED_ON}",
    in_permissions("Write dates as 2026-01-31T00:00:00, in UTC and without a zone, until 2262"),
    applies=speaks,
    stops=True,
)
def date_not_portable(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """A date of a grant names different instants to different implementations, even on robots that are set to UTC.

    Fast DDS ignores the zone that a date names. Cyclone DDS takes years beyond 2262 and zones beyond 12 hours for long
    past. If that decides something now, see date-read-differently. For dates that are invalid to the specification, see
    permissions-ambiguous.
    """
    spoken = spoken_of(use, context, Cause.DATE)
    odd: dict[str, Text] = {}
    readings = grouped(context.profiles, lambda profile: profile.access.dates)
    for grant in use.document.grants:
        for date in (grant.not_before, grant.not_after):
            taken = {_reading(date, reading) for reading in readings}
            if len(taken) > 1 and date.line not in spoken and instant_of(date) is not None:
                odd.setdefault(date.text, date)
    for date in odd.values():
        says = "; ".join(f"{_words(date, reading)} to {implementations(who)}" for reading, who in readings.items())
        yield Violation(
            f"The date {quoted(date.text)} is {says}.",
            (use.at(date.line),),
            key=date.text,
        )


def _words(date: Text, reading: DateReading) -> str:
    taken = read_date(date.text, reading, None)
    if taken is None:
        return "no date, so that the document is refused,"
    if not taken.readable:
        return "long past"
    shown = taken.instant.replace(tzinfo=None).isoformat(timespec="seconds")
    return f"{shown} in the robot's zone" if taken.local else f"{shown}Z"
