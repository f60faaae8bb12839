"""Pairs for KA212 to KA225: revocation, algorithms, and identities that meet in one keystore."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.serialization import Encoding
from msgspec.structs import replace

from .base import (
    IDENTITY_CA,
    LISTENER,
    LISTENER_CERTIFICATE,
    LISTENER_GRANT,
    ONE,
    PERMISSIONS_CA,
    TALKER_CERTIFICATE,
    TALKER_GRANT,
    TWO,
    talker,
    with_listener,
    with_talker,
)
from .certificates import Certificate, day
from .documents import Permissions
from .keys import Key
from .store import Store
from .story import Case, Story, pair

THIS_UPDATE = day(2026, 10, 1)
NEXT_UPDATE = day(2100, 1, 1)


def stories() -> Iterator[Story]:
    """The other pairs of KA2."""
    yield from _revocation()
    yield from _algorithms()
    yield from _names()
    yield from _together()


def revocation_list(
    *revoked: Certificate, issuer: Certificate = IDENTITY_CA, next_update: datetime = NEXT_UPDATE
) -> bytes:
    """A CRL in PEM (RFC 5280, 5) by `issuer` that revokes `revoked`."""
    name = x509.load_der_x509_certificate(issuer.der()).subject
    builder = x509.CertificateRevocationListBuilder(issuer_name=name, last_update=THIS_UPDATE, next_update=next_update)
    builder = builder.add_extension(x509.CRLNumber(1), critical=False)
    for certificate in revoked:
        entry = x509.RevokedCertificateBuilder(serial_number=certificate.serial_number(), revocation_date=THIS_UPDATE)
        builder = builder.add_revoked_certificate(entry.build())
    crl = builder.sign(issuer.key.private(), hashes.SHA256(), ecdsa_deterministic=True)
    return crl.public_bytes(Encoding.PEM)


STOLEN = Certificate(key=Key(label="rules, a stolen identity"), subject="/stolen", issuer=IDENTITY_CA)


def _with_crl(crl: bytes) -> Store:
    return with_talker(changes={"crl.pem": crl})


def _revocation() -> Iterator[Story]:
    yield from pair(
        "KA212",
        bad=Case(
            "The identity CA revoked the talker's certificate, but the keystore still ships it: enclaves with the "
            "list refuse the talker.",
            _with_crl(revocation_list(TALKER_CERTIFICATE)),
        ),
        good=Case("The list revokes an identity that is not in this keystore.", _with_crl(revocation_list(STOLEN))),
    )
    yield from pair(
        "KA213",
        bad=Case(
            "The permissions CA signed the list, not the identity CA: it revokes nothing, and OpenSSL refuses every "
            "identity.",
            _with_crl(revocation_list(STOLEN, issuer=PERMISSIONS_CA)),
        ),
        good=Case("The identity CA signed the list.", _with_crl(revocation_list(STOLEN))),
    )
    yield from pair(
        "KA214",
        bad=Case(
            "The next list was due on 1 November 2026 and did not come: with a stale list every identity is refused.",
            _with_crl(revocation_list(STOLEN, next_update=day(2026, 11, 1))),
        ),
        good=Case("The list is current.", _with_crl(revocation_list(STOLEN))),
    )
    yield from pair(
        "KA229",
        bad=Case(
            "The list that revokes the stolen identity was appended to crl.pem, but run times read only the first.",
            _with_crl(revocation_list() + revocation_list(STOLEN)),
        ),
        good=Case("The newer list is the first.", _with_crl(revocation_list(STOLEN) + revocation_list())),
    )
    crl = {"crl.pem": revocation_list(STOLEN)}
    yield from pair(
        "KA215",
        bad=Case(
            "The talker refuses revoked identities. The listener has no list and accepts them.",
            replace(TWO, enclaves=(talker(changes=crl), LISTENER)),
        ),
        good=Case(
            "Both enclaves carry the same list.",
            replace(TWO, enclaves=(talker(changes=crl), replace(LISTENER, changes=crl))),
        ),
    )


def _with_curve(curve: str) -> Store:
    key = Key(label="rules /talker", curve=curve)
    return with_talker(certificate=replace(TALKER_CERTIFICATE, key=key))


def _algorithms() -> Iterator[Story]:
    yield from pair(
        "KA216",
        bad=Case(
            "The talker's key is on a 224-bit curve, less than NIST SP 800-57 allows beyond 2030.",
            _with_curve("P-224"),
        ),
        good=Case("The key is on prime256v1.", ONE),
    )
    yield from pair(
        "KA217",
        bad=Case(
            "The talker's key is on secp384r1: strong, but not named by DDS-Security 1.1 (9.3.1), and refused by "
            "Cyclone DDS.",
            _with_curve("P-384"),
        ),
        good=Case("The key is on prime256v1.", ONE),
    )
    yield from pair(
        "KA218",
        bad=Case(
            "The identity CA signed the talker's certificate with SHA-1, for which collisions exist.",
            with_talker(certificate=replace(TALKER_CERTIFICATE, digest="sha1")),
        ),
        good=Case("It signed with SHA-256.", ONE),
    )
    yield from pair(
        "KA221",
        bad=Case(
            "The talker's certificate has a critical extension that no verifier knows: each must refuse it (RFC "
            "5280, 4.2).",
            with_talker(certificate=replace(TALKER_CERTIFICATE, unknown_critical_extension="1.3.6.1.4.1.99999.1")),
        ),
        good=Case("No such extension.", ONE),
    )
    yield from pair(
        "KA224",
        bad=Case(
            "The talker's serial number has 25 octets; RFC 5280 (4.1.2.2) allows 20.",
            with_talker(certificate=replace(TALKER_CERTIFICATE, serial=(1 << 199) - 1)),
        ),
        good=Case("The serial number has 20 octets.", ONE),
    )


def _names() -> Iterator[Story]:
    renamed = replace(TALKER_CERTIFICATE, subject="/announcer")
    yield from pair(
        "KA220",
        bad=Case(
            "The enclave /talker has an identity called /announcer, and a grant for that name.",
            with_talker(
                certificate=renamed, permissions=Permissions(grants=(replace(TALKER_GRANT, path="/announcer"),))
            ),
        ),
        good=Case("The identity has the enclave's name.", ONE),
    )
    namesake = replace(LISTENER_CERTIFICATE, subject="/talker")
    yield from pair(
        "KA225",
        bad=Case(
            "Talker and listener have different keys and one name, /talker: the listener presents the talker's "
            "permissions and publishes.",
            with_listener(
                certificate=namesake, permissions=Permissions(grants=(replace(LISTENER_GRANT, path="/talker"),))
            ),
        ),
        good=Case("Each has its own name.", TWO),
    )
    yield from pair(
        "KA226",
        bad=Case(
            "identity_ca.cert.pem is a bundle with another authority first. Fast DDS searches it; Cyclone DDS reads "
            "only the first certificate and refuses everybody.",
            replace(ONE, changes={"public/identity_ca.cert.pem": PERMISSIONS_CA.pem() + IDENTITY_CA.pem()}),
        ),
        good=Case("identity_ca.cert.pem holds only the identity CA.", ONE),
    )
    yield from pair(
        "KA227",
        bad=Case(
            "The request was made with -subj /, and the authority did not check: the certificate has no subject. "
            "Fast DDS crashes on it.",
            with_talker(certificate=replace(TALKER_CERTIFICATE, subject="")),
        ),
        good=Case("The subject is the enclave's path.", ONE),
    )
    admin = replace(TALKER_CERTIFICATE, subject="/admin")
    yield from pair(
        "KA228",
        bad=Case(
            "After the talker's certificate stands another for the same key, CN=/admin, made for maintenance.",
            with_talker(changes={"cert.pem": TALKER_CERTIFICATE.pem() + admin.pem()}),
        ),
        good=Case("The key has one certificate.", ONE),
    )
    yield from pair(
        "KA117",
        bad=Case(
            "The permissions CA was made with SHA-384. Fast DDS accepts only SHA-256 for authorities and does not "
            "load it.",
            replace(ONE, permissions_ca=replace(PERMISSIONS_CA, digest="sha384")),
        ),
        good=Case("The authority is signed with SHA-256.", ONE),
    )
    yield from pair(
        "KA118",
        bad=Case(
            "`openssl req -x509 -keyout ca.pem -out ca.pem` put key and certificate into one file, which became "
            "permissions_ca.cert.pem: every robot can sign rights.",
            replace(ONE, changes={"public/permissions_ca.cert.pem": PERMISSIONS_CA.pem() + PERMISSIONS_CA.key.pem()}),
        ),
        good=Case("permissions_ca.cert.pem holds only the certificate.", ONE),
    )


def _together() -> Iterator[Story]:
    yield from pair(
        "KA219",
        bad=Case(
            "The listener has a copy of the talker's certificate and key: nobody can tell them apart.",
            with_listener(
                certificate=TALKER_CERTIFICATE,
                permissions=Permissions(grants=(replace(LISTENER_GRANT, path="/talker"),)),
            ),
        ),
        good=Case("Each enclave has its own identity.", TWO),
    )
    yield from pair(
        "KA222",
        bad=Case(
            "One authority issues identities and signs permissions (CVE-2023-24010, 24011, 24012).",
            replace(ONE, permissions_ca=IDENTITY_CA),
        ),
        good=Case("Two authorities with different keys.", ONE),
    )
    yield from pair(
        "KA231",
        bad=Case(
            "The talker's identity was issued from the template for authorities, with CA:TRUE, as if it issued "
            "identities itself.",
            with_talker(certificate=replace(TALKER_CERTIFICATE, ca=True)),
        ),
        good=Case("The identity says CA:FALSE.", ONE),
    )
    issuing = replace(IDENTITY_CA, key=Key(label="rules, another identity CA"), subject="theirIdentityCA")
    signing = replace(PERMISSIONS_CA, key=Key(label="rules, another permissions CA"), subject="theirPermissionsCA")
    yield from pair(
        "KA223",
        bad=Case(
            "Somebody appended their own authorities to both CA files of public/.",
            replace(
                ONE,
                changes={
                    "public/identity_ca.cert.pem": IDENTITY_CA.pem() + issuing.pem(),
                    "public/permissions_ca.cert.pem": PERMISSIONS_CA.pem() + signing.pem(),
                },
            ),
        ),
        good=Case("One authority in each file, the same for all enclaves.", ONE),
    )
