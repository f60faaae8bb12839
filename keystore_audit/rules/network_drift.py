"""KA8: what was signed, or what the policy says, and what sessions and routers let enclaves do (`--zenoh DIR`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, reduce
from itertools import islice
from operator import and_
from typing import Final

from msgspec.structs import replace

from keystore_audit.errors import BudgetExceeded, UsageError
from keystore_audit.findings import Location, Severity, decision
from keystore_audit.keystore.document import MAX_DOMAIN
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.channels import Point, document_channels
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.formal.asked import ClaimKind
from keystore_audit.model.intended.drift_rights import policy_grant
from keystore_audit.model.matching.expression import any_matches
from keystore_audit.model.names import AMBIENT_TOPICS, Use, dds_channels
from keystore_audit.profiles import Matcher, Release, facts
from keystore_audit.rules.network_access import BY_HAND, NAMED, name_of
from keystore_audit.rules.registry import Context, Violation, listed, quoted, rule
from keystore_audit.truth import Truth
from keystore_audit.zenoh import flow
from keystore_audit.zenoh.answers import SENDING, Reached, channels, rights_in
from keystore_audit.zenoh.names import MAX_RIGHTS, OTHER_SIDE, names_in, rule_domains, written_names
from keystore_audit.zenoh.network import Network, is_session
from keystore_audit.zenoh.participants import NetworkFlows

Granted = Callable[[Enclave, Sequence[Use]], Truth]
"""Whether an enclave was given all of it."""
_Asked = tuple[Enclave, str, str, int]
"""Who, what, on which name of ROS 2, in which domain."""
WORDS: Final = {"publish": "publish", "subscribe": "subscribe to", "request": "call", "reply": "serve"}


@rule(
    "KA822",
    Severity.HIGH,
    facts.ROUTED_ACCESS,
    decision("Forbid it in the files, or sign it (or add it to the policy) if it is meant.", NAMED, BY_HAND),
)
def right_beyond_permissions(network: Network, context: Context) -> Iterator[Violation]:
    """An enclave can do what its signed permissions do not grant, or if a policy is named, what that does not grant.

    What counts is what others' files let in, with the enclave's own file or without: nobody reads permissions.p7s.
    Checked for topics and services that permissions or rules name, in the domains that rules name (else 0). Of each
    pattern of a rule, one name is checked (`any` for wildcards). Not compared: patterns with patterns, routers, and
    enclaves without permissions if no policy is named. With more than 2,000 rights it stays open.
    """
    rights = rights_in(network)

    def reaching(right: _Asked, release: Release) -> Iterator[Reached]:
        answer = rights.answer(*right, release)
        yield answer.could
        if answer.works.truth is Truth.YES:
            yield answer.works

    whose = "the policy does" if context.drift is not None else "its permissions do"
    message = f"{{who}} can {{what}}: {facts.ROUTED_NAMED} of others accept it, but {whose} not grant it."
    yield from _differing(network, context, _not_granted(network, context), reaching, Truth.YES, message)


@rule(
    "KA836",
    Severity.MEDIUM,
    facts.ROUTED_ACCESS,
    decision("Allow it in the files of both sides, or remove it from what is signed.", NAMED, BY_HAND),
)
def granted_and_kept_off(network: Network, context: Context) -> Iterator[Violation]:
    """An enclave was granted what the files stop: its own file stops it, or all others' do.

    The node starts, but nothing arrives. Checked for topics and services that the enclave's own permissions, and a
    named policy, grant by name, in the domains that rules name (else 0). Another enclave must have the other side: it
    subscribes to what is published, or serves what is called. Not compared: routers, enclaves without a file that
    starts, and the topics of logs and parameter changes. What may work is not reported. With more than 2,000 rights it
    stays open.
    """
    rights = rights_in(network)

    def working(right: _Asked, release: Release) -> Iterator[Reached]:
        enclave, operation, name, domain = right
        yield from (rights.works(enclave, role, key, release) for role, key in channels(operation, name, domain))

    message = f"{{who}} cannot {{what}}: that is granted, but {facts.ROUTED_NAMED} stop it."
    yield from _differing(network, context, _granted_to_both(network, context), working, Truth.NO, message)


def _differing(
    network: Network,
    context: Context,
    rights: Iterator[tuple[_Asked, Truth]],
    found: Callable[[_Asked, Release], Iterator[Reached]],
    told_if: Truth,
    message: str,
) -> Iterator[Violation]:
    """What works (`told_if` YES) and was not granted, or the other way about, as comes with each right; `message` has
    places for `who` and `what`. Whether more works than was granted has to be known; what may work is as good as works.
    """
    told, places, doubtful = list[tuple[str, str]](), dict[Location, None](), False
    sent = list[tuple[str, str]]()
    try:
        asked = [*islice(rights, MAX_RIGHTS + 1)]
    except BudgetExceeded as exceeded:
        yield Violation(f"Not compared with what was granted: {exceeded.message}", (), undecided=True, key="budget")
        return
    for right, granted in asked[:MAX_RIGHTS]:
        answers = [each for release in context.releases for each in found(right, release)]
        differing = [each for each in answers if each.truth is told_if]
        if differing and granted is told_if.negated:
            enclave, operation, name, _domain = right
            told.append((enclave.path, f"{WORDS[operation]} {name}"))
            sent += [(enclave.path, name)] if operation in SENDING else []
            places |= {each.location: None for each in differing if each.location is not None}
        doubtful = doubtful or (told_if is Truth.YES and any(each.truth.may for each in answers))
    if told:
        who = told[0][0]
        own = [what for path, what in told if path == who]
        others = f" (and {len(told) - len(own)} more of other enclaves)" if len(told) > len(own) else ""
        said = message.format(who=who, what=f"{listed(own)}{others}")
        key = "\n".join(sorted(f"{path} {right}" for path, right in told))
        yield Violation(said, [*places], key=key, sent=tuple(sent))
    elif len(asked) > MAX_RIGHTS:
        message = f"Only {MAX_RIGHTS} rights were compared with what was granted in {network.path}."
        yield Violation(message, (), undecided=True, key="more")
    elif doubtful and not rights_in(network).doubts:  # these are a finding of their own
        message = f"It is unknown whether the files in {network.path} let more than was granted."
        yield Violation(message, (), undecided=True, key="doubt")


_FIND_OUT: Final = decision("Fix what other findings say of missing or unread files, and run the audit again.")


@rule(
    "KA828",
    Severity.HIGH,
    f"{facts.ROUTED_PAGE}: what is asserted in keystore-audit.toml",
    decision(
        "Forbid it in one of the files named. If a router is on the way by right, name it in `through`, or decide "
        "that it is trusted (`attacker`).",
        NAMED,
        BY_HAND,
    ),
)
def asserted_property_violated_by_files(network: Network, context: Context) -> Iterator[Violation]:
    """A `no_flow` or `only_publish` that the settings assert does not hold by the files of sessions and routers.

    The severity is the one set there, else high. Checked at the audit instant, under all releases that are judged.
    Only-publish is about holders of a key, who need no file, and anybody without one, not about those who only pass on.
    Other forms are not checked. What is unknown stays open, as does a topic that is no key.
    """
    flows = NetworkFlows(context.keystore, network)
    for claim in context.claims:
        decide = {ClaimKind.NO_FLOW: flow.found, ClaimKind.ONLY_PUBLISH: flow.published}.get(claim.kind)
        if decide is None:
            continue
        where = replace(claim.location, message="asserted here")
        try:
            asked = flows.asked(claim)
            answers = [decide(flows, asked, each) for each in context.releases]
        except (BudgetExceeded, UsageError) as error:
            yield Violation(
                f"{quoted(claim.id)} is not decided: {error.message}", (where,), undecided=True, key=claim.id
            )
            continue
        hops = next((hops for truth, hops in answers if truth is Truth.YES), None)
        places = (where, *(hop.location for hop in hops or () if hop.location is not None))
        if hops:
            said = f"{flow.told(hops)} So the files violate {quoted(claim.id)}: {claim.statement}"
            sent = tuple((hop.sender.label, name_of(hop.key)) for hop in hops)
            yield Violation(said, places, severity=claim.severity, key=claim.id, sent=sent)
        elif any(truth.may for truth, _hops in answers):
            said = f"It is unknown whether {quoted(claim.id)} holds by the files in {network.path}."
            yield Violation(said, places, undecided=True, key=claim.id, remedy=_FIND_OUT)


def _not_granted(network: Network, context: Context) -> Iterator[tuple[_Asked, Truth]]:
    """What is not granted for certain."""
    for domain, enclaves, uses, granted in _compared(network, context):
        for enclave in enclaves:
            for (operation, name), needed in uses.items():
                truth = granted(enclave, needed)
                if truth is not Truth.YES:
                    yield (enclave, operation, name, domain), truth


def _granted_to_both(network: Network, context: Context) -> Iterator[tuple[_Asked, Truth]]:
    """What is granted for certain to who names it, and the other side to somebody else, both of whom start."""
    started = {each.owner for each in network.started}
    for domain, enclaves, uses, granted in _compared(network, context):
        starting = [each for each in enclaves if each in started]
        having = {
            right: [each for each in starting if granted(each, needed) is Truth.YES]
            for right, needed in uses.items()
            if AMBIENT_TOPICS.isdisjoint(topic for _use, topic in needed)
        }
        for enclave in starting:
            own = [enclave.permissions] if enclave.permissions is not None else []
            for operation, name in names_in(own):
                theirs = having.get((OTHER_SIDE[operation], name), ())
                if enclave in having.get((operation, name), ()) and {*theirs} - {enclave}:
                    yield (enclave, operation, name, domain), Truth.YES


def _compared(
    network: Network, context: Context
) -> Iterator[tuple[int, Sequence[Enclave], Mapping[tuple[str, str], Sequence[Use]], Granted]]:
    """By domain the enclaves that run nodes, the rights that permissions and rules name, and who was granted which.

    Raises BudgetExceeded where the domains are too many.
    """
    routing = {each.owner for each in network.started} - {each.owner for each in network.started if is_session(each)}
    enclaves = [each for each in context.keystore.enclaves if each not in routing and each.identity is not None]
    if context.drift is None:
        enclaves = [each for each in enclaves if each.permissions is not None]
    domains = rule_domains(network)
    if len(domains) > MAX_DOMAIN:  # all that permissions grant is worked out for each
        raise BudgetExceeded(f"the rules in {network.path} are about more than {MAX_DOMAIN} domains")
    for domain in domains:
        named = written_names(context.keystore, network, domain).rights
        uses = {(operation, name): dds_channels(operation, name) for operation, name in named}
        yield domain, enclaves, uses, _by_policy(context) or _by_permissions(context, [*uses.values()], domain)


def _by_policy(context: Context) -> Granted | None:
    """What the policy says, whose denials come first, as sros2 writes them; None: there is none."""
    if context.drift is None:
        return None
    rights = {each.enclave: policy_grant(each).rights for each in context.drift.policy.profiles if not each.lost}

    def granted(enclave: Enclave, needed: Sequence[Use]) -> Truth:
        own = rights.get(enclave.path, {})

        def listed_to(allow: bool, use: Use) -> bool:
            texts = (text for given, operation, text in own if given is allow and operation is use[0])
            return any_matches(texts, use[1], Matcher.POSIX)

        return Truth.YES if all(listed_to(True, use) and not listed_to(False, use) for use in needed) else Truth.NO

    return granted


def _by_permissions(context: Context, uses: Sequence[Sequence[Use]], domain: int) -> Granted:
    """What each enclave's own permissions grant to all that read them, whatever the governance."""
    accesses = context.accesses
    numbers = {topic: number for number, topic in enumerate(dict.fromkeys(topic for each in uses for _, topic in each))}
    points: list[Point] = [(topic, "") for topic in numbers]
    files = [each.permissions for each in context.keystore.enclaves]
    channels = document_channels(accesses.by_row(context.profiles, files), points, opened=True)
    rights = LocalRights(accesses, channels, context.at)

    @cache
    def given(enclave: Enclave, operation: Operation) -> int:
        each = (rights.peer_authorised(enclave, profile, operation) for profile in context.profiles)
        return reduce(and_, each)

    @cache
    def silent(enclave: Enclave) -> bool:
        file = enclave.permissions
        return file is not None and any(accesses.read(file, row).is_silent for row in accesses.rows(context.profiles))

    def granted(enclave: Enclave, needed: Sequence[Use]) -> Truth:
        if domain > MAX_DOMAIN:  # which no document can be about
            return Truth.NO
        if silent(enclave):
            return Truth.UNKNOWN
        every = (given(enclave, use) >> channels.of_point(domain, numbers[topic]) & 1 for use, topic in needed)
        return Truth.YES if all(every) else Truth.NO

    return granted
