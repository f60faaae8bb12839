"""KA6: what one keystore allows under one implementation and not under another (`model.divergence.find`).

A rule for each cause. What rules about single documents already report of a line is not repeated. These are documents
that an implementation refuses as a whole (KA417, KA420, KA421), a default that allows (KA509) and second grants
(KA504). They are also grants that are not in force (KA503, KA505, KA506), allow nothing (KA514) or only in other
domains (KA508). Ranges with one bound (KA419, KA515) are repeated only where they let somebody do more.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Final

from msgspec.structs import replace

from keystore_audit.findings import Location, Severity, decision
from keystore_audit.grouped import grouped
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.divergence.substitution import Cause
from keystore_audit.model.meaning import Divergence, Example
from keystore_audit.model.names import ros_name
from keystore_audit.model.subjects.told import own_grant
from keystore_audit.profiles import TESTED_ON, VARIANTS, JoinCheck, doing, explained, facts
from keystore_audit.rules.registry import VERBS, Context, Violation, either, listed, located, quoted, rule
from keystore_audit.rules.remedies import ALLOW_DOMAINS, COVER_DOMAIN, in_governance, in_permissions
from keystore_audit.rules.restrictions import meet
from keystore_audit.rules.subjects import DocumentUse

MEASURED: Final = f"measured on {TESTED_ON}; for others see docs/profiles.md"


def _of(context: Context, *causes: Cause) -> Iterator[list[Divergence]]:
    """The divergences of these causes, those of one document together."""
    found = (divergence for divergence in context.meaning.divergences if divergence.cause in causes)
    yield from grouped(found, lambda divergence: divergence.location.path).values()


def spoken_of(use: DocumentUse, context: Context, cause: Cause) -> frozenset[int | None]:
    """The lines of a document of which a divergence of the cause speaks."""
    return frozenset(
        divergence.location.line
        for divergence in context.meaning.divergences
        if divergence.cause is cause and divergence.location.path == use.signed.file.place
    )


def said(context: Context, cause: Cause, why: str = "") -> Iterator[Violation]:
    """One violation for each document with divergences of the cause; `why` is the beginning of its message.

    Without it, what the table of peculiarities says of those that deviate.
    """
    for found in _of(context, cause):
        yield _violation(found, why or _explained(found))


def _explained(found: Sequence[Divergence]) -> str:
    return explained(found[0].cause.value, {name for divergence in found for name in divergence.deviating})


def _violation(found: Sequence[Divergence], why: str) -> Violation:
    worst = min(found, key=_rank)
    enclaves = list(dict.fromkeys(path for divergence in found for path in divergence.enclaves))
    # What an implementation allows by mistake in its own checks alone gives nothing away: peers refuse it.
    harmful = any(each.escalates and each.cause is not Cause.RULE_DOMAINS for each in found)
    harmful = harmful or bool(worst.starting or worst.refusing)
    return Violation(
        f"{why}: {_consequence(worst, enclaves)}",
        [*_locations(found)],
        enclave=enclaves[0] if len(enclaves) == 1 else None,
        severity=_severity(harmful=harmful, ros=any(divergence.ros for divergence in found)),
        profiles=tuple(name for name in VARIANTS if any(name in divergence.deviating for divergence in found)),
        # What is done differently is part of it: another line is not hidden by one that was accepted before.
        key="\n".join(sorted(_key(divergence) for divergence in found)),
    )


def _severity(*, harmful: bool, ros: bool) -> Severity | None:
    """One step less where all names concerned are such that no ROS 2 node has them. None: the rule's."""
    if harmful:
        return Severity.HIGH if ros else Severity.MEDIUM
    return None if ros else Severity.LOW


def _rank(divergence: Divergence) -> tuple[object, ...]:
    """What is worse, and tells more, comes first."""
    starts = bool(divergence.starting or divergence.refusing)
    return not divergence.escalates, not starts, divergence.example is None, divergence.location.line or 0


def _locations(found: Sequence[Divergence]) -> Iterator[Location]:
    for divergence in sorted(found, key=_rank):
        yield divergence.location
    for divergence in found:
        if divergence.other is not None:
            decides = located(divergence.other, "what decides instead")
            if decides.path != divergence.location.path or decides.line != divergence.location.line:
                yield decides


def _key(divergence: Divergence) -> str:
    example = divergence.example
    parts = [divergence.cause.value]
    if example is not None:
        parts += [example.operation.value, example.topic, str(example.partition), str(example.domain)]
    if divergence.starting or divergence.refusing:  # then it is about each of them
        parts += sorted(divergence.enclaves)
    return " ".join(parts)


def _consequence(divergence: Divergence, enclaves: Sequence[str]) -> str:
    """Who may do what under which implementation, and under which not."""
    who = listed(enclaves)
    example = divergence.example
    if divergence.starting or divergence.refusing:
        verb = " starts" if len(enclaves) == 1 else ": start"
        starts = f"{who}{verb} under {_names(divergence.starting)}, and not under {_names(divergence.refusing)}"
        if example is None or not divergence.escalates:
            return f"{starts}."
        if (example.allowing, example.denying) == (divergence.starting, divergence.refusing) and example.decided:
            return f"{starts}; there alone {example.enclave} may {_what(example)}."
        return f"{starts}; {_right(example)}"
    return _right(example) if example is not None else f"{who}."


def _what(example: Example) -> str:
    what = f"{VERBS[example.operation]} {ros_name(example.topic)} in domain {example.domain}"
    return f"{what}, partition {quoted(example.partition)}" if example.partition else what


def _right(example: Example) -> str:
    what = _what(example)
    allowing, denying = _names(example.allowing), _names(example.denying)
    if example.decided:
        return f"{example.enclave} may {what} under {allowing}, and not under {denying}."
    return f"peers let {example.enclave} {what} under {allowing}, and not under {denying}."


def _names(profiles: Collection[str]) -> str:
    """`the specification and Fast DDS 2.6, 2.14 (humble, jazzy)`: the variants of one vendor together."""
    by_vendor: dict[str, tuple[list[str], dict[str, None]]] = {}
    for name in profiles:
        profile = VARIANTS[name]
        vendor, _, version = profile.title.partition(" DDS ")
        versions, distributions = by_vendor.setdefault(f"{vendor} DDS" if version else vendor, ([], {}))
        versions.append(version)
        distributions.update(dict.fromkeys(profile.distributions))
    said = []
    for vendor, (versions, distributions) in by_vendor.items():
        shipped = f" ({', '.join(map(str.capitalize, distributions))})" if distributions else ""
        said.append(f"{vendor} {', '.join(versions)}".rstrip() + shipped)
    return either(said) if said else "no other"


def _unspoken(context: Context, cause: Cause) -> Iterator[list[Divergence]]:
    """As `_of`, without those of which other rules speak."""
    spoken = frozenset(_without_a_domain(context)) if context.meaning.divergences else frozenset()
    for found in _of(context, cause):
        if rest := [divergence for divergence in found if not spoken.issuperset(divergence.enclaves)]:
            yield rest


def _without_a_domain(context: Context) -> Iterator[str]:
    """Enclaves whose grant has no allow rule, or none for a governed domain: KA514 and KA508 say so."""
    for enclave in context.keystore.enclaves:
        governance, own = enclave.governance, own_grant(enclave)
        if governance is not None and governance.governance is not None and own is not None:
            allowed = own.allowed_domains
            if not allowed or not (own.default_allow or meet(allowed, governance.domains)):
                yield enclave.path


@rule(
    "KA601",
    Severity.MEDIUM,
    f"DDS-Security 1.1, 9.4.1.3 (domains of a rule); {MEASURED}",
    in_permissions(
        "Let the governance cover only the domains of the rules, or every rule name all of them (which can open "
        "bridges, KA731)"
    ),
)
def rule_of_another_domain(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A rule is for some of the governed domains, and Fast DDS applies it in all of them to its own endpoints.

    There, an allow rule gives too much and a deny rule takes too much away. Honest peers match nothing that is allowed
    in excess. One that attacks reads the samples, and its samples are accepted. What is denied in excess does not work.
    """
    wide = [divergence for found in _unspoken(context, Cause.RULE_DOMAINS) for divergence in found]
    if wide:  # all in one: it is most often the governance that is wider than every grant
        yield _violation(wide, _explained(wide))


@rule(
    "KA602",
    Severity.MEDIUM,
    f"DDS-Security 1.1, 9.4.1.2.4 (enable_join_access_control) and Table 63; {MEASURED}",
    ALLOW_DOMAINS,
    stops=True,
)
def join_checked_differently(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Whether the enclave may join a domain depends on the implementation.

    Fast DDS needs an allow rule, for any domain. Cyclone DDS needs nothing if a topic has read or write access control
    off (measured). OpenDDS starts only then, or without join access control (read in its source).
    """
    to_the_letter: list[Divergence] = []
    for found in _unspoken(context, Cause.JOIN):
        to_the_letter += [divergence for divergence in found if divergence.deviating <= _TO_THE_LETTER]
        if rest := [divergence for divergence in found if not divergence.deviating <= _TO_THE_LETTER]:
            yield _violation(rest, "The grant lets the enclave join a domain under only some implementations")
    if to_the_letter:
        yield _table_63(to_the_letter, context)


_TO_THE_LETTER: Final = {name for name, each in VARIANTS.items() if each.local.joins is JoinCheck.TABLE_63}


def _table_63(found: Sequence[Divergence], context: Context) -> Violation:
    """What OpenDDS refuses, and no grant can fix: it is the governance, most often that of `ros2 security`."""
    concerned = {path for divergence in found for path in divergence.enclaves}
    files = (e.governance for e in context.keystore.enclaves if e.path in concerned and e.governance is not None)
    said = _violation(found, _explained(found))
    return replace(
        said,
        locations=(*(Location(file.signed.file.place) for file in files), *said.locations),
        remedy=decision(
            f"Use another implementation. {doing('joins', JoinCheck.TABLE_63)} asks for join access control off or a "
            "topic without access control, and that weakens all implementations."
        ),
    )


@rule(
    "KA603",
    Severity.MEDIUM,
    f"DDS-Security 1.1, 9.4.1.2.4 (domains); {MEASURED}",
    COVER_DOMAIN,
    stops=True,
)
def starts_in_ungoverned_domain(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """The governance does not cover the domain: Fast DDS starts, protects nothing and has no topic; others refuse.

    Checked for the domain of --domain; without it, for a governance that covers no domain at all.
    """
    yield from said(context, Cause.UNGOVERNED, "The governance does not cover the domain")


@rule(
    "KA612",
    Severity.MEDIUM,
    f"DDS-Security 1.1, 9.4.1.3.2.2 (validity, xs:dateTime in UTC); measured on {TESTED_ON} with their clocks set",
    in_permissions(
        "Write dates as 2026-01-31T00:00:00, without zone, fraction and 24:00, until 2262, with a day to spare "
        "at both ends"
    ),
    stops=True,
)
def date_read_differently(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A grant is in force now under one implementation and not under another.

    Fast DDS reads every date in the standard time of the robot's zone, and refuses a document with 24:00. Cyclone DDS
    takes a date that it cannot read for long past, zones beyond 12 hours and years beyond 2262 included. A grant that
    should begin then has begun; one that should end then has expired. Without --time-zone, what depends on the zone is
    unknown.
    """
    yield from said(context, Cause.DATE, "A date of a grant is read differently")


@rule(
    "KA614",
    Severity.HIGH,
    f"DDS-Security 1.1, 9.4.1.2.4 and 9.4.1.3 (id_range); {MEASURED}",
    in_permissions("Write both <min> and <max>"),
)
def range_lets_more(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A range of domains with one bound holds less under an implementation, and somebody may do more by it.

    A deny rule does not hold in all domains, or a domain rule does not protect. See also domain-range-open and
    rule-domain-range-open.
    """
    for found in _of(context, Cause.RANGE):
        if lax := [divergence for divergence in found if divergence.escalates]:
            yield _violation(lax, "A range of domains with one bound holds less than it says")


@rule(
    "KA615",
    Severity.MEDIUM,
    f"DDS-Security 1.1, 9.4.1.2.5 (the first topic_rule that matches); {facts.ANY_RULE_READ}",
    in_governance("Let no two governance rules match one topic, or give both the same access control"),
)
def any_governance_rule_counts(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Several rules of the governance match a topic, and on OpenDDS one of them without access control is enough.

    For the topic to exist, one in a later domain rule is enough, too. Elsewhere the first match decides. Judged only if
    opendds is among the chosen profiles; not measured.
    """
    yield from said(context, Cause.ANY_GOVERNANCE_RULE)


@rule(
    "KA616",
    Severity.MEDIUM,
    "DDS-Security 1.1, 9.4.1 (access control); docs/profiles.md",
    in_permissions("Decide each topic by one rule, without partitions, ranges and brackets"),
)
def decided_differently(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Implementations decide differently, for a reason that no other rule names.

    The check after all others. The audit is incomplete if there are too many classes of names to compare.
    """
    for found in _of(context, Cause.OTHER):
        why = _explained(found)
        yield _violation(found, f"Implementations decide differently{f' ({why})' if why else ''}")
    for found in _of(context, Cause.UNDECIDED):
        yield Violation(
            "Implementations read the documents differently, and there are too many classes of names to say "
            "where it matters.",
            (found[0].location,),
            undecided=True,
        )
