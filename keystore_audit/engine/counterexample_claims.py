"""Says how a claim is violated: hop by hop, with the lines that allow each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from msgspec.structs import replace

from keystore_audit.engine import moments
from keystore_audit.engine.case import Case, Told, as_anybody, not_excluded, step_at, way
from keystore_audit.engine.native_claims import claims_at
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.claims.named import same_elsewhere
from keystore_audit.model.formal.asked import Attacker, ClaimAtom, ClaimKind, Place
from keystore_audit.model.formal.flow import Flows, Leg
from keystore_audit.model.formal.permission import Decisions
from keystore_audit.model.formal.system import System
from keystore_audit.model.names import ros_name
from keystore_audit.model.participants.unmanaged import MAX_SUBJECT
from keystore_audit.properties.result import Answer, Counterexample, Role
from keystore_audit.text import instant, shorten, some

UNDER: Final = {
    Attacker.HONEST: "no attack is needed",
    Attacker.SOURCE: "if it attacks",
    Attacker.RELAYS: "if some of those named attack",
}

Stage = tuple[int, Sequence[Leg]]
"""A moment, and the hops of a flow that are taken then."""


def describe_claim(system: System, claim: ClaimAtom, answer: Answer) -> Counterexample:
    """The violation of a claim that an engine found, in the user's names."""
    moment = 2 * system.now if answer.moment is None else answer.moment
    if answer.path:
        return describe_flow(system, claim, [(moment, answer.path)])
    when, then = _then_at(system, moment)
    if claim.kind is ClaimKind.ABLE:
        return Counterexample(text=f"{_nothing_gets_there(then, claim)}{when}.", steps=())
    if not any(answer.witnesses):
        return Counterexample(text=f"It is violated; the engine gave no example{when}.", steps=())
    case = Case(then, answer.witnesses[0])
    if (unread := not_excluded(then, *case.named())) is not None:
        return unread
    text, steps = (_shared_domain if claim.kind is ClaimKind.SEPARATE_DOMAINS else _somebody)(case, claim)
    return Counterexample(text=f"{text}{when}.", steps=steps)


def describe_flow(system: System, claim: ClaimAtom, stages: Sequence[Stage]) -> Counterexample:
    """A flow, moment by moment: a receiver may keep data and pass it on later."""
    routes: list[str] = []
    ways: list[Told] = []
    attacker, when = Attacker.HONEST, ""
    for number, (moment, legs) in enumerate(stages):
        when, then = _then_at(system, moment)
        part = replace(
            claim,
            source=claim.source if number == 0 else Place(),
            target=claim.target if number == len(stages) - 1 else Place(),
        )
        case = Case(then, {Role.TRUST_DOMAIN: 0})
        hops = [(at_hop(case, leg), leg) for leg in legs]
        routes.append(_route(part, hops) + ((when or " now") if len(stages) > 1 else ""))
        attacker = attacker if _by_right(part, hops) else claim.attacker
        ways += [way for hop in hops for way in hop_ways(part, *hop)]
    route = "; later, of what was kept, ".join(routes)
    if (unread := not_excluded(system, route)) is not None:
        return unread
    reasons = "".join(f" {why[0].upper()}{why[1:]}." for why in dict.fromkeys(why for why, _steps in ways if why))
    text = f"{route} ({UNDER[attacker]}{when if len(stages) == 1 else ''}).{reasons}"
    return Counterexample(text=text, steps=tuple(dict.fromkeys(step for _why, steps in ways for step in steps)))


def _nothing_gets_there(system: System, claim: ClaimAtom) -> str:
    """Between which places, and what may prevent it apart from rights."""
    asked = claims_at(system, 2 * system.now, Decisions(system))
    between, numbers = "there", list(asked.cut_off(claim))
    if len(claim.pairs) > 1:
        one, other = (_told_place(system, place) for place in claim.pairs[numbers[0]])
        more = f" (nor between {len(numbers) - 1} more of {len(claim.pairs)} pairs)" if len(numbers) > 1 else ""
        between = f"from {one} to {other}{more}"
    ending = some(sorted(system.enclaves[number].label for number in asked.ending(claim)), 1)

    def opened(**freed: Any) -> bool:
        """Whether something would get between them without that obstacle."""
        other = replace(system, **freed)
        return next(claims_at(other, 2 * system.now, Decisions(other)).cut_off(claim), None) not in numbers[:1]

    made = (replace(each, refused_writes=frozenset(), refused_reads=frozenset()) for each in system.enclaves)
    welcome = (replace(each, refuses=frozenset(), told=None) for each in system.trust_domains)
    reasons = (
        (opened(enclaves=(*made,)), ", of which their own implementations refuse some (`can` says why)"),
        (ending, f": {ending} can start now, but not at every instant until then"),
        (
            opened(trust_domains=(*welcome,)),
            "; enclaves refuse identities of others because of their CA files or revocation lists",
        ),
    )
    return f"Nothing gets {between} with the rights that enclaves have{''.join(why for so, why in reasons if so)}"


def _told_place(system: System, place: Place) -> str:
    names = [system.enclaves[enclave].label for enclave in sorted(place.enclaves)]
    topics = sorted({system.channels[channel].topic for channel in place.channels}, key=lambda name: (len(name), name))
    names += [ros_name(topic) for topic in topics[:1]]
    return names[0] if names else "anybody on the network" if place.outsider else "something missing or unread"


def _somebody(case: Case, claim: ClaimAtom) -> Told:
    """Who else may publish a topic, or reads one that is not encrypted against it or with the key of who may."""
    publishing = claim.kind is ClaimKind.ONLY_PUBLISH
    operation = Operation.PUBLISH if publishing else Operation.SUBSCRIBE
    does = f"{'may publish' if publishing else 'can read'} {case.topic}"
    if Role.CERTIFICATE in case.witness:
        return _stranger(case, does, operation)
    if Role.ENCLAVE in case.witness:
        enclave, who = case.witness[Role.ENCLAVE], case.enclave.label
        if publishing:
            why, steps = way(case, enclave, operation, alone=False)
            return f"{who} can publish {case.topic} too: {why}" if why else f"{who} {does} too", steps
        why, steps, able = case.kinds(), case.governance_steps(), case.view.abilities(enclave)
        if (able.may_read | ~able.overhears) >> case.number & 1:
            why, steps = way(case, enclave, operation, alone=False)
        return f"{who} {does}, but has no right to: {why}", steps
    if case.witness.get(Role.WITH_IDENTITY):
        return _known(case, does, _let_in(case, operation))
    if publishing:
        does = (
            f"may join without an identity and publish {case.topic}, since allow_unauthenticated_participants is true"
        )
    return f"Anybody on the network {does}: {case.kinds()}", case.governance_steps()


def _known(case: Case, does: str, joining: str) -> Told:
    """What any holder of an identity from the CA can do: by signing its own permissions, or because it can join."""
    if not case.view.granted_by_known >> case.number & 1:
        grant = " and some grant of the permissions CA" if case.view.reading.requires_grant else ""
        why = f"including robots elsewhere: enable_join_access_control is false, and {joining}"
        return f"Anybody with an identity of the CA{grant} {does} without a grant, {why}", case.governance_steps()
    authority = case.system.certificates[min(case.view.issuing_signers)]
    text = (
        f"Anybody with an identity of the CA that is fit to sign {does}, including robots elsewhere, by signing their "
        f"own permissions. {shorten(authority.label, MAX_SUBJECT)} is both identity CA and permissions CA, and these "
        "implementations accept any signer that it issued"
    )
    return text, (case.step(authority.location),)


def _let_in(case: Case, operation: Operation) -> str:
    """Why a participant in the domain needs no grant: access control is off, or all participants have the keys."""
    protection, writes = case.view.protection, operation is Operation.PUBLISH
    controlled = protection.write_controlled if writes else protection.read_controlled
    if controlled >> case.number & 1:
        return case.kinds()
    return f"enable_{'write' if writes else 'read'}_access_control is false"


def _stranger(case: Case, does: str, operation: Operation) -> Told:
    """How the holder of a certificate that no enclave has, or of one that was left out, does it."""
    system, view, identity = case.system, case.view, case.witness[Role.CERTIFICATE]
    able, writes = view.elsewhere[identity], operation is Operation.PUBLISH
    documents = view.accepted if writes else view.accepted - view.genuine if able.may_read >> case.number & 1 else ()
    taken = [each.location for each in case.rights_by(identity, operation) if each.document in documents]
    steps = (case.step(taken[0] if taken else system.certificates[identity].location),)
    who, known = f"Whoever is {shorten(system.certificates[identity].label, MAX_SUBJECT)}", left_out(system, identity)
    beside = [
        enclave.label
        for number, enclave in enumerate(system.enclaves)
        if not view.authenticated(number) and identity in same_elsewhere(system, number)
    ]
    read = "that could be read" if any(each.identity is None for each in system.left_out) else "of this keystore"
    if known is not None:
        who = known
    elif beside:
        who = f"{who} other than {beside[0]}, whose certificate peers refuse,"
    else:
        who = f"{who}, which is no enclave {read},"
    why = f"peers accept the grant in {taken[0]} from anybody with that subject" if taken else _let_in(case, operation)
    text = f"{who} {does}{'' if writes else ' without a right to'}: {why}"
    return text, (*steps, *(() if writes and taken else case.governance_steps()))


def left_out(system: System, certificate: int) -> str | None:
    """The enclave that has a certificate and was left out."""
    return next((each.label for each in system.left_out if each.identity == certificate), None)


def _then_at(system: System, moment: int) -> tuple[str, System]:
    """From when on it is so, unless now, and the system at that moment."""
    index, after = divmod(moment, 2)
    since = f", {'after' if after else 'from'} {instant(system.instants[index])}{'' if after else ' on'}"
    return since if moment != 2 * system.now else "", moments.at(system, moment)


def at_hop(case: Case, leg: Leg) -> Case:
    """The channel of a hop as its receiver's peers protect it."""
    enclave = leg.sender if leg.receiver is None else leg.receiver
    if enclave is None:
        return case.at({Role.TRUST_DOMAIN: 0, Role.CHANNEL: leg.channel})
    trust_domain = case.system.enclaves[enclave].trust_domain
    return case.at({Role.TRUST_DOMAIN: trust_domain, Role.CHANNEL: leg.channel, Role.ENCLAVE: enclave})


def _route(claim: ClaimAtom, hops: Sequence[tuple[Case, Leg]]) -> str:
    """`/random -> /low_priority -> /multiplexer -> ...`: participants and topics in turn."""

    def who(case: Case, enclave: int | None) -> str:
        return "anybody on the network" if enclave is None else case.system.enclaves[enclave].label

    words = [] if claim.source.channels else [who(hops[0][0], hops[0][1].sender)]
    for number, (case, leg) in enumerate(hops):
        words.append(case.stop)
        if number < len(hops) - 1 or not claim.target.channels:
            words.append(who(case, leg.receiver))
    return " -> ".join(words)


def _by_right(claim: ClaimAtom, hops: Sequence[tuple[Case, Leg]]) -> bool:
    """Whether it needs no attack. A flow begins and ends by itself at a channel that the claim names."""
    flows, last = Flows(hops[0][0].system, hops[0][0].views), len(hops) - 1
    lanes = flows.by_right(among={end for _case, leg in hops for end in (leg.sender, leg.receiver) if end is not None})

    def able(sets: Sequence[int], who: int | None, place: Place | None) -> int:
        by_itself = who is None and place is not None and place.channels
        return -1 if by_itself else sets[flows.outsider if who is None else who]

    return all(
        any(
            able(lane.puts, leg.sender, None if number else claim.source)
            & able(lane.gets, leg.receiver, claim.target if number == last else None)
            & 1 << leg.channel
            for lane in lanes
        )
        for number, (_case, leg) in enumerate(hops)
    )


def hop_ways(claim: ClaimAtom, case: Case, leg: Leg) -> list[Told]:
    """Why a sample gets across: one way for its sender and one for its receiver.

    A flow begins or ends by itself at a channel that the claim names. A receiver that listens, or attacks, checks no
    right: its sender need only make a writer.
    """
    sender, receiver = leg.sender, leg.receiver
    shows = sender is not None and (
        (receiver is None and not claim.target.channels)
        or (claim.attacker is Attacker.RELAYS and not case.view.abilities(sender).forges >> leg.channel & 1)
    )
    ways: list[Told | None] = []
    for enclave, operation, place, alone in (
        (sender, Operation.PUBLISH, claim.source, shows),
        (receiver, Operation.SUBSCRIBE, claim.target, True),
    ):
        if enclave is not None:
            why, steps = way(case, enclave, operation, alone=alone)
            ways.append((f"{case.system.enclaves[enclave].label}: {why}" if why else "", steps))
        elif not place.channels:
            ways.append(as_anybody(case, operation, None))
    return [each for each in ways if each is not None]


def _shared_domain(case: Case, claim: ClaimAtom) -> Told:
    asked, rule = case.witness[Role.DOMAIN], case.domain_rule
    domain = case.system.domains[asked].label
    step = step_at(None if rule is None else rule.location, domain, channel=domain)
    both = [case.witness[role] for role in (Role.ENCLAVE, Role.OTHER)]
    joining, here = (
        [n for n in both if any((view.joined(n) | view.protection.unauthenticated) >> asked & 1 for view in peers)]
        for peers in (case.views, [case.view])
    )
    sides = claim.source.enclaves | claim.target.enclaves
    one, other = (_with_its_key(case.system, each, sides) for each in sorted(both, key=lambda n: n not in joining))
    if both[0] == both[1]:
        text = f"As {one} both sides can join {domain}"
    elif len(joining) == 1:
        text = (
            f"{one} can join {domain}. By its own implementation's reading of its permissions, {other} starts there "
            "too: it refuses nobody who may be there, and an attacker accepts it"
        )
    else:
        how = "" if len(here) > 1 else ", but different peers accept each"
        if case.view.protection.unauthenticated >> asked & 1:
            how = ", where anybody is let in without an identity"
        text = f"{one} and {other} can both join {domain}{how}"
    return text, (step,)


def _with_its_key(system: System, enclave: int, among: frozenset[int]) -> str:
    """An enclave, with who else has its key."""
    key, label = system.key_of(enclave), system.enclaves[enclave].label
    others = [system.enclaves[each].label for each in sorted(among - {enclave}) if system.key_of(each) == key]
    if key is None or not others:
        return label
    return f"{label}, whose key {some(others, 1)} {'have' if len(others) > 1 else 'has'} too,"
