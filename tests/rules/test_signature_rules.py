"""KA3: who signed, in what form, and who takes it. One document yields its most specific finding."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace

from keystore_audit.findings import Severity
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.document import Readings
from keystore_audit.keystore.files import Status
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.smime import Signature
from keystore_audit.profiles import DEFAULT, VARIANTS, implementations
from keystore_audit.rules.subjects import UNPINNED
from tests.rules.evidence import (
    DAY,
    PERMISSIONS_CA,
    START,
    Change,
    absent,
    becomes,
    certificates,
    codes,
    defect,
    findings,
    first,
    grant,
    healthy,
    judged,
    open_codes,
    pem,
    permissions,
    signature,
    signed,
    talker,
)
from tests.rules.test_certificate_rules import one_authority

P7S = "enclaves/talker/permissions.p7s"
CA = first("public/permissions_ca.cert.pem", PERMISSIONS_CA)
STRANGER = first(P7S, pem("permissionsCA", label="stranger", issuer="permissionsCA", issuer_label="stranger"))
RENEWED = first(P7S, pem("permissionsCA", label="permissionsCA", issuer="permissionsCA", start=START + DAY))
IDENTITY = first("enclaves/talker/cert.pem", pem("/talker"))
GHOST = first(P7S, pem("/ghost", issuer="permissionsCA"))


def by(*signatures: Signature, kinds: tuple[Kind, ...] = (), unread: bool = False, **fields: Any) -> Change:
    """The talker's permissions with these signatures and defects; `unread`: nothing could be separated from it."""
    document = signed(P7S, *signatures, defects=tuple(defect(kind, P7S) for kind in kinds))
    document = replace(document, **fields)
    if unread:
        return talker(
            permissions=permissions(P7S, signed=replace(document, content=None), readings=Readings(by_syntax={}))
        )
    return talker(permissions=permissions(P7S, grant("/talker"), signed=document))


@pytest.mark.parametrize(
    ("made", "code"),
    [
        (signature(STRANGER, named=(), verified_by=()), "KA301"),  # its certificate is nowhere
        (signature(STRANGER, named=()), "KA301"),  # the key is known, under another serial number
        (signature(IDENTITY, named=()), "KA301"),
        (signature(CA, verified_by=()), "KA303"),  # names the CA, whose key did not make it
        (signature(CA, digest_matches=False), "KA303"),
        (signature(CA, named=()), "KA316"),  # names a certificate that is nowhere, made by the CA's key
        (signature(CA, named=(CA,), verified_by=(CA, RENEWED)), None),
        (signature(CA, digest_matches=None), None),
    ],
)
def test_each_signature_has_one_maker(made: Signature, code: str | None) -> None:
    assert becomes(by(made)) == ([] if code is None else [code])


def self_signed(store: Keystore, signer: Certificate = IDENTITY) -> Keystore:
    """The talker's permissions signed by its identity, under one authority for both roles."""
    store = one_authority(store)
    document = permissions(P7S, grant("/talker"), signed=signed(P7S, signature(signer)))
    return replace(store, enclaves=(replace(store.enclaves[0], permissions=document), *store.enclaves[1:]))


def test_who_refuses_what_the_permissions_ca_signed() -> None:
    (without,) = findings("KA317", judged(by(embedded=())(healthy())))
    assert without.profiles == ("fastdds-2.6.4", "fastdds-2.9", "cyclonedds-0.10")
    assert "the message does not hold the signer's certificate" in without.message
    pinning = (VARIANTS["cyclonedds-11"],)
    (elsewhere,) = findings("KA317", judged(by(embedded=())(healthy()), profiles=pinning))
    assert (without.severity, elsewhere.severity) == (Severity.HIGH, Severity.LOW), "nobody chosen refuses it"
    ca = certificates("public/permissions_ca.cert.pem", pem("oldCA", issuer="oldCA"), PERMISSIONS_CA)
    (second, *_) = findings("KA317", judged(talker(permissions_ca=ca)(healthy())))
    assert second.profiles == ("cyclonedds-0.10", "cyclonedds-11", "opendds")
    assert "the first certificate alone is read" in second.message
    ca = certificates("public/permissions_ca.cert.pem", PERMISSIONS_CA, pem("newCA", issuer="newCA"))
    unknown = replace(ca.certificates[0], signature_algorithm="ecdsa-with-SHA384")
    passing_over = replace(ca, certificates=(unknown, *ca.certificates[1:]))
    (behind, *_) = findings("KA317", judged(talker(permissions_ca=passing_over)(healthy())))
    assert all(profile.startswith("fastdds-") for profile in behind.profiles)
    assert "nothing before the first certificate with a signature algorithm that it knows is read" in behind.message
    assert "alone" not in behind.message


def test_who_takes_what_an_identity_signed_for_itself() -> None:
    found = findings("KA302", judged(self_signed(healthy())))
    assert [finding.enclave for finding in found] == ["/talker"]
    told = found[0].message.partition("accepted by")[2].rstrip(".").split("; ")
    accepted, refused, beyond, _expected = told
    in_scope = [VARIANTS[name] for name in DEFAULT]
    assert accepted.strip() == implementations(profile for profile in UNPINNED if profile in in_scope)
    assert "Cyclone DDS 0.10 (Humble, Jazzy, Kilted)" in accepted
    pinning = [profile for profile in in_scope if profile.trust.pins_signer]
    assert refused == f"refused by {implementations(pinning)}"
    outside = implementations(profile for profile in UNPINNED if profile not in in_scope)
    assert beyond == f"beyond the scope accepted by {outside}"
    (pinned,) = findings("KA302", judged(self_signed(healthy()), profiles=tuple(pinning)))
    assert "serial number" in pinned.message
    refused = f"is refused by {implementations(pinning)}"
    assert f"{refused}; beyond the scope accepted by {implementations(UNPINNED)}; expected" in pinned.message
    assert codes(self_signed(healthy())) == ["KA222", "KA302"]


def test_a_certificate_of_the_authority_that_no_enclave_has_is_one_of_its_identities() -> None:
    found = findings("KA302", judged(by(signature(GHOST))(healthy())))
    assert "a certificate that the permissions CA issued" in found[0].message
    assert "accepted by" in found[0].message
    assert len(found[0].locations) == 1  # the certificate is inside the message


def test_what_an_unreadable_authority_may_accept_is_open() -> None:
    """A robot may read the CA file that we did not, so what the document says is not without consequence."""
    away = absent("enclaves/talker/permissions_ca.cert.pem", Status.OUTSIDE, "elsewhere")
    ambiguous = permissions(P7S, defects=(defect(Kind.XML_AMBIGUOUS, P7S),))
    change = talker(permissions_ca=None, files={Role.PERMISSIONS_CA: away}, permissions=ambiguous)
    assert becomes(change) == ["KA103", "KA502"]
    assert open_codes(change(healthy())) == {"KA103", "KA502"}
