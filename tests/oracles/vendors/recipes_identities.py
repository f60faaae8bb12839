"""Identities: their chain, dates, keys and revocation lists."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import timedelta
from functools import lru_cache

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, ed25519
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    NoEncryption,
    PrivateFormat,
)
from cryptography.x509.oid import ExtendedKeyUsageOID
from msgspec.structs import replace

from tests.keystore.builder import END, START, Extension, Signed, authority, certificate, crl, entry, rsa_key
from tests.keystore.documents import allow, permissions, pubsub
from tests.oracles.smime.der import NULL, algorithm, parse
from tests.oracles.vendors.recipe import NOW, Recipe, common_authority, grant, talker
from tests.oracles.vendors.recipes_signers import DAY, FUTURE, PAST, purpose, usage

_UNKNOWN = x509.UnrecognizedExtension(x509.ObjectIdentifier("1.2.3.4"), b"\x05\x00")


def issued(title: str, **how: object) -> Recipe:
    """The common authority issues /talker another certificate."""
    identity = certificate("/talker", common_authority(), **how)  # type: ignore[arg-type]
    return Recipe(title=f"identity {title}", identity=identity)


def under(title: str, ca: Signed, pem: bytes | None = None, identity: Signed | None = None) -> Recipe:
    """An identity under another authority."""
    identity = identity or certificate("/talker", ca)
    files = {"identity_ca.cert.pem": ca.pem if pem is None else pem}
    return Recipe(title=f"identity CA {title}", identity=identity, files=files)


def certificates() -> tuple[Recipe, ...]:
    """Of the identity itself."""
    return (
        issued("plain"),
        issued("expired", **PAST),
        issued("not yet valid", **FUTURE),
        issued("is a CA", ca=True),
        issued("without basic constraints", ca=None),
        issued("for clients", extensions=(purpose(ExtendedKeyUsageOID.CLIENT_AUTH),)),
        issued("for code", extensions=(purpose(ExtendedKeyUsageOID.CODE_SIGNING),)),
        issued("that may only encipher", extensions=(usage("key_encipherment"),)),
        issued("with an unknown critical extension", extensions=((_UNKNOWN, True),)),
        issued("with an unknown extension", extensions=((_UNKNOWN, False),)),
        issued("signed with SHA-384", digest=hashes.SHA384()),
        issued("signed with SHA-512", digest=hashes.SHA512()),
        issued("beyond its CA's end", end=NOW + 9000 * DAY),
        Recipe(
            title="identity is the CA itself",
            identity=common_authority(),
            permissions=permissions(grant(allow(pubsub("rt/chatter")), subject="CN=sros2CA")),
        ),
        Recipe(title="identity of a stranger", identity=certificate("/talker", authority("stranger"))),
        Recipe(title="identity of a namesake", identity=certificate("/talker", authority())),
        Recipe(title="identity signs itself", identity=certificate("/talker")),
    )


def keys() -> tuple[Recipe, ...]:
    """Kinds of keys, and what stands in the key file."""
    kinds = {
        "RSA 1024": rsa_key(1024),
        "RSA 2048": rsa_key(),
        "RSA 3072": rsa_key(3072),
        "P-224": ec.generate_private_key(ec.SECP224R1()),
        "P-384": ec.generate_private_key(ec.SECP384R1()),
        "P-521": ec.generate_private_key(ec.SECP521R1()),
        "secp256k1": ec.generate_private_key(ec.SECP256K1()),
        "brainpoolP256r1": ec.generate_private_key(ec.BrainpoolP256R1()),
        "Ed25519": ed25519.Ed25519PrivateKey.generate(),
    }
    plain = talker()
    assert isinstance(plain.key, ec.EllipticCurvePrivateKey)
    traditional = plain.key.private_bytes(Encoding.PEM, PrivateFormat.TraditionalOpenSSL, NoEncryption())
    encrypted = plain.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(b"word"))
    files = {
        "in the form of OpenSSL": traditional,
        "encrypted": encrypted,
        "of another certificate": certificate("/x").key_pem,
        "of the CA": common_authority().key_pem,
        "twice": plain.key_pem * 2,
        "behind the certificate": plain.pem + plain.key_pem,
        "behind another key": certificate("/x").key_pem + plain.key_pem,
        "empty": b"",
        "no PEM": b"hello",
        "missing": None,
    }
    return (
        *(issued(f"key {kind}", key=key) for kind, key in kinds.items()),
        *(Recipe(title=f"key file {title}", files={"key.pem": content}) for title, content in files.items()),
    )


def chains() -> tuple[Recipe, ...]:
    """Authorities of identities."""
    wide = authority("wide root", length=None)
    intermediate = certificate("intermediate", wide, ca=True)
    narrow = certificate("below sros2's", common_authority(), ca=True)
    leaf, mine = certificate("/talker", intermediate), certificate("/talker", wide)
    plain = common_authority()
    before, later = authority("i"), authority("i", start=START + timedelta(days=200), end=END + timedelta(days=200))
    idle = authority("i", key=later.key, extensions=(usage("crl_sign"),))
    kinds = {
        "expired": authority("i", **PAST),
        "not yet valid": authority("i", **FUTURE),
        "without basic constraints": certificate("i", ca=None),
        "that is no CA": certificate("i"),
        "that may not sign certificates": authority("i", extensions=(usage("digital_signature"),)),
        "of RSA": authority("i", key=rsa_key()),
        "of P-384": authority("i", key=ec.generate_private_key(ec.SECP384R1())),
        "of Ed25519": authority("i", key=ed25519.Ed25519PrivateKey.generate()),
        "of RSA 1024": authority("i", key=rsa_key(1024)),
        "signed with SHA-512": authority("i", digest=hashes.SHA512()),
    }
    return (
        *(under(title, ca) for title, ca in kinds.items()),
        under("is an intermediate alone", intermediate),
        under("is an intermediate and its root", intermediate, intermediate.pem + wide.pem),
        under("is a root and its intermediate", intermediate, wide.pem + intermediate.pem),
        under("is the root alone, an intermediate issued", intermediate, wide.pem),
        under("is the root alone, the chain in cert.pem", intermediate, wide.pem, Signed(leaf.key, leaf.certificate)),
        under("is an intermediate and its root, the root issued", wide, intermediate.pem + wide.pem, mine),
        under("is a root and its intermediate, the root issued", wide, wide.pem + intermediate.pem, mine),
        under("below a root that allows one", narrow, narrow.pem + plain.pem),
        under("and another", plain, plain.pem + authority("x").pem),
        under("behind another", plain, authority("x").pem + plain.pem),
        # Behind a third one: Cyclone DDS keeps OpenSSL's error of a wrong signature for whatever it says next.
        under("behind two, one of its name, made before", later, plain.pem + before.pem + later.pem),
        under("before another of its name, made before", later, later.pem + before.pem),
        under("behind two, one of its name and key that may not sign", later, plain.pem + idle.pem + later.pem),
        under("empty", plain, b""),
        under("no PEM", plain, b"hello"),
        Recipe(title="identity CA missing", files={"identity_ca.cert.pem": None}),
        Recipe(title="certificate missing", files={"cert.pem": None}),
        Recipe(
            title="certificate file with the CA behind",
            files={"cert.pem": talker().pem + plain.pem},
        ),
        Recipe(title="certificate file with the CA first", files={"cert.pem": plain.pem + talker().pem}),
    )


def saying_outside(ca: Signed, other: bytes) -> Signed:
    """The same certificate with another algorithm where nothing signs it."""
    (structure,) = parse(ca.der)
    structure.children[1] = parse(other)[0]
    return Signed(ca.key, x509.load_der_x509_certificate(structure.encode()))


def kinds_of_authorities() -> tuple[Recipe, ...]:
    """Authorities of one name with keys of several kinds, or with signatures that not everybody knows."""
    plain, others = common_authority(), authority("x")
    of_rsa = authority("i", key=rsa_key())
    of_ec = authority("i")
    renewed = certificate("i", of_rsa, ca=True)
    long = authority("x", digest=hashes.SHA512())
    issuing = authority("i", digest=hashes.SHA384())
    return (
        under("of RSA behind one of its name of EC", of_rsa, of_ec.pem + of_rsa.pem),
        under("of EC behind one of its name of RSA", of_ec, of_rsa.pem + of_ec.pem),
        under("of EC that says RSA outside", saying_outside(plain, algorithm("1.2.840.113549.1.1.11", NULL))),
        under("of EC behind one of its name of EC", of_ec, authority("i").pem + of_ec.pem),
        under("of EC renewed by one of RSA, behind it", renewed, of_rsa.pem + renewed.pem),
        under("of EC renewed by one of RSA, before it", renewed, renewed.pem + of_rsa.pem),
        under("of EC renewed by one of RSA, alone", renewed),
        under("behind one signed with SHA-512", plain, long.pem + plain.pem),
        under("behind two signed with SHA-512 and SHA-384", plain, long.pem + issuing.pem + plain.pem),
        under("signed with SHA-384 before another", issuing, issuing.pem + others.pem),
        under("signed with SHA-384 behind another", issuing, others.pem + issuing.pem),
        under("signed with SHA-384 before and behind another", issuing, issuing.pem + others.pem + issuing.pem),
    )


def _list(
    issuer: Signed,
    revoked: Sequence[int | x509.RevokedCertificate] = (),
    *,
    start: int = -9,
    end: int = 9,
    signer: Signed | None = None,
    extensions: tuple[x509.ExtensionType, ...] = (),
) -> bytes:
    """A revocation list in PEM, from and to so many days from now; its extensions are critical."""
    by = Signed((signer or issuer).key, issuer.certificate)
    critical = [(each, True) for each in extensions]
    made = crl(by, revoked, start=NOW + start * DAY, end=NOW + end * DAY, extensions=critical)
    return made.public_bytes(Encoding.PEM)


_REMOVED = x509.CRLReason(x509.ReasonFlags.remove_from_crl), False


def _issuer(name: x509.Name) -> Extension:
    return x509.CertificateIssuer([x509.DirectoryName(name)]), True


def _scope(**how: object) -> x509.IssuingDistributionPoint:
    fields = ("full_name", "relative_name", "only_some_reasons")
    flags = ("only_contains_user_certs", "only_contains_ca_certs", "indirect_crl", "only_contains_attribute_certs")
    every = {**dict.fromkeys(fields), **dict.fromkeys(flags, False), **how}
    return x509.IssuingDistributionPoint(**every)  # type: ignore[arg-type]


def odd_lists() -> tuple[Recipe, ...]:
    """Lists with what few lists have."""
    ca = common_authority()
    mine, own = talker().certificate.serial_number, ca.certificate.subject
    other = authority("another").certificate.subject
    no_signer = authority("i", extensions=(usage("key_cert_sign"),))
    delta = x509.DeltaCRLIndicator(1)
    point = _scope(full_name=[x509.UniformResourceIdentifier("http://crl")])
    some = _scope(only_some_reasons=frozenset({x509.ReasonFlags.key_compromise}))
    lists = {
        "revokes another issuer's of the number": _list(ca, (entry(mine, _issuer(other)),)),
        "revokes, behind another issuer's": _list(ca, (entry(99, _issuer(other)), mine)),
        "revokes, behind another issuer's and its own": _list(
            ca, (entry(99, _issuer(other)), entry(98, _issuer(own)), mine)
        ),
        "takes back, then revokes": _list(ca, (entry(mine, _REMOVED), mine)),
        "revokes, then takes back": _list(ca, (mine, entry(mine, _REMOVED))),
        "has an unknown critical extension": _list(ca, extensions=(_UNKNOWN,)),
        "is of a distribution point": _list(ca, extensions=(point,)),
        "is a delta of a distribution point": _list(ca, extensions=(point, delta)),
        "is of users": _list(ca, extensions=(_scope(only_contains_user_certs=True),)),
        "is of authorities": _list(ca, extensions=(_scope(only_contains_ca_certs=True),)),
        "is indirect": _list(ca, extensions=(_scope(indirect_crl=True),)),
        "is of some reasons": _list(ca, extensions=(some,)),
        "is a delta": _list(ca, extensions=(delta,)),
        "is a delta and revokes": _list(ca, (mine,), extensions=(delta,)),
    }
    behind_odd = {
        "an unknown critical extension": _list(ca, (mine,), start=-2, extensions=(_UNKNOWN,)),
        "a distribution point": _list(ca, (mine,), start=-2, extensions=(point,)),
    }
    return (
        *(Recipe(title=f"crl.pem {title}", files={"crl.pem": content}) for title, content in lists.items()),
        *(
            Recipe(
                title=f"crl.pem is newer than the list in the CA file, revokes and has {title}",
                files={"crl.pem": content, "identity_ca.cert.pem": ca.pem + _list(ca)},
            )
            for title, content in behind_odd.items()
        ),
        *(
            Recipe(
                title=f"crl.pem is as old as the list in the CA file, {which} revokes",
                files={"crl.pem": _list(ca, here), "identity_ca.cert.pem": ca.pem + _list(ca, there)},
            )
            for which, here, there in (("crl.pem", (mine,), ()), ("that", (), (mine,)))
        ),
        *(
            replace(under(f"may not sign lists, {what}", no_signer), files={**files, "crl.pem": content})
            for what, content in (("a list", _list(no_signer)), ("a delta", _list(no_signer, extensions=(delta,))))
            for files in ({"identity_ca.cert.pem": no_signer.pem},)
        ),
    )


def revocation() -> tuple[Recipe, ...]:
    """Lists beside the other files, and behind the CA."""
    ca = common_authority()
    mine = talker().certificate.serial_number
    newer = _list(ca, start=-2)
    stranger = authority("stranger")
    lists = {
        "revokes nobody": _list(ca),
        "revokes another": _list(ca, (99,)),
        "revokes the enclave": _list(ca, (mine,)),
        "is stale": _list(ca, end=-1),
        "is stale and revokes the enclave": _list(ca, (mine,), end=-1),
        "is of the future": _list(ca, start=1),
        "is a stranger's": _list(stranger),
        "is signed by another": _list(ca, signer=stranger),
        "is empty": b"",
        "is no PEM": b"hello",
        "is DER": x509.load_pem_x509_crl(_list(ca)).public_bytes(Encoding.DER),
        "comes twice, the second revokes": _list(ca) + _list(ca, (mine,)),
        "comes twice, the first revokes": _list(ca, (mine,)) + _list(ca),
        "comes twice, the newer second revokes": _list(ca) + _list(ca, (mine,), start=-2),
        "comes twice, the older first revokes": _list(ca, (mine,)) + newer,
        "comes twice, the older second revokes": newer + _list(ca, (mine,)),
        "comes twice, the older first is stale": _list(ca, end=-1) + newer,
        "comes behind a stranger's": _list(stranger) + _list(ca),
        "comes behind a newer one, signed by another": _list(ca, start=-2, signer=stranger) + _list(ca),
        "comes behind an older one, signed by another": _list(ca, signer=stranger) + newer,
    }
    return (
        *(Recipe(title=f"crl.pem {title}", files={"crl.pem": content}) for title, content in lists.items()),
        *(
            Recipe(title=f"list in the CA file {title}", files={"identity_ca.cert.pem": ca.pem + content})
            for title, content in lists.items()
            if content.startswith(b"-----")
        ),
    )


@lru_cache
def recipes() -> tuple[Recipe, ...]:
    """All of them; keys are made, so not at import."""
    return (*certificates(), *keys(), *chains(), *kinds_of_authorities(), *revocation(), *odd_lists())
