"""Says what a witness about identities, documents and authorities means."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from keystore_audit.engine import causes
from keystore_audit.engine.counterexample_case import Case, step_at
from keystore_audit.model.formal.system import EnclaveAtom, System
from keystore_audit.properties import stated
from keystore_audit.properties.counterexample import Counterexample, Step
from keystore_audit.properties.property import Role


def _anybody_joins(case: Case) -> Counterexample:
    domain = case.system.domains[case.witness[Role.DOMAIN]].label
    rule = causes.domain_rule(case.system, case.realm, case.witness[Role.DOMAIN])
    if case.is_open or rule is None:
        location = None if case.governance is None else case.governance.location
        why = "the governance document could not be read, so it may allow that"
    else:
        location, why = rule.location, "allow_unauthenticated_participants is true there"
    step = step_at(location, "allow_unauthenticated_participants", channel=domain)
    return Counterexample(text=f"A participant without any identity may join {domain}: {why}.", steps=(step,))


def _identity(case: Case) -> Counterexample:
    enclave = case.enclave
    if enclave.opaque or enclave.identity is None:
        step = step_at(enclave.location, enclave.label, enclave=enclave.label)
        return Counterexample(
            text=f"The identity of {enclave.label} could not be read: it may be anybody.", steps=(step,)
        )
    return Counterexample(
        text=f"The identity of {enclave.label} ({case.system.certificates[enclave.identity].label}) is not one that "
        f"its peers may trust: {_distrust(case.system, enclave.realm, enclave.identity)}.",
        steps=(identity_step(case.system, enclave),),
    )


def _distrust(system: System, realm_index: int, identity_index: int) -> str:
    """Say why an identity is not vouched for, in force and unrevoked."""
    realm = system.realms[realm_index]
    identity = system.certificates[identity_index]
    if causes.is_unread(system, realm.identity_ca):
        return "the identity CA file could not be read"
    if not realm.identity_ca:
        return "there is no certificate of an identity CA"
    issuers = [system.certificates[number] for number in identity.issuers & realm.identity_ca]
    if not issuers:
        return "no certificate of its identity CA has issued it"
    if identity_index in realm.revoked:
        return "its identity CA has revoked it"
    if not causes.in_force(system, identity):
        return "it is not in force"
    if not any(issuer.authority for issuer in issuers):
        return "its issuer may not issue certificates"
    return "its issuer is not in force"


def _document(case: Case) -> Counterexample:
    document = case.system.documents[case.witness[Role.DOCUMENT]]
    signers = sorted(document.signers)
    enclave = case.enclave
    signer = case.system.certificates[signers[0]].label if signers else ""
    if document.opaque:
        why = "could not be read, so nobody knows who signed it"
    elif not document.intact or not signers:
        why = "bears no signature that these implementations can verify"
    elif causes.is_unread(case.system, case.system.realms[enclave.realm].permissions_ca):
        why = f"is signed by {signer}, and the permissions CA file could not be read"
    elif not case.system.realms[enclave.realm].permissions_ca:
        why = f"is signed by {signer}, and there is no certificate of a permissions CA"
    elif causes.signed_by_ca(case.system, enclave.realm, document):
        why = f"is signed by {signer}, which is not in force"
    elif all(causes.has_authority_key(case.system, enclave.realm, each) for each in signers):
        why = f"names {signer} as its signer, which has the permissions CA's key and is another certificate"
    else:
        why = f"is signed by {signer}, not by the permissions CA alone"
    step = step_at(document.location, document.label, enclave=enclave.label)
    return Counterexample(text=f"{document.label}, which {enclave.label} uses, {why}.", steps=(step,))


def _shared_key(case: Case) -> Counterexample:
    one, other = case.enclave, case.system.enclaves[case.witness[Role.OTHER]]
    if one.opaque:
        text = f"The identity of {one.label} could not be read: it may be that of another enclave."
        concerned = [one]
    else:
        text = f"{one.label} and {other.label} have the same identity key, so each can pass for the other."
        concerned = [one, other]
    return Counterexample(text=text, steps=tuple(identity_step(case.system, enclave) for enclave in concerned))


def identity_step(system: System, enclave: EnclaveAtom) -> Step:
    """The step that shows who an enclave is."""
    if enclave.identity is None:
        return step_at(enclave.location, enclave.label, enclave=enclave.label)
    identity = system.certificates[enclave.identity]
    return step_at(identity.location, identity.label, enclave=enclave.label)


def _grants_itself(case: Case) -> Counterexample:
    enclave = case.enclave
    steps = [identity_step(case.system, enclave)]
    if enclave.opaque:
        text = f"The identity of {enclave.label} could not be read: it may be one that signs permissions."
    elif causes.is_unread(case.system, case.system.realms[case.realm].permissions_ca):
        text = f"A permissions CA file could not be read: {enclave.label} may be one that signs permissions."
    elif causes.has_authority_key(case.system, case.realm, enclave.identity):
        text = f"{enclave.label} can sign itself permissions: its key is that of the permissions CA."
    elif enclave.identity is not None and case.view.self_granting(case.witness[Role.ENCLAVE]):
        signing = _signing(case, enclave.identity)
        signer = case.system.certificates[signing]
        authorities = case.system.realms[case.realm].permissions_ca
        issued = signer.issuers & authorities
        whose = "its identity" if signing == enclave.identity else "a certificate of its key"
        if signer.key != case.system.certificates[enclave.identity].key:
            whose = "a certificate of whose key nobody knows who has it"
        cause = f"the permissions CA {'also issued' if issued else 'is above'} {whose} ({signer.label})"
        above_it = sorted((signer.issuers & case.view.signing_below) - authorities - {signing})
        shown = [*([signing] if signing != enclave.identity else []), *above_it]
        steps += [
            step_at(each.location, each.label, enclave=enclave.label)
            for each in (case.system.certificates[number] for number in shown)
        ]
        text = (
            f"{enclave.label} can sign itself permissions: {cause}, and these implementations accept any signer that "
            "the CA issued."
        )
    else:
        document = None if enclave.permissions is None else case.system.documents[enclave.permissions]
        name = enclave.label if document is None else document.label
        text = f"{enclave.label} has permissions that the permissions CA did not sign and peers accept: {name}."
        if document is not None and document.opaque:
            text = (
                f"{name}, which {enclave.label} uses, could not be read: the permissions CA may not have signed it, "
                "and peers may accept it."
            )
        if document is not None:
            steps = [step_at(document.location, document.label, enclave=enclave.label)]
    return Counterexample(text=text, steps=tuple(steps))


def _signing(case: Case, identity: int) -> int:
    """The certificate by which the enclave signs: its own, else one of its key, else one that may be anybody's."""
    certificates, below = case.system.certificates, case.view.signing_below
    authorities = {certificates[number].key for number in case.system.realms[case.realm].permissions_ca}
    own = certificates[identity].key
    ranked = ((n != identity, certificates[n].key != own, n) for n in below if certificates[n].key not in authorities)
    return min(ranked)[-1]


def _one_authority(case: Case) -> Counterexample:
    certificates = case.system.certificates
    roles = (Role.CERTIFICATE, Role.OTHER_CERTIFICATE)
    one, other = (certificates[case.witness[role]] for role in roles)
    if one.opaque:
        step = step_at(one.location, one.label)
        text = "CA files could not be read: identity CA and permissions CA may have one key."
        return Counterexample(text=text, steps=(step,))
    alike = f"{one.label} is" if one is other else f"{one.label} and {other.label} have one key: it is"
    steps = (step_at(each.location, each.label) for each in (one, other))
    return Counterexample(
        text=f"{alike} identity CA and permissions CA, so whoever has an identity of it passes for a signer of "
        "permissions wherever the signer is not pinned.",
        steps=tuple(dict.fromkeys(steps)),
    )


def _shared_subject(case: Case) -> Counterexample:
    one, other = case.enclave, case.system.enclaves[case.witness[Role.OTHER]]
    if one.opaque:
        step = step_at(one.location, one.label, enclave=one.label)
        return Counterexample(
            text=f"The identity of {one.label} could not be read: grants for others may name it too.", steps=(step,)
        )
    wanted = {one.identity, other.identity}
    grants = [grant.location for grant in case.system.grants if wanted <= grant.names]
    if not grants and (document := causes.opaque_document(case.system)):
        step = step_at(document.location, document.label)
        text = f"{document.label} could not be read: a grant in it may name {one.label} and {other.label} alike."
        return Counterexample(text=text, steps=(step,))
    named = tuple(step_at(place, one.label) for place in grants[:1])
    return Counterexample(
        text=f"A grant names {one.label} and {other.label} alike: each has the rights of both.",
        steps=(*named, *(identity_step(case.system, enclave) for enclave in (one, other))),
    )


TELLERS: Final[Mapping[str, Callable[[Case], Counterexample]]] = {
    stated.ONLY_AUTHENTICATED_JOIN.id: _anybody_joins,
    stated.IDENTITIES_CHAIN.id: _identity,
    stated.DOCUMENTS_SIGNED.id: _document,
    stated.NO_SHARED_IDENTITY.id: _shared_key,
    stated.NO_SELF_GRANTED_RIGHTS.id: _grants_itself,
    stated.ONE_CA_FOR_ONE_ROLE.id: _one_authority,
    stated.NO_SHARED_SUBJECT.id: _shared_subject,
}
"""By property."""
