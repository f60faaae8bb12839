"""KA4 to KA6: the domains, partitions and data tags that rules are limited to."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Final

from keystore_audit.findings import Act, Location, Severity, decision
from keystore_audit.keystore.document import MAX_DOMAIN, DomainRange, Text
from keystore_audit.keystore.typed import Criterion, Grant, Operation
from keystore_audit.keystore.typed import Rule as PermissionsRule
from keystore_audit.model.domains import covered, describe, domain_bits
from keystore_audit.model.formal.bit_sets import bits, members
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import System
from keystore_audit.model.matching.expression import any_matches
from keystore_audit.model.matching.patterns import EVERY_PARTITION
from keystore_audit.model.names import DISCOVERY_TOPIC, ros_name
from keystore_audit.model.semantics import DEFAULT_PARTITION
from keystore_audit.model.subjects.told import own_grant
from keystore_audit.profiles import TESTED_ON, VARIANTS, Matcher, OpenRange, doing, facts
from keystore_audit.rules.permissions import about
from keystore_audit.rules.registry import VERBS, Context, Violation, listed, more_like, quoted, rule
from keystore_audit.rules.remedies import in_governance, in_permissions
from keystore_audit.rules.subjects import DocumentUse, GovernanceUse, PermissionsUse, speaks, taken


def meet(some: Iterable[DomainRange], others: Iterable[DomainRange]) -> bool:
    """Whether they share a domain."""
    return bool(domain_bits(covered(some)) & domain_bits(covered(others)))


_REFUSES: Final = doing("open_ranges", OpenRange.LONE_MAX_REFUSED)
_ALONE: Final = doing("open_ranges", OpenRange.LONE_BOUND_IS_THAT_ID, OpenRange.LONE_MAX_REFUSED)
_FROM_IT_ON: Final = doing("open_ranges", OpenRange.UNBOUNDED)


def _open_range(domains: DomainRange) -> str | None:
    """What an `<id_range>` with one bound means to whom, None where it has both."""
    if domains.high is None and domains.low is not None:
        return (
            f"<id_range> has no <max>: {_ALONE} read only domain {domains.low}, the specification and {_FROM_IT_ON} "
            "everything from it on"
        )
    if domains.low is None and domains.high is not None:
        return f"<id_range> has no <min>: {_REFUSES} refuses the document, the others read 0 to {domains.high}"
    return "<id_range> has no bounds: implementations differ in what they read" if domains.low is None else None


@rule(
    "KA419",
    Severity.MEDIUM,
    "DDS-Security 1.1, 9.4.1.2.4 and its governance XSD (id_range); measured",
    in_governance("Write both <min> and <max>"),
    applies=speaks,
)
def domain_range_open(use: GovernanceUse) -> Iterator[Violation]:
    """An <id_range> lacks <min> or <max>, and implementations read different domains in it (measured)."""
    for domains in use.document.domains:
        why = _open_range(domains)
        if why is not None:
            yield Violation(
                f"{why}.",
                (use.at(domains.line),),
                key=f"{domains.low} {domains.high}",
            )


_LIMITED: Final = tuple(profile for profile in VARIANTS.values() if profile.access.highest_domain is not None)
_HIGHEST: Final = min(filter(None, (profile.access.highest_domain for profile in _LIMITED)))
"""Cyclone DDS, access_control_parser.c: it refuses the whole document above it (measured)."""


@rule(
    "KA420",
    Severity.MEDIUM,
    f"RTPS 2.5, 9.6.2.3 (ports of a domain); {facts.DOMAINS_MEASURED}",
    decision("Use domain ids up to 230.", Act.EDIT),
    applies=taken,
    stops=True,
)
def domain_above_230(use: DocumentUse, context: Context) -> Iterator[Violation]:
    """A governance or permissions document names a domain above 230.

    Cyclone DDS refuses the whole document, so its enclaves start in no domain: high if it is among the chosen profiles.
    Above 232 there are no ports.
    """
    for domains in _ranges(use):
        highest = max(domains.low or 0, domains.high or 0)
        if highest > _HIGHEST:
            yield Violation(
                f"Domain {highest}, expected at most {_HIGHEST} (ports end at {MAX_DOMAIN}): "
                f"{doing('highest_domain', _HIGHEST)} refuses the whole document.",
                (use.at(domains.line),),
                severity=Severity.HIGH if context.chose(_LIMITED) else None,
                profiles=tuple(profile.name for profile in _LIMITED) if highest <= MAX_DOMAIN else (),
                key=f"{domains.low} {domains.high}",
            )


def _ranges(use: DocumentUse) -> Iterator[DomainRange]:
    """Every range of domains of the document."""
    if isinstance(use, GovernanceUse):
        yield from use.document.domains
    if isinstance(use, PermissionsUse):
        for grant in use.document.grants:
            for permission_rule in grant.rules:
                yield from permission_rule.domains


@rule(
    "KA508",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.2.4 and 9.4.1.3 (domains)",
    decision(
        "Let grant and governance name one domain, that of ROS_DOMAIN_ID on the robots. If enclaves carry "
        "different governances (KA416), begin there.",
        Act.EDIT,
    ),
    applies=speaks,
    stops=True,
)
def grant_outside_governance_domains(use: PermissionsUse) -> Iterator[Violation]:
    """No allow rule of the enclave's grant names a governed domain, so the enclave can take part in none.

    Fast DDS still creates the participant, and peers refuse its endpoints (measured).
    """
    for enclave in use.enclaves:
        file, own = enclave.governance, own_grant(enclave)
        if file is None or file.governance is None or own is None or own.default_allow:
            continue
        governed, allowed = file.domains, own.allowed_domains
        if allowed and not meet(governed, allowed):
            yield Violation(
                f"{enclave.path} can take part in no domain: its grant allows domain "
                f"{describe(covered(allowed))}, its governance covers {describe(covered(governed))}.",
                (
                    use.at(own.line),
                    Location(file.signed.file.place, file.governance.line, message="the governance"),
                ),
                enclave=enclave.path,
                key=own.subject_name.text,
            )


@rule(
    "KA515",
    Severity.MEDIUM,
    "DDS-Security 1.1, 9.4.1.3 and its permissions XSD (id_range); measured",
    in_permissions("Write both <min> and <max>"),
    applies=speaks,
)
def rule_domain_range_open(use: PermissionsUse) -> Iterator[Violation]:
    """An <id_range> of a rule lacks <min> or <max>, and implementations read different domains in it (measured).

    Critical without <min>: evaluating such a rule crashes Cyclone DDS 0.10.2 (measured with its plugin). Peers send
    permissions too: one signed document stops others.
    """
    for grant in use.document.grants:
        for permission_rule in grant.rules:
            for domains in permission_rule.domains:
                why = _open_range(domains)
                if why is not None:
                    key = f"{grant.subject_name.text} {domains.low} {domains.high}"
                    crashes = domains.low is None
                    message = f"{why}.{f' {facts.OPEN_RANGE_KILLS}' if crashes else ''}"
                    severity = Severity.CRITICAL if crashes else None
                    yield about(use, grant, domains.line, message, key=key, severity=severity)


@rule(
    "KA638",
    Severity.HIGH,
    f"DDS-Security 1.1, 9.4.1.3.2.3 (data_tags); measured on {TESTED_ON}",
    in_permissions("Remove <data_tags>, which ROS 2 does not have, and allow or deny what remains"),
    applies=speaks,
)
def data_tags_ignored(use: PermissionsUse) -> Iterator[Violation]:
    """A rule is limited to endpoints with certain data tags, but every implementation applies it to all endpoints.

    To the specification, an allow rule with tags allows only those, and a deny rule spares all others. High if more is
    allowed than it says, medium if more is denied. All else is decided without the tags, under `spec` too.
    """
    for grant, each, criterion in _tagged(use):
        verb, operation = "allows" if each.allow else "denies", criterion.operation.value
        topics = [text.text for text in criterion.topics]
        yield about(
            use,
            grant,
            criterion.line,
            f"A rule {verb} {operation} of {listed(map(quoted, topics))} only to endpoints with certain data "
            f"tags, but every implementation ignores the tags: it {verb} it to all.",
            severity=None if each.allow else Severity.MEDIUM,
            key=f"{grant.subject_name.text} {verb} {operation} {' '.join(topics)}",
        )


def _tagged(use: PermissionsUse) -> Iterator[tuple[Grant, PermissionsRule, Criterion]]:
    for grant in use.document.grants:
        for each in grant.rules:
            yield from ((grant, each, criterion) for criterion in each.criteria if criterion.data_tags)


_ROS: Final = re.compile(f"{DISCOVERY_TOPIC}$|r[tqr]/")
_ONE_CHARACTER: Final = re.compile(r"\?|\[[^\]]*\]")

NO_PARTITIONS: Final = in_permissions(
    "Remove the partitions from the rules, and name only the topics; ROS 2 uses no partitions"
)


@rule(
    "KA637",
    Severity.HIGH,
    "DDS 1.4, 2.2.3.13 (PARTITION); DDS-Security 1.1, 9.4.1.3.2.3 (partitions); measured",
    NO_PARTITIONS,
    applies=speaks,
)
def partition_evaded(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """An endpoint may be in a partition that is a pattern, and so meet data that the rules keep from it.

    To permissions an endpoint's partition is a plain string; to matching it is a pattern (measured on Cyclone DDS
    0.10.2 and Fast DDS 2.9.1). So a denial in `secret` says nothing of `*`, and who is allowed in `?` may go into `*`.
    If an implementation takes a denial for the whole topic, nothing gets around it (deny-rule-blocks-topic).
    Properties, claims and flows count this; `can` and `access` answer about the plain name.
    """
    for grant in use.document.grants:
        for criterion in grant.allowed:
            yield from _beyond(use, grant, criterion)
    yield from _evaded(use, context)


def of_no_node(use: PermissionsUse) -> Iterator[Violation]:
    """Names of ROS 2 that a grant allows in partitions alone: no node is in one."""
    for grant in use.document.grants:
        criteria = list(grant.allowed)
        if grant.default_allow or not any(criterion.partitions for criterion in criteria):
            continue
        apart: dict[tuple[Operation, str], Text] = {}
        plain: set[tuple[Operation, str]] = set()
        for criterion in criteria:
            uses = [(criterion.operation, text.text) for text in criterion.topics]
            listed = criterion.partitions or ()
            if listed and all(text.text.strip("*") for text in listed):  # no name of no character matches
                apart |= dict.fromkeys(uses, listed[0]) | apart
            else:
                plain.update(uses)
        found = [(*each, place) for each, place in apart.items() if each not in plain and _ROS.match(each[1])]
        if found:
            operation, topic, place = found[0]
            yield about(
                use,
                grant,
                place.line,
                f"{quoted(grant.subject_name.text)} may {VERBS[operation]} {ros_name(topic)}{more_like(found)} only "
                f"in partition {quoted(place.text)}. ROS 2 nodes use no partitions, so this allows them nothing.",
                remedy=NO_PARTITIONS,
                key=f"{grant.subject_name.text} in partitions",
            )


def _beyond(use: PermissionsUse, grant: Grant, criterion: Criterion) -> Iterator[Violation]:
    """An allowed expression that matches patterns which match more than it does."""
    for text in criterion.partitions or ():
        wider = _ONE_CHARACTER.sub(EVERY_PARTITION, text.text)
        if wider == text.text or not any_matches([text.text], wider, Matcher.POSIX):
            continue
        yield about(
            use,
            grant,
            text.line,
            f"{criterion.operation.value} is allowed in partitions that {quoted(text.text)} matches, even in "
            f"{quoted(wider)}. An endpoint there meets those in all partitions that this matches as a pattern.",
            key=f"{grant.subject_name.text} {criterion.operation.value} {text.text}",
        )


def _evaded(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """A denial in some partitions, though a pattern that meets them is allowed later on."""
    rules = ((grant, each) for grant in use.document.grants for each in grant.rules if not each.allow)
    denials = [(grant, each, criterion) for grant, each in rules for criterion in each.criteria]
    views = [
        (
            system,
            Permissions(system),
            [(n, bits(others)) for n, others in enumerate(system.meets) if others],
            {id(atom.source): atom for atom in system.rules if not atom.allow},
        )
        for system in (context.meaning.systems if denials else ())
    ]
    for grant, each, criterion in denials:
        allowing, profiles, operation = "", list[str](), criterion.operation
        for system, decisions, meeting, atoms in views:
            if (atom := atoms.get(id(each))) is not None:
                allowed = decisions.allowed(atom.grant, operation)
                denied = bits(atom.named(operation)) & decisions.within(atom.domains) & ~allowed
                met = (n for n, others in meeting if allowed >> n & 1 and _about(criterion, system, others & denied))
                if (way := next(met, None)) is not None:
                    by = decisions.decider(atom.grant, operation, way)
                    allowing = "by default" if by is None else f"in line {by.location.line}"
                    profiles += system.profiles
        if profiles:
            denied_in = [text.text for text in criterion.partitions or ()] or DEFAULT_PARTITION
            where = (
                f"partition {', '.join(map(quoted, denied_in))}" if criterion.partitions else "the default partition"
            )
            yield about(
                use,
                grant,
                criterion.line,
                f"Denied here is {operation.value} in {where}. But it is allowed {allowing} in a partition pattern "
                "that meets this one, and no denial matches the pattern.",
                profiles=tuple(profiles),
                key=f"{grant.subject_name.text} {operation.value} denied {' '.join(denied_in)}",
            )


def _about(criterion: Criterion, system: System, channels: int) -> bool:
    """Whether the criterion lists the topic of one of the channels."""
    texts = [text.text for text in criterion.topics]
    return any(any_matches(texts, system.channels[n].topic, Matcher.POSIX) for n in members(channels))
