"""Says how a claim is violated: hop by hop, with the lines that allow each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from keystore_audit.engine.alloy import moments
from keystore_audit.engine.case import Case, Told, as_anybody, step_at, way
from keystore_audit.engine.native_claims import claims_at
from keystore_audit.findings import Location
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.claims.named import UNREAD_IDENTITY, same_elsewhere
from keystore_audit.model.formal.asked import Attacker, ClaimAtom, ClaimKind
from keystore_audit.model.formal.asked import Place as ClaimPlace
from keystore_audit.model.formal.attacker import trust_domain_views
from keystore_audit.model.formal.bit_sets import bits, union
from keystore_audit.model.formal.flow import Flows
from keystore_audit.model.formal.permission import Decisions, Permissions
from keystore_audit.model.formal.system import System
from keystore_audit.model.names import ros_name
from keystore_audit.model.participants.unmanaged import MAX_SUBJECT
from keystore_audit.properties.result import ANYBODY, Answer, Counterexample, Hop, Role
from keystore_audit.text import instant, shorten, some

UNDER: Final = {
    Attacker.HONEST: "even if nobody attacks",
    Attacker.SOURCE: "if it attacks",
    Attacker.RELAYS: "if some of those named attack",
}


def describe_claim(system: System, claim: ClaimAtom, answer: Answer) -> Counterexample:
    """The violation of a claim that an engine found, in the user's names."""
    when, system = then_at(system, answer)
    text, steps = _told(system, claim, answer, when)
    return Counterexample(text=text, steps=steps)


def _told(system: System, claim: ClaimAtom, answer: Answer, when: str) -> Told:
    if claim.kind is ClaimKind.ABLE:
        return _nothing_gets_there(system, claim, when), ()
    if answer.path:
        ways = [way for hop in answer.path for way in hop_ways(system, claim, hop)]
        reasons = "".join(f" {why[0].upper()}{why[1:]}." for why in dict.fromkeys(why for why, _steps in ways if why))
        attacker = Attacker.HONEST if by_right(system, claim, answer.path) else claim.attacker
        text = f"{route(system, claim, answer.path)} ({UNDER[attacker]}{when}).{reasons}"
        return text, tuple(dict.fromkeys(step for _why, steps in ways for step in steps))
    witness = answer.witnesses[0] if answer.witnesses else {}
    if claim.kind is ClaimKind.SEPARATE_DOMAINS and Role.DOMAIN in witness:
        return _shared_domain(Case(system, witness), claim, when)
    if Role.CHANNEL not in witness:
        return f"It is violated, and no example was given{when}.", ()
    return (_publisher if claim.kind is ClaimKind.ONLY_PUBLISH else _reading)(Case(system, witness), when)


def _nothing_gets_there(system: System, claim: ClaimAtom, when: str) -> str:
    """Between which places, and what may keep it from them beside rights."""
    asked = claims_at(system, 2 * system.now, Decisions(system))
    between, numbers = "there", list(asked.cut_off(claim)) if len(claim.pairs) > 1 else []
    if numbers:
        one, other = (_told_place(system, place) for place in claim.pairs[numbers[0]])
        more = f" (nor between {len(numbers) - 1} more of {len(claim.pairs)} pairs)" if len(numbers) > 1 else ""
        between = f"from {one} to {other}{more}"
    ending = some(sorted(system.enclaves[number].label for number in asked.ending(claim)), 1)
    reasons = (
        (
            any(each.refused_writes or each.refused_reads for each in system.enclaves),
            ", some of which their own implementations refuse them (`can` says why)",
        ),
        (ending, f": {ending} can start now, and not at every instant until then"),
        (
            len({trust_domain.told for trust_domain in system.trust_domains} - {None}) > 1,
            (
                "; enclaves refuse each other whose permissions CA files begin with certificates of different names, "
                "or of which one is signed with RSA"
            ),
        ),
        (
            any(trust_domain.refuses for trust_domain in system.trust_domains),
            (
                "; enclaves refuse identities of others, by their revocation lists or by dates and order of the "
                "authorities in their identity CA files"
            ),
        ),
    )
    but = "".join(reason for so, reason in reasons if so)
    return f"Nothing gets {between} with the rights that enclaves have{but}{when}."


def _told_place(system: System, place: ClaimPlace) -> str:
    names = [system.enclaves[enclave].label for enclave in sorted(place.enclaves)]
    topics = sorted({system.channels[channel].topic for channel in place.channels}, key=lambda name: (len(name), name))
    names += [ros_name(topic) for topic in topics[:1]]
    return names[0] if names else "anybody on the network" if place.outsider else "what is not there, or was not read"


def _reading(case: Case, when: str) -> Told:
    """Who reads a topic that is not encrypted against it, or (an insider) with the key of somebody who may."""
    if Role.CERTIFICATE in case.witness:
        return _stranger_reading(case, case.witness[Role.CERTIFICATE], when)
    does = f"can read {case.topic}"
    if Role.ENCLAVE in case.witness:
        enclave = case.witness[Role.ENCLAVE]
        why, steps = case.kinds(), case.governance_steps()
        if not case.view.abilities(enclave).overhears >> case.number & 1:
            why, steps = way(case, enclave, Operation.SUBSCRIBE, alone=False)
        return f"{case.enclave.label}, which may not, {does}: {why}{when}.", steps
    if case.view.readable >> case.number & 1:
        return f"Anybody on the network {does}: {case.kinds()}{when}.", case.governance_steps()
    free = f"enable_join_access_control is false, and {_read_by(case)}"
    return _known(case, does, f"{does} without a grant to, robots elsewhere too, since {free}", when)


def _known(case: Case, signing: str, joining: str, when: str) -> Told:
    """What whoever has an identity of the CA does: by permissions that it signs itself, or since it joins at all."""
    if not case.view.granted_by_known >> case.number & 1:
        grant = " and some grant of the permissions CA" if case.system.requires_grant else ""
        return f"Whoever has an identity of the CA{grant} {joining}{when}.", case.governance_steps()
    authority = case.system.certificates[min(case.view.issuing_signers)]
    text = (
        f"Whoever has an identity of the CA that is fit to sign {signing}, robots elsewhere too, by permissions that "
        f"it signs itself: {shorten(authority.label, MAX_SUBJECT)} stands for identities and for permissions, and "
        f"these implementations accept any signer that it issued{when}."
    )
    return text, (case.step(authority.location),)


def _read_by(case: Case) -> str:
    """Why who has joined the domain reads a topic without a grant to: nobody asks, or all have the keys."""
    controlled = case.view.protection.read_controlled >> case.number & 1
    return case.kinds() if controlled else "enable_read_access_control is false"


def _stranger_reading(case: Case, identity: int, when: str) -> Told:
    """Why somebody who has a certificate that no enclave has, or one that was left out, reads a topic."""
    view, able = case.view, case.view.elsewhere[identity]
    who, place, _unread = _stranger(case, identity, case.permissions.admitting(identity, view.accepted))
    why, foreign = _read_by(case), view.accepted - view.genuine
    signed = [each.location for each in case.rights_by(identity, Operation.SUBSCRIBE) if each.document in foreign]
    if signed and (able.may_read & view.protection.read_controlled & ~able.overhears) >> case.number & 1:
        place, why = signed[0], "peers accept a grant that the permissions CA did not sign"
    text = f"{who} can read {case.topic} without a right to: {why}{when}."
    return text, (case.step(place), *case.governance_steps())


def _publisher(case: Case, when: str) -> Told:
    """Who else may publish: an enclave, whoever has a subject that is no enclave's here, or anybody."""
    does = f"may publish {case.topic}"
    if Role.ENCLAVE in case.witness:
        steps = case.right_steps(case.witness[Role.ENCLAVE], Operation.PUBLISH) or case.governance_steps()
        return f"{case.enclave.label} {does} too{when}.", steps
    if Role.CERTIFICATE in case.witness:
        return _stranger_publishing(case, case.witness[Role.CERTIFICATE], when)
    if case.view.joining_anybody >> case.number & 1:
        text = (
            f"Anybody on the network may join without an identity and publish {case.topic}, since "
            f"allow_unauthenticated_participants is true: {case.kinds()}{when}."
        )
        return text, case.governance_steps()
    free = "enable_join_access_control and enable_write_access_control are false"
    return _known(case, does, f"{does}, robots elsewhere too, since {free}", when)


def _stranger_publishing(case: Case, identity: int, when: str) -> Told:
    """By what somebody may publish who has a certificate that no enclave has, or one that was left out."""
    rights = case.rights_by(identity, Operation.PUBLISH)
    taken = [right.location for right in rights if right.document in case.view.accepted]
    who, place, unread = _stranger(case, identity, taken)
    steps = (case.step(taken[0]),) if taken else (case.step(place), *case.governance_steps())
    does = f"{who} may publish {case.topic}"
    if unread:
        return f"{does}{when}.", steps
    if _left_out(case.system, identity) is not None:
        return f"{does} too{when}.", steps
    why = (
        f"peers take the grant in {taken[0]} from whoever has that subject" if taken else "nobody asks for such a grant"
    )
    return f"{does}{when}: {why}.", steps


def _stranger(case: Case, identity: int, admitting: Sequence[object]) -> tuple[str, Location, bool]:
    """Who has a certificate that no enclave has, and its place; or, as nothing known is `admitting` it, whoever is let
    in by what could not be read, and that this is why.
    """
    unread = None if admitting else case.opaque_document()
    if unread is None:
        return _who_has(case, identity), case.system.certificates[identity].location, False
    return f"Whoever {unread.location.path}, which could not be read, lets in", unread.location, True


def _left_out(system: System, certificate: int) -> str | None:
    """The enclave that has a certificate and was left out."""
    return next((each.label for each in system.left_out if each.identity == certificate), None)


def _who_has(case: Case, certificate: int) -> str:
    """Who has a certificate that no enclave has, or one that was left out, as the beginning of a sentence."""
    system, view = case.system, case.view
    left_out = _left_out(system, certificate)
    if left_out is not None:
        return left_out
    who = f"Whoever is {shorten(system.certificates[certificate].label, MAX_SUBJECT)}"
    for number, enclave in enumerate(system.enclaves):
        if not view.authenticated(number) and certificate in same_elsewhere(system, number):
            return f"{who} beside {enclave.label}, whose certificate peers refuse,"
    unknown = any(each.identity is None for each in system.left_out) or any(each.opaque for each in system.enclaves)
    return f"{who}, which is no enclave {'that could be read' if unknown else 'of this keystore'},"


def then_at(system: System, answer: Answer) -> tuple[str, System]:
    """Since when it is so, where that is not now, and the system as it is then."""
    moment = answer.moment
    if moment is None:
        moment = 2 * (answer.path[0].instant if answer.path else system.now)
    index, after = divmod(moment, 2)
    since = f", {'after' if after else 'from'} {instant(system.instants[index])}{'' if after else ' on'}"
    return since if moment != 2 * system.now else "", moments.at(system, moment)


def route(system: System, claim: ClaimAtom, path: Sequence[Hop]) -> str:
    """`/random -> /low_priority -> /multiplexer -> ...`: participants and topics in turn."""

    def who(enclave: int | None) -> str:
        return "anybody on the network" if enclave is None else system.enclaves[enclave].label

    words = [] if claim.source.channels else [who(path[0].sender)]
    for number, hop in enumerate(path):
        words.append(_case(system, hop).topic)
        if number < len(path) - 1 or not claim.target.channels:
            words.append(who(hop.receiver))
    return " -> ".join(words)


def _case(system: System, hop: Hop) -> Case:
    """The channel of a hop as its receiver's peers protect it."""
    enclave = hop.receiver if hop.receiver is not None else hop.sender
    trust_domain = 0 if enclave is None else system.enclaves[enclave].trust_domain
    witness = {Role.TRUST_DOMAIN: trust_domain, Role.CHANNEL: hop.channel}
    return Case(system, witness if enclave is None else {**witness, Role.ENCLAVE: enclave})


def by_right(system: System, claim: ClaimAtom, path: Sequence[Hop]) -> bool:
    """Whether it needs no attack: at each hop, in one trust domain, who sends may write and who gets it may read.

    A flow begins and ends by itself at a channel that the claim names.
    """
    for number, hop in enumerate(path):
        honest = _case(system, hop).view.honest
        begins = number == 0 and bool(claim.source.channels)
        ends = number == len(path) - 1 and bool(claim.target.channels)
        sent = begins if hop.sender is None else honest(hop.sender).may_write >> hop.channel & 1
        got = ends if hop.receiver is None else honest(hop.receiver).may_read >> hop.channel & 1
        trust_domains = {system.enclaves[each].trust_domain for each in (hop.sender, hop.receiver) if each is not None}
        if not (sent and got) or len(trust_domains) != 1:
            return False
    return True


def hop_ways(system: System, claim: ClaimAtom, hop: Hop) -> list[Told]:
    """Why a sample gets over: one way for the end that sends and one for the end that gets it.

    A channel that the claim names is a place, where a flow begins or ends by itself.
    """
    case = _case(system, hop)
    ways: list[Told | None] = []
    for enclave, operation, place, alone in (
        (hop.sender, Operation.PUBLISH, claim.source, _shows_it(case, claim, hop)),
        (hop.receiver, Operation.SUBSCRIBE, claim.target, True),
    ):
        if enclave is not None:
            why, steps = way(case, enclave, operation, alone=alone)
            ways.append((f"{system.enclaves[enclave].label}: {why}" if why else "", steps))
        elif not place.channels:
            ways.append(as_anybody(case, operation, None))
    return [each for each in ways if each is not None]


def _shows_it(case: Case, claim: ClaimAtom, hop: Hop) -> bool:
    """Whether the sender need only make a writer: who gets the sample listens, or attacks, and asks for no right."""
    if hop.sender is None:
        return False
    if hop.receiver is None and not claim.target.channels:
        return True
    return claim.attacker is Attacker.RELAYS and not case.view.abilities(hop.sender).forges >> hop.channel & 1


def _shared_domain(case: Case, claim: ClaimAtom, when: str) -> Told:
    asked, rule = case.witness[Role.DOMAIN], case.domain_rule
    domain = case.system.domains[asked].label
    step = step_at(None if rule is None else rule.location, domain, channel=domain)
    both = [case.witness[role] for role in (Role.ENCLAVE, Role.OTHER)]
    joining, here = (
        [n for n in both if any((view.joined(n) | view.protection.unauthenticated) >> asked & 1 for view in peers)]
        for peers in (case.views, [case.view])
    )
    sides = claim.source.enclaves | claim.target.enclaves
    names = [_with_its_key(case.system, each, sides) for each in sorted(both, key=lambda each: each not in joining)]
    if both[0] == both[1]:
        text = f"As {names[0]} both sides {'may' if case.enclave.opaque else 'can'} join {domain}{when}."
    elif len(joining) == 1:
        text = (
            f"{names[0]} can join {domain}, where {names[1]} starts too, by what its own implementation makes of "
            f"its permissions{when}: it refuses nobody who may be there, and who attacks takes it."
        )
    else:
        how = "" if len(here) > 1 else ", each let in by other peers"
        if case.view.protection.unauthenticated >> asked & 1:
            how = ", where anybody is let in without an identity"
        text = f"{names[0]} and {names[1]} can both join {domain}{when}{how}."
    return text, (step,)


def _with_its_key(system: System, enclave: int, among: frozenset[int]) -> str:
    """An enclave, with who else has its key, or that nobody knows whose it is."""
    atom, key = system.enclaves[enclave], system.key_of(enclave)
    if atom.opaque:
        return f"{atom.label}, whose identity could not be read,"
    others = [system.enclaves[each].label for each in sorted(among - {enclave}) if system.key_of(each) == key]
    if key is None or not others:
        return atom.label
    return f"{atom.label}, whose key {some(others, 1)} {'have' if len(others) > 1 else 'has'} too,"


def forgers(system: System, claim: ClaimAtom) -> tuple[str, ...]:
    """Who is not among the permitted publishers and could pass for one with the keys that they hold; ANYBODY last."""
    asked = bits(claim.target.channels)
    names: dict[str, None] = {}
    permissions = Permissions(system)
    views = trust_domain_views(system, permissions)
    flows = Flows(system, views)
    foreign = [number for number in range(len(system.enclaves)) if number not in claim.source.enclaves]
    for view in views:
        for number in foreign:
            others = (view.abilities(other) for other in flows.acting(number) if other != number)
            forged = view.abilities(number).forges | union(able.forges | able.may_write for able in others)
            if forged & asked:
                names[system.enclaves[number].label] = None
        for certificate, able in view.elsewhere.items():
            if able.forges & asked and certificate not in claim.source.certificates:
                named = permissions.admitting(certificate, view.accepted)  # else by what could not be read alone
                who = shorten(system.certificates[certificate].label, MAX_SUBJECT) if named else UNREAD_IDENTITY
                names[_left_out(system, certificate) or f"whoever is {who}"] = None
    if any(view.injectable & asked for view in views):
        names[ANYBODY] = None
    return tuple(names)
