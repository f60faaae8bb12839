"""KA2: revocation lists (RFC 5280, 5 and 6.3; ros2/rmw_dds_common reads crl.pem)."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from typing import Any

from keystore_audit.findings import Act, Location, Remedy, Severity, decision
from keystore_audit.keystore.crl import RevocationList, same_name
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.issuer import crl_signed_by
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.model.trust.chain import chain_refusal
from keystore_audit.model.trust.revocation import NO_IDENTITIES, list_missing, names_revoked
from keystore_audit.profiles import VARIANTS, implementations
from keystore_audit.rules.registry import (
    Context,
    Violation,
    defective,
    listed,
    located,
    of_kinds,
    paths,
    quoted,
    rule,
    sole,
)
from keystore_audit.rules.subjects import READS_LISTS_OF_CA_FILES, RevocationUse, revocation_uses
from keystore_audit.text import counted, instant
from keystore_audit.truth import Truth


def new_list(first: str = "") -> Remedy:
    """Another list; `first` says what else to do."""
    return decision(
        f"{first}Sign a new list of every identity revoked so far with the identity CA (`openssl ca -gencrl`), "
        "and copy it as crl.pem into every enclave."
    )


def _reads(use: RevocationUse) -> tuple[str, ...]:
    """The variants that read the lists: all, but of lists in a CA file Fast DDS alone (measured)."""
    return READS_LISTS_OF_CA_FILES if use.in_ca_file else ()


def _about(use: RevocationUse, revocations: RevocationList, message: str, key: str, **more: Any) -> Violation:
    """A violation about one of the lists; `key` tells it from others about the same issuer's."""
    return Violation(
        message,
        (located(revocations),),
        profiles=_reads(use),
        key=key,
        **more,
    )


def _signed(use: RevocationUse, revocations: RevocationList) -> Truth:
    """Whether an identity CA of the enclaves signed the list."""
    answers = [crl_signed_by(revocations, authority) for authority in use.authorities]
    return next((each for each in (Truth.YES, Truth.UNKNOWN) if each in answers), Truth.NO)


@rule(
    "KA212",
    Severity.HIGH,
    "RFC 5280, 6.3.3; DDS-Security 1.1, 9.3.1 (dds.sec.auth.identity_crl)",
    decision("Remove the enclave from the keystore, or give it a new identity.", Act.ISSUE),
    explains=("identities-chain-to-the-identity-ca",),
    stops=True,
)
def identity_revoked(keystore: Keystore) -> Iterator[Violation]:
    """A revocation list of this keystore names an enclave's identity: whoever carries the list refuses the enclave.

    Other enclaves accept it as before. Lists that no identity CA signed revoke nothing here.
    """
    lists = [
        (use, revocations)
        for use in revocation_uses(keystore)
        for revocations in use.in_use
        if revocations.revoked and _signed(use, revocations).must
    ]
    for enclave in keystore.enclaves:
        first = enclave.identity
        found = [(use, each) for use, each in lists if first is not None and names_revoked(each, first)]
        if first is not None and found:
            holders = {holder.path: holder for use, _ in found for holder in use.enclaves}
            yield Violation(
                f"The identity {quoted(first.subject)} of {enclave.path} is revoked by {found[0][1].path}: "
                f"refused by {paths(holders.values())}.",
                (located(first), *(located(r, "the revocation list") for _use, r in found)),
                enclave=enclave.path,
                profiles=READS_LISTS_OF_CA_FILES if all(use.in_ca_file for use, _ in found) else (),
                key=first.key,
            )


@rule(
    "KA213",
    Severity.HIGH,
    "RFC 5280, 5 and 6.3.3 (f), (g)",
    new_list(),
    stops=True,
)
def crl_invalid(use: RevocationUse, context: Context) -> Iterator[Violation]:
    """The revocation list does not parse, or the identity CA did not make it: it revokes nothing.

    OpenSSL finds no list that it can use, and refuses every identity: the enclaves that carry it talk to nobody.
    """
    yield from defective(of_kinds(use.defects, Kind.CRL_UNREADABLE), "whom it revokes is unknown.", undecided=True)
    yield from defective(
        of_kinds(use.defects, Kind.CERTIFICATE_FILE_EXTRA),
        "run times read the first list.",
        severity=Severity.MEDIUM,
    )
    found = False
    for revocations in use.in_use:
        why, undecided = _why_invalid(use, revocations)
        if why:
            found = True
            message = f"The revocation list of {paths(use.enclaves)} is not one that its identity CA made: {why}."
            key = f"{revocations.issuer} {revocations.this_update}"
            yield _about(use, revocations, message, key, undecided=undecided)
    if use.in_use and not found:
        yield from _of_another_issuer(use, context.at)


def _of_another_issuer(use: RevocationUse, at: datetime) -> Iterator[Violation]:
    """Lists that some certificate of the CA file made, but not the one that OpenSSL takes for their issuer."""
    refused: dict[tuple[str, ...], list[Enclave]] = {}
    for enclave in use.enclaves:
        first = enclave.identity
        file = enclave.identity_ca
        if first is None or file is None:
            continue
        refusing = tuple(
            name
            for name, profile in VARIANTS.items()
            if chain_refusal(first, file, profile.trust) is None
            and (list_missing(enclave, first, profile.trust) or list_missing(enclave, first, profile.trust, at))
        )
        if refusing:
            refused.setdefault(refusing, []).append(enclave)
    for names, enclaves in refused.items():
        revocations = use.in_use[0]
        yield Violation(
            f"No revocation list can be used for {paths(enclaves)} by "
            f"{implementations(VARIANTS[name] for name in names)}. On the identity's chain, the first certificate "
            "named "
            f"{quoted(revocations.issuer)} did not sign it or may not sign lists (keyUsage), or there is none.",
            (located(revocations),),
            enclave=sole(enclaves),
            profiles=names,
            key=" ".join(["issuer", *names, *(enclave.path for enclave in enclaves)]),
        )


def _why_invalid(use: RevocationUse, revocations: RevocationList) -> tuple[str, bool]:
    """What is wrong with the list, empty if nothing; and whether it may be right all the same."""
    if not use.authorities:
        return "", False  # whose certificate is missing or unreadable is said elsewhere
    if revocations.unknown_critical:
        return f"it has critical extensions that OpenSSL refuses, {listed(revocations.unknown_critical)}", False
    named = [ca for ca in use.authorities if same_name(ca.subject_name, revocations.issuer_name)]
    if not named:
        expected = quoted(use.authorities[0].subject)
        return f"got the issuer {quoted(revocations.issuer)}, expected {expected}", False
    signed = _signed(use, revocations)
    if signed is Truth.UNKNOWN:
        return f"its signature ({revocations.signature_algorithm}) cannot be verified here", True
    if signed is Truth.NO:
        return f"both say {quoted(revocations.issuer)}, but another key signed", False
    if all(ca.key_usage is not None and "cRLSign" not in ca.key_usage for ca in named):
        return "the keyUsage of the identity CA does not let it sign revocation lists", False
    identities = [enclave.identity for enclave in use.enclaves if enclave.identity is not None]
    issuing = [each for each in identities if each.is_ca]
    fitting = {"onlyContainsUserCerts"} if not issuing else set()
    if issuing and len(issuing) == len(identities):
        fitting = {"onlyContainsCACerts"}
    scope = revocations.scope - fitting
    if scope & (NO_IDENTITIES - ({"onlyContainsCACerts"} if issuing else frozenset())):
        return f"it holds no identities ({listed(sorted(scope))})", False
    if scope:
        return f"whether its scope fits the identities is not worked out ({listed(sorted(scope))})", True
    return "", False


@rule(
    "KA214",
    Severity.HIGH,
    "RFC 5280, 5.1.2.4 and 5.1.2.5 (thisUpdate, nextUpdate); measured",
    new_list(),
    stops=True,
)
def crl_stale(use: RevocationUse, context: Context) -> Iterator[Violation]:
    """The revocation list is past its nextUpdate or before its thisUpdate: OpenSSL then refuses every identity.

    The enclaves that carry it talk to nobody (measured on Fast DDS and Cyclone DDS).
    """
    for revocations in use.in_use:
        ended = revocations.next_update is not None and revocations.next_update < context.at
        if not ended and revocations.this_update <= context.at:
            continue
        when = (
            f"was to be replaced by {instant(revocations.next_update)}"
            if ended and revocations.next_update is not None
            else f"begins at {instant(revocations.this_update)}"
        )
        yield _about(
            use,
            revocations,
            f"The revocation list of {paths(use.enclaves)} {when} (audited for {instant(context.at)}): with it, every "
            "identity is refused.",
            f"{revocations.issuer} {revocations.this_update} {revocations.next_update}",
        )


@rule(
    "KA215",
    Severity.MEDIUM,
    "DDS-Security 1.1, 9.3.1 (dds.sec.auth.identity_crl); measured: each peer asks its own list only",
    decision("Put the newest crl.pem into every enclave."),
)
def crl_not_everywhere(keystore: Keystore) -> Iterator[Violation]:
    """Some enclaves carry a revocation list and others none, or another one.

    A revoked identity is refused only where the list is. The bytes are compared; an unreadable list counts as another
    one.
    """
    lists: dict[str | None, list[Enclave]] = {}
    for enclave in keystore.enclaves:
        file = enclave.files.files[Role.CRL]
        lists.setdefault("unread" if file.status.unknown else file.sha256, []).append(enclave)
    without = lists.pop(None, [])
    if not lists or (len(lists) == 1 and not without):
        return
    holders = sorted(lists.values(), key=len, reverse=True)
    said = [f"{len(holders)} different lists are in use, one by {paths(holders[-1])}"] if len(holders) > 1 else []
    said += [f"{paths(without)} {'has' if len(without) == 1 else 'have'} none"] if without else []
    yield Violation(
        f"Revocation does not hold everywhere: {'; '.join(said)}.",
        [Location(enclave.files.files[Role.CRL].place) for group in (without, *reversed(holders)) for enclave in group],
    )


@rule(
    "KA229",
    Severity.HIGH,
    "RFC 5280, 5.2.4 (delta lists) and 6.3.3; measured: run times read the first list of crl.pem",
    new_list("Use one complete list. "),
)
def revocation_without_effect(use: RevocationUse) -> Iterator[Violation]:
    """Revoked identities are still accepted: the list is a delta, a second list, or has entries that are ignored.

    OpenSSL, as the implementations call it, takes a delta for a complete list (measured): what its base revokes is
    accepted again.
    """
    for revocations in use.in_use:
        if revocations.delta:
            yield _about(
                use,
                revocations,
                f"The revocation list of {paths(use.enclaves)} is a delta, which holds only changes: what the list "
                "before it revokes is accepted.",
                f"delta {revocations.issuer}",
            )
        if revocations.passed_over:
            serials = [f"{serial:X}" for serial in sorted(revocations.passed_over)]
            yield _about(
                use,
                revocations,
                f"Run times ignore {counted(len(serials), 'entry', 'entries')} in the revocation list of "
                f"{paths(use.enclaves)}, of another issuer (certificateIssuer) or behind one that takes the number "
                f"back: {listed(serials)}.",
                f"entries {revocations.issuer} {' '.join(serials)}",
            )
    for revocations in use.lists[len(use.in_use) :]:
        first = use.lists[0]
        known = first.revoked if same_name(first.issuer_name, revocations.issuer_name) else frozenset()
        unheard = sorted(revocations.revoked - known)
        if unheard:
            yield Violation(
                f"Run times read only the first revocation list of {paths(use.enclaves)}, and one behind it "
                f"revokes {len(unheard)} more: {listed([f'{serial:X}' for serial in unheard])}.",
                (located(revocations), located(first, "the list that is read")),
                key=" ".join([revocations.issuer, *(f"{serial:X}" for serial in unheard)]),
            )
