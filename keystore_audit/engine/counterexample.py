"""Says what a witness of an engine means, in the user's names and with the lines that cause it.

Both engines' witnesses are told by this module. Names in the texts are raw: whoever shows them escapes them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Final

from keystore_audit.engine.case import Case, Told, beyond_grants, not_excluded, step_at
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.formal.flow import Flows
from keystore_audit.model.formal.system import System
from keystore_audit.properties import stated
from keystore_audit.properties.result import Counterexample, Property, Role, Witness

PUBLISH: Final = Operation.PUBLISH
SUBSCRIBE: Final = Operation.SUBSCRIBE


def describe(system: System, prop: Property, witness: Witness) -> Counterexample:
    """Return the counterexample that `witness`, an assignment of `prop.roles` to atoms of `system`, stands for."""
    case = Case(system, witness)
    if (unread := not_excluded(system, *case.named())) is not None:
        return unread
    text, steps = _TELLERS[prop.id](case)
    return Counterexample(text=text, steps=steps)


# Who may take part.


def _anybody_joins(case: Case) -> Told:
    domain = case.system.domains[case.witness[Role.DOMAIN]].label
    location = None if case.domain_rule is None else case.domain_rule.location
    why = "allow_unauthenticated_participants is true there"
    step = step_at(location, "allow_unauthenticated_participants", channel=domain)
    return f"A participant without any identity may join {domain}: {why}.", (step,)


def _identity(case: Case) -> Told:
    number, authorities, certificates = case.enclave.identity, case.trust.identity_ca, case.system.certificates
    identity = certificates[number or 0]
    issuers = [certificates[each] for each in identity.issuers & authorities]
    why = _first(
        (not authorities, "there is no certificate of an identity CA"),
        (not issuers, "no certificate of its identity CA has issued it"),
        (number in case.trust.revoked, "its identity CA has revoked it"),
        (not case.permissions.in_force(identity.not_before, identity.not_after), "it is not in force"),
        (not any(issuer.authority for issuer in issuers), "its issuer may not issue certificates"),
        (True, "its issuer is not in force"),
    )
    text = f"Peers cannot trust the identity of {case.enclave.label} ({identity.label}): {why}."
    return text, (case.identity_step(case.enclave),)


def _first(*reasons: tuple[bool, str]) -> str:
    """The first reason that is so."""
    return next(why for so, why in reasons if so)


def _document(case: Case) -> Told:
    number, authorities = case.witness[Role.DOCUMENT], case.trust.permissions_ca
    document, who = case.system.documents[number], case.enclave.label
    signers = sorted(document.signers)
    signer = case.system.certificates[signers[0]].label if signers else ""
    why = _first(
        (not document.intact or not signers, "bears no signature that these implementations can verify"),
        (not authorities, f"is signed by {signer}, and there is no certificate of a permissions CA"),
        (number in case.view.genuine, f"is signed by {signer}, which is not in force"),
        (
            all(map(case.has_authority_key, signers)),
            f"names {signer} as its signer, another certificate with the permissions CA's key",
        ),
        (True, f"is signed by {signer}, not by the permissions CA alone"),
    )
    step = step_at(document.location, document.label, enclave=who)
    return f"{document.label}, which {who} uses, {why}.", (step,)


def _shared_key(case: Case) -> Told:
    one, other = case.enclave, case.system.enclaves[case.witness[Role.OTHER]]
    text = f"{one.label} and {other.label} have the same identity key, so each can pass for the other."
    return text, (case.identity_step(one), case.identity_step(other))


def _grants_itself(case: Case) -> Told:
    enclave, who = case.enclave, case.enclave.label
    steps = (case.identity_step(enclave),)
    if case.has_authority_key(enclave.identity):
        return f"{who} can sign its own permissions: its key is the permissions CA's key.", steps
    if enclave.identity is not None and case.view.self_granting(case.witness[Role.ENCLAVE]):
        return _signs(case, enclave.identity)
    what = who
    if enclave.document is not None:
        document = case.system.documents[enclave.document]
        what, steps = document.label, (step_at(document.location, document.label, enclave=who),)
    return f"{who} has permissions that peers accept although the permissions CA did not sign them: {what}.", steps


def _signs(case: Case, identity: int) -> Told:
    """By which certificate an enclave signs: its own, else one of its key, else one that may be anybody's."""
    certificates, below, enclave = case.system.certificates, case.view.signing_below, case.enclave
    authorities, keys, own = case.trust.permissions_ca, case.view.authority_keys, certificates[identity].key
    ranked = ((n != identity, certificates[n].key != own, n) for n in below if certificates[n].key not in keys)
    signing = min(ranked)[-1]
    signer = certificates[signing]
    whose = "its identity" if signing == identity else "a certificate of its key"
    if signer.key != own:
        whose = "a certificate whose key anybody may have"
    issued = "also issued" if signer.issuers & authorities else "is above"
    above_it = sorted((signer.issuers & below) - authorities - {signing})
    shown = [certificates[number] for number in (*([signing] if signing != identity else []), *above_it)]
    text = (
        f"{enclave.label} can sign its own permissions: the permissions CA {issued} {whose} ({signer.label}), and "
        "these implementations accept any signer that the CA issued."
    )
    steps = (step_at(each.location, each.label, enclave=enclave.label) for each in shown)
    return text, (case.identity_step(enclave), *steps)


def _one_authority(case: Case) -> Told:
    certificates = case.system.certificates
    one, other = (certificates[case.witness[role]] for role in (Role.CERTIFICATE, Role.OTHER_CERTIFICATE))
    alike = f"{one.label} is" if one is other else f"{one.label} and {other.label} have one key: it is"
    text = (
        f"{alike} both identity CA and permissions CA. Where the signer is not pinned, peers accept permissions "
        "signed by anybody with an identity from it."
    )
    return text, tuple(dict.fromkeys(step_at(each.location, each.label) for each in (one, other)))


def _shared_subject(case: Case) -> Told:
    one, other = case.enclave, case.system.enclaves[case.witness[Role.OTHER]]
    grants = [grant.location for grant in case.system.grants if {one.identity, other.identity} <= grant.names]
    named = (step_at(place, one.label) for place in grants[:1])
    text = f"A grant names both {one.label} and {other.label}: each has the rights of both."
    return text, (*named, case.identity_step(one), case.identity_step(other))


# What somebody without any key can do, and what grants do not bind.


def _outsider(
    does: str, *touched: Operation, why: Callable[[Case], str] = Case.kinds, door: bool = False
) -> Callable[[Case], Told]:
    """Anybody on the network can do something, since the kinds that apply do not keep it from that."""

    def tell(case: Case) -> Told:
        besides = case.open_door() if door else ""
        text = f"Anybody on the network {does.format(case.topic)}: {why(case)}{besides}."
        return text, case.governance_steps() + case.user_steps(*touched)

    return tell


def _unprotected(what: str, otherwise: str) -> Callable[[Case], str]:
    """Why the `what` of the topic, discovery or liveliness, is unprotected; `otherwise`: as whole messages are not."""
    flag, kind = f"enable_{what}_protection", f"{what}_protection_kind"

    def why(case: Case) -> str:
        if case.topic_rule is None or case.domain_rule is None:
            return case.kinds()
        on, value = getattr(case.topic_rule, flag), getattr(case.domain_rule, kind).value
        said = f"{kind} is {value}" if on else f"{flag} is false for it"
        return f"{said}, and whole messages are not {otherwise}"

    return why


def _unenforced(case: Case) -> Told:
    """Which access control is off: one for which there is a grant to ask for, if all grants could be read."""
    topic_rule, domain_rule = case.topic_rule, case.domain_rule
    if topic_rule is None or domain_rule is None:
        why, off = case.kinds(), case.governance_steps()
    else:
        controls = (
            ("write", topic_rule.enable_write_access_control, topic_rule.location, (PUBLISH,)),
            ("read", topic_rule.enable_read_access_control, topic_rule.location, (SUBSCRIBE,)),
            ("join", domain_rule.enable_join_access_control, domain_rule.location, (PUBLISH, SUBSCRIBE)),
        )
        kind, _is_on, place, _asked = min(controls, key=lambda each: (each[1], not case.granted_steps(*each[3])))
        why, off = f"enable_{kind}_access_control is false", (case.step(place),)
    text = f"The grants on {case.topic} are not enforced: {why}."
    return text, (*off, *case.granted_steps(PUBLISH, SUBSCRIBE))


def _insider(does: str, operation: Operation) -> Callable[[Case], Told]:
    def tell(case: Case) -> Told:
        why, steps = beyond_grants(case, operation)
        text = f"{case.enclave.label} can {does.format(f'{case.topic} without a grant of the permissions CA')}: {why}."
        return text, steps

    return tell


def _reader_forges(case: Case) -> Told:
    text = (
        f"{case.enclave.label}, which may only subscribe to {case.topic}, can forge it: readers and the writer "
        f"share one key, and origin authentication of submessages is off ({case.kinds()})."
    )
    return text, case.right_steps(case.witness[Role.ENCLAVE], SUBSCRIBE) + case.governance_steps()


def _relay_reads(case: Case) -> Told:
    text = (
        f"{case.enclave.label}, which may only relay {case.topic}, can read it: relays hold the keys of "
        f"submessages, and the payload is not encrypted by itself ({case.kinds()})."
    )
    return text, case.right_steps(case.witness[Role.ENCLAVE], Operation.RELAY) + case.governance_steps()


def _bridge(case: Case) -> Told:
    enclave, channel = case.witness[Role.ENCLAVE], case.witness[Role.OTHER_CHANNEL]
    trust_domain, writer = next(_feeding(case, channel), (case.trust_domain, enclave))
    there = case.at({Role.TRUST_DOMAIN: trust_domain, Role.CHANNEL: channel})
    other = case.system.enclaves[writer]
    guise = "" if writer == enclave else f" as {other.label}, whose key it has"
    text = (
        f"{case.enclave.label} can read {case.topic} and write {there.topic}{guise}: data can get from the first "
        "to the second."
    )
    reads = case.right_steps(enclave, SUBSCRIBE) or case.governance_steps()
    return text, reads + (there.right_steps(writer, PUBLISH) or there.governance_steps())


def _feeding(case: Case, channel: int) -> Iterator[tuple[int, int]]:
    """The trust domains in which the enclave feeds a channel, its own first; and as whom: itself, if it does."""
    enclave = case.witness[Role.ENCLAVE]
    for who in (enclave, *Flows(case.system, case.views).acting(enclave)):
        for trust_domain in (case.trust_domain, *range(len(case.views))):
            able = case.views[trust_domain].abilities(who)
            if (able.may_write | able.forges) >> channel & 1:
                yield trust_domain, who


_TELLERS: Final[Mapping[str, Callable[[Case], Told]]] = {
    stated.ONLY_AUTHENTICATED_JOIN.id: _anybody_joins,
    stated.IDENTITIES_CHAIN.id: _identity,
    stated.DOCUMENTS_SIGNED.id: _document,
    stated.NO_SHARED_IDENTITY.id: _shared_key,
    stated.NO_SELF_GRANTED_RIGHTS.id: _grants_itself,
    stated.ONE_CA_FOR_ONE_ROLE.id: _one_authority,
    stated.NO_SHARED_SUBJECT.id: _shared_subject,
    stated.OUTSIDERS_CANNOT_READ.id: _outsider("can read {}", PUBLISH),
    stated.OUTSIDERS_CANNOT_LEARN_NAMES.id: _outsider(
        "learns of {}", PUBLISH, SUBSCRIBE, why=_unprotected("discovery", "encrypted")
    ),
    stated.OUTSIDERS_CANNOT_INJECT.id: _outsider("can send samples on {}", SUBSCRIBE, door=True),
    stated.OUTSIDERS_CANNOT_REPLAY.id: _outsider(
        "can replay recorded samples of {}, and forge the messages that say what was sent", SUBSCRIBE, door=True
    ),
    stated.OUTSIDERS_CANNOT_FORGE_LIVELINESS.id: _outsider(
        "can assert that a writer of {} is alive", SUBSCRIBE, why=_unprotected("liveliness", "authenticated"), door=True
    ),
    stated.GRANTS_ARE_ENFORCED.id: _unenforced,
    stated.NOBODY_WRITES_WITHOUT_A_GRANT.id: _insider("publish {}, and peers accept it", PUBLISH),
    stated.NOBODY_READS_WITHOUT_A_GRANT.id: _insider("read {}", SUBSCRIBE),
    stated.READERS_CANNOT_FORGE.id: _reader_forges,
    stated.RELAYS_CANNOT_READ.id: _relay_reads,
    stated.NO_BRIDGES.id: _bridge,
}
