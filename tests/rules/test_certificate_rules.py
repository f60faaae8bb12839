"""KA2: one change each to real certificates and revocation lists makes a rule speak, and no other."""

from __future__ import annotations

from datetime import timedelta
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import dsa
from cryptography.hazmat.primitives.serialization import Encoding
from msgspec.structs import replace

from keystore_audit.findings import Act, Severity
from keystore_audit.keystore.certificate import CertificateFile
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.layout import LayoutKind
from keystore_audit.model.question import Usability
from keystore_audit.profiles import VARIANTS
from keystore_audit.rules import BY_CODE
from keystore_audit.rules.certificate import weak_signature_algorithm
from keystore_audit.rules.subjects import certificate_uses
from keystore_audit.truth import Truth
from tests.keystore.builder import key, name
from tests.rules.evidence import (
    AT,
    DAY,
    END,
    IDENTITY_CA,
    START,
    Change,
    allow,
    becomes,
    both,
    certificates,
    codes,
    context,
    crl,
    enclave,
    findings,
    first,
    governance,
    grant,
    healthy,
    joined,
    judged,
    keystore,
    meaning,
    open_codes,
    pem,
    permissions,
    private_key,
    signature,
    signed,
    talker,
    text,
)

CERT = "enclaves/talker/cert.pem"
CRL = "enclaves/talker/crl.pem"
CA = "public/identity_ca.cert.pem"


def identity(**fields: Any) -> Change:
    """The talker with another certificate for the same key, and a grant that ends before it does."""
    content = pem("/talker", **fields)
    end = min(fields.get("end", END), END) - timedelta(seconds=1)
    rights = grant("/talker", not_after=text(f"{max(end, AT + 40 * DAY):%Y-%m-%dT%H:%M:%S}"))
    return talker(
        certificate=certificates(CERT, content),
        key=private_key("enclaves/talker/key.pem", "/talker", key=first(CERT, content).key),
        permissions=permissions("enclaves/talker/permissions.p7s", rights),
    )


def changed(file: CertificateFile, **fields: Any) -> CertificateFile:
    """The file with fields of its first certificate replaced: what the library does not write."""
    return replace(file, certificates=(replace(file.certificates[0], **fields), *file.certificates[1:]))


def one_authority(store: Keystore) -> Keystore:
    """The healthy keystore as sros2 makes it: one authority for both roles."""
    ca = certificates("public/ca.cert.pem", IDENTITY_CA)
    by_ca = signature(ca.certificates[0])
    return keystore(
        *(
            enclave(
                old.path,
                identity_ca=ca,
                permissions_ca=ca,
                governance=governance(signed=signed("enclaves/governance.p7s", by_ca)),
                permissions=permissions(
                    f"enclaves{old.path}/permissions.p7s",
                    grant(old.path),
                    signed=signed(f"enclaves{old.path}/permissions.p7s", by_ca),
                ),
            )
            for old in store.enclaves
        )
    )


SERIAL = first(CERT, pem("/talker")).serial
BROKEN = b"-----BEGIN CERTIFICATE-----\nMAA=\n-----END CERTIFICATE-----\n"


def test_what_an_expired_certificate_explains_depends_on_its_role() -> None:
    use = both(
        permissions_ca=certificates(
            "public/permissions_ca.cert.pem", pem("permissionsCA", issuer="permissionsCA", end=AT - DAY)
        )
    )
    rule = BY_CODE["KA203"]
    violations = [v for subject in subjects(use(healthy())) for v in rule.check(subject, context())]
    assert [v.explains for v in violations] == [frozenset({"documents-signed-by-the-permissions-ca"})]


def subjects(store: Keystore) -> list[Any]:
    return list(certificate_uses(store))


@pytest.mark.parametrize(
    ("seconds", "expected"), [(-1, ["KA203"]), (0, ["KA205"]), (30 * 86400, ["KA205"]), (30 * 86400 + 1, [])]
)
def test_the_end_of_a_certificate_to_the_second(seconds: int, expected: list[str]) -> None:
    end = AT + timedelta(seconds=seconds)
    rights = grant("/talker", not_after=text(f"{AT + 400 * DAY:%Y-%m-%dT%H:%M:%S}"))
    store = talker(
        certificate=certificates(CERT, pem("/talker", end=end)),
        permissions=permissions("enclaves/talker/permissions.p7s", rights),
    )(healthy())
    assert [code for code in codes(store) if code != "KA513"] == expected


def test_an_issuer_behind_another_authority_is_found_by_some_alone() -> None:
    store = both(identity_ca=certificates(CA, pem("oldCA", issuer="oldCA"), IDENTITY_CA))(healthy())
    for finding in findings("KA226", judged(store)):
        assert "of public/identity_ca.cert.pem the first certificate alone is read" in finding.message
        assert finding.profiles == ("cyclonedds-0.10", "cyclonedds-11", "opendds")
    twins = certificates(CA, pem("identityCA", label="twin", issuer="identityCA", issuer_label="twin"), IDENTITY_CA)
    of_one_name = findings("KA226", judged(both(identity_ca=twins)(healthy())))
    assert all("fastdds-3.6" in finding.profiles for finding in of_one_name)
    assert "is another authority's; no other is tried" in of_one_name[0].message
    assert findings("KA226", judged(both(identity_ca=certificates(CA, IDENTITY_CA))(healthy()))) == ()


def by_dsa(subject: str, public: Any, authority: dsa.DSAPrivateKey, *, ca: bool) -> bytes:
    """A certificate with a signature that the reader cannot verify, though OpenSSL can."""
    builder = x509.CertificateBuilder().subject_name(name(subject)).issuer_name(name("identityCA"))
    builder = builder.public_key(public).serial_number(7).not_valid_before(START).not_valid_after(END)
    builder = builder.add_extension(x509.BasicConstraints(ca=ca, path_length=None), critical=True)
    return builder.sign(authority, hashes.SHA256()).public_bytes(Encoding.PEM)


def test_a_signature_that_cannot_be_verified_leaves_it_open() -> None:
    authority = dsa.generate_private_key(1024)
    ca = certificates(CA, by_dsa("identityCA", authority.public_key(), authority, ca=True))
    content = by_dsa("/talker", key("/talker").public_key(), authority, ca=False)
    store = keystore(enclave("/talker", identity_ca=ca, certificate=certificates(CERT, content)))
    assert open_codes(store) == {"KA207"}
    assert "cannot be verified here" in findings("KA207", judged(store))[0].message


@pytest.mark.parametrize(
    ("profiles", "severity"),
    [(("spec", "fastdds-3.6"), Severity.INFO), (("spec", "cyclonedds-0.10"), Severity.HIGH)],
)
def test_one_authority_matters_more_where_the_signer_is_not_pinned(
    profiles: tuple[str, ...], severity: Severity
) -> None:
    found = findings("KA222", judged(one_authority(healthy()), profiles=tuple(VARIANTS[p] for p in profiles)))
    assert [finding.severity for finding in found] == [severity]
    assert set(found[0].profiles) == {"fastdds-2.6.4", "fastdds-2.9", "cyclonedds-0.10"}
    assert "Where peers accept any signer that it issued, an enclave can sign itself any right." in found[0].message


def test_a_private_key_that_lies_in_a_second_enclave_is_shared_too() -> None:
    store = keystore(enclave("/talker"), enclave("/listener", key=private_key("enclaves/listener/key.pem", "/talker")))
    assert codes(store) == ["KA209", "KA219"]
    (found,) = (each for each in judged(store).findings if each.code == "KA219")
    assert (
        found.message
        == "The key file of /listener holds the private key of /talker: whoever has it can act as /talker."
    )


def test_ardent_writes_names_without_a_slash() -> None:
    bare = talker(
        certificate=certificates(CERT, pem("talker", label="/talker", ca=False)),
        permissions=permissions("enclaves/talker/permissions.p7s", grant("talker", allow(["rt/chatter"]))),
    )(healthy())
    assert codes(bare) == ["KA220"]
    ardent = replace(bare, layout=replace(bare.layout, kind=LayoutKind.ARDENT))
    assert [f.enclave for f in findings("KA220", judged(ardent))] == ["/listener"]


# Revocation


def test_a_list_that_another_key_signed_revokes_nothing() -> None:
    assert becomes(both(crl=crl(CRL, SERIAL, label="stranger"))) == ["KA213"]


def test_a_list_from_the_future_is_refused_like_a_stale_one() -> None:
    assert becomes(both(crl=crl(CRL, this_update=AT + DAY))) == ["KA214"]


def test_only_what_the_first_list_leaves_out_is_without_effect() -> None:
    both_ways = [joined(crl(CRL, 7), crl(CRL)), joined(crl(CRL, 7, 8), crl(CRL, 8)), joined(crl(CRL, 7), crl(CRL, 8))]
    assert [becomes(both(crl=each)) for each in both_ways] == [[], [], ["KA229"]]
    (found,) = findings("KA229", judged(both(crl=joined(crl(CRL, 7), crl(CRL, 7, 255, 8)))(healthy())))
    assert "revokes 2 more: 8, FF." in found.message
    elsewhere = joined(crl(CRL, 7), crl(CRL, 7, issuer="permissionsCA"))
    assert becomes(both(crl=elsewhere)) == ["KA229"]


def test_a_delta_is_taken_for_a_complete_list() -> None:
    assert becomes(both(crl=crl(CRL, 7, delta=True))) == ["KA229"]
    assert becomes(both(crl=crl(CRL, SERIAL, delta=True))) == ["KA212", "KA229"]


def test_an_entry_of_another_issuer_is_without_effect() -> None:
    assert becomes(both(crl=crl(CRL, SERIAL, revoked_of="identityCA"))) == ["KA212"]
    assert becomes(both(crl=crl(CRL, SERIAL, revoked_of="another"))) == ["KA229"]


def test_lists_in_an_authoritys_file_count_for_fast_dds_alone() -> None:
    revoking = crl(CRL, SERIAL).revocation_lists[0].parsed.public_bytes(Encoding.PEM)
    store = both(identity_ca=certificates(CA, IDENTITY_CA + revoking))(healthy())
    assert codes(store) == ["KA202", "KA212"]
    assert all(name.startswith("fastdds") for name in findings("KA212", judged(store))[0].profiles)


# Algorithms


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (talker(certificate=certificates(CERT, pem("/talker"), BROKEN)), "KA202"),
        (both(identity_ca=certificates("public/identity_ca.cert.pem", IDENTITY_CA, BROKEN)), "KA201"),
    ],
)
def test_what_cannot_be_read_behind_a_certificate_may_be_anybody_in_a_file_of_authorities(
    change: Change, code: str
) -> None:
    """In an identity's own file nobody reads on."""
    assert becomes(change) == [code]
    assert open_codes(change(healthy())) == {code} - {"KA202"}


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("EC secp256r1", []),
        ("EC secp256k1", ["KA217"]),
        ("EC brainpoolP256r1", ["KA217"]),
        ("EC sect163k1", ["KA216"]),
        ("RSA 2048", []),
        ("RSA 3072", ["KA217"]),
        ("RSA 1024", ["KA216"]),
        ("Ed25519", ["KA217"]),
        ("DSA 1024", ["KA216"]),
    ],
)
def test_kinds_of_keys(kind: str, expected: list[str]) -> None:
    store = talker(certificate=changed(certificates(CERT, pem("/talker")), key_kind=kind))(healthy())
    assert codes(store) == expected


@pytest.mark.parametrize(
    ("refusing", "said"),
    [
        ("cyclonedds-11", {"KA217": Severity.HIGH}),
        ("fastdds-3.6", {"KA217": Severity.MEDIUM, "KA117": Severity.HIGH}),  # for another reason than the key
        ("opendds", {"KA217": Severity.MEDIUM}),  # not asked about
    ],
)
def test_a_key_is_as_grave_as_what_it_stops(refusing: str, said: dict[str, Severity]) -> None:
    """Said once: the last net (KA117) is for what no rule of high severity speaks of."""
    store = talker(certificate=changed(certificates(CERT, pem("/talker")), key_kind="RSA 3072"))(healthy())
    usability = {("enclaves/talker", refusing): Usability(usable=Truth.NO, reasons=("some reason",))}
    seen = judged(store, meaning=meaning(usability=usability))
    assert {each.code: each.severity for code in ("KA217", "KA117") for each in findings(code, seen)} == said


def test_an_authority_with_a_weak_key_gets_another() -> None:
    """Renewing it, or issuing an identity again, leaves the key as it is."""
    authority = changed(certificates("public/identity_ca.cert.pem", pem("identityCA")), key_kind="RSA 1024")
    (found,) = findings("KA216", judged(talker(identity_ca=authority)(healthy())))
    assert [step.act for step in found.fix.steps] == [None, Act.NEW_IDENTITY_CA]
    own = changed(certificates(CERT, pem("/talker")), key_kind="RSA 1024")
    (found,) = findings("KA216", judged(talker(certificate=own)(healthy())))
    assert [step.act for step in found.fix.steps] == [None, Act.ISSUE]


@pytest.mark.parametrize(
    ("algorithm", "weak"),
    [
        ("ecdsa-with-SHA256", False),
        ("ecdsa-with-SHA1", True),
        ("sha1WithRSAEncryption", True),
        ("md5WithRSAEncryption", True),
        ("sha512WithRSAEncryption", False),
        ("RSA-SHA3-256", False),
        ("dsaWithSHA1", True),
        ("1.2.3.4", False),
    ],
)
def test_weak_signatures(algorithm: str, weak: bool) -> None:
    file = changed(certificates(CERT, pem("/talker")), signature_algorithm=algorithm)
    use = subjects(talker(certificate=file)(healthy()))
    assert bool([v for subject in use for v in weak_signature_algorithm.check(subject, context())]) is weak


@pytest.mark.parametrize(
    ("serial", "irregular"),
    [(0, True), (-1, True), (1, False), ((1 << 159) - 1, False), (1 << 159, True), (1 << 160, True)],
)
def test_serial_numbers(serial: int, irregular: bool) -> None:
    store = talker(certificate=changed(certificates(CERT, pem("/talker")), serial=serial))(healthy())
    assert codes(store) == (["KA224"] if irregular else [])
