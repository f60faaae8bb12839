"""Who signed the documents and how, and what the permissions CA is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import timedelta
from functools import lru_cache

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID

from tests.keystore.builder import Extension, Signed, authority, certificate, rsa_key, signed_document, usage
from tests.keystore.messages import OPENSSL_OPTIONS, PYCA_OPTIONS, RSA_OPTIONS, by_openssl
from tests.oracles.vendors.recipe import NOW, Recipe, Signing, common_authority, sign, talker

DAY = timedelta(days=1)
PAST = {"start": NOW - 9 * DAY, "end": NOW - DAY}
FUTURE = {"start": NOW + DAY, "end": NOW + 9 * DAY}


def purpose(which: x509.ObjectIdentifier) -> Extension:
    """Extended key usage."""
    return x509.ExtendedKeyUsage([which]), False


def by(signer: Signed) -> Signing:
    """As sros2 signs, with another key."""
    return lambda document: sign(document, signer)


def with_options(options: Sequence[str], *signers: Signed) -> Signing:
    """As the command line tool signs."""
    return lambda document: by_openssl(options, *(signers or (common_authority(),)), content=document)


def both(title: str, signing: Signing, **files: bytes) -> tuple[Recipe, ...]:
    """Three keystores: either document, and both."""
    named = {name.replace("__", "."): content for name, content in files.items()}
    return (
        Recipe(title=f"governance {title}", sign_governance=signing, files=named),
        Recipe(title=f"permissions {title}", sign_permissions=signing, files=named),
        Recipe(title=f"both documents {title}", sign_governance=signing, sign_permissions=signing, files=named),
    )


def leaf(*extensions: Extension, **how: object) -> Signed:
    """A certificate that the common authority issued, of nobody in particular."""
    return certificate("/mallory", common_authority(), extensions=extensions, **how)  # type: ignore[arg-type]


def signed_by_others() -> tuple[Recipe, ...]:
    """Signers that are not the permissions CA itself."""
    stranger = authority("stranger")
    namesake = authority()
    return (
        *both("signed by the enclave's own key", by(talker())),
        *both("signed by a leaf", by(leaf())),
        *both("signed by a stranger", by(stranger)),
        *both("signed by a namesake of the CA", by(namesake)),
        *both("signed by a stranger's leaf", by(certificate("/mallory", stranger))),
        *both("signed by a leaf for mail", by(leaf(purpose(ExtendedKeyUsageOID.EMAIL_PROTECTION)))),
        *both("signed by a leaf for clients", by(leaf(purpose(ExtendedKeyUsageOID.CLIENT_AUTH)))),
        *both("signed by a leaf that may only encipher", by(leaf(usage("key_encipherment")))),
        *both("signed by a leaf that may sign", by(leaf(usage("digital_signature")))),
        *both("signed by an expired leaf", by(leaf(**PAST))),
        *both("signed by a leaf of the future", by(leaf(**FUTURE))),
        *both("signed by the CA and a leaf", with_options(("smime", "-text"), common_authority(), leaf())),
        *both("signed by the CA and a stranger", with_options(("smime", "-text"), common_authority(), stranger)),
    )


def ways_to_sign() -> tuple[Recipe, ...]:
    """Envelopes of every writer, around the permissions; RSA signs some that an elliptic curve cannot."""
    ca = authority(key=rsa_key())
    rsa_files = {"permissions_ca.cert.pem": ca.pem}
    openssl = {title: options for title, options in OPENSSL_OPTIONS.items() if title != "cms -text -keyid"}

    def of_pyca(title: str) -> Signing:
        return lambda document: signed_document(document, common_authority(), options=PYCA_OPTIONS[title])

    return (
        *(Recipe(title=f"permissions by {title}", sign_permissions=with_options(o)) for title, o in openssl.items()),
        *(Recipe(title=f"permissions by {title}", sign_permissions=of_pyca(title)) for title in PYCA_OPTIONS),
        *(
            Recipe(
                title=f"both by {title}",
                sign_permissions=with_options(options, ca),
                sign_governance=with_options(options, ca),
                files=rsa_files,
            )
            for title, options in RSA_OPTIONS.items()
        ),
    )


def envelopes() -> tuple[Recipe, ...]:
    """Signed permissions, changed on the way."""
    changes: dict[str, Callable[[bytes], bytes]] = {
        "in LF": lambda m: m.replace(b"\r\n", b"\n"),
        "in CRLF": lambda m: m.replace(b"\r\n", b"\n").replace(b"\n", b"\r\n"),
        "in CR CR LF": lambda m: m.replace(b"\r\n", b"\n").replace(b"\n", b"\r\r\n"),
        "with a blank line first": lambda m: b"\n" + m,
        "with a byte order mark": lambda m: b"\xef\xbb\xbf" + m,
        "with text behind": lambda m: m + b"trailing\n",
        "with text before": lambda m: b"X-Note: hi\n" + m,
        "below a letter's first lines": lambda m: b"From: me\nSubject: your rights\n" + m,
        "with a blank at a line's end": lambda m: m.replace(b"<permissions>", b"<permissions> \n", 1),
        "with one letter changed": lambda m: m.replace(b"rt/chatter", b"rt/chattex", 1),
        "with the default changed": lambda m: m.replace(b"DENY", b"ALLOW", 1),
        "cut off": lambda m: m[: len(m) // 2],
        "empty": lambda _: b"",
        "not signed": lambda m: m[m.index(b"<?xml") : m.index(b"</dds>") + 6],
    }

    def changed(title: str) -> Signing:
        return lambda document: changes[title](sign(document))

    return tuple(Recipe(title=f"permissions message {title}", sign_permissions=changed(title)) for title in changes)


def authorities() -> tuple[Recipe, ...]:
    """What the permissions CA may be; it signs both documents."""
    root = authority("root", extensions=())
    wide = certificate("wide root", ca=True, length=None)
    intermediate = certificate("intermediate", wide, ca=True)
    kinds = {
        "another than the identity CA": root,
        "expired": authority("p", **PAST),
        "not yet valid": authority("p", **FUTURE),
        "not a CA": certificate("p"),
        "without basic constraints": certificate("p", ca=None),
        "for signing certificates only": authority("p", extensions=(usage("key_cert_sign"),)),
        "for signing": authority("p", extensions=(usage("key_cert_sign", "digital_signature"),)),
        "of RSA 2048": authority("p", key=rsa_key()),
        "of RSA 1024": authority("p", key=rsa_key(1024)),
        "of P-384, SHA-256": authority("p", key=ec.generate_private_key(ec.SECP384R1())),
        "of P-384, SHA-384": authority("p", key=ec.generate_private_key(ec.SECP384R1()), digest=hashes.SHA384()),
        "of P-256, SHA-512": authority("p", digest=hashes.SHA512()),
        "with a mail purpose": authority("p", extensions=(purpose(ExtendedKeyUsageOID.EMAIL_PROTECTION),)),
        "with a client's purpose": authority("p", extensions=(purpose(ExtendedKeyUsageOID.CLIENT_AUTH),)),
    }
    chain = {
        "an intermediate alone": intermediate.pem,
        "an intermediate, then its root": intermediate.pem + wide.pem,
        "a root, then the intermediate": wide.pem + intermediate.pem,
    }
    other = authority("other")
    old, renewed, long = authority("p", **PAST), authority("p"), authority("q", digest=hashes.SHA512())
    namesake = authority("p")
    below = certificate("/mallory", namesake)
    again = certificate("p", key=old.key, ca=True)
    numbered = certificate("p", key=old.key, ca=True, serial=old.certificate.serial_number)
    files = {
        "the CA, then another": common_authority().pem + other.pem,
        "another, then the CA": other.pem + common_authority().pem,
        "the CA twice": common_authority().pem * 2,
        "the CA with text around": b"Certificate:\n" + common_authority().pem + b"end\n",
        "another CA": other.pem,
        "empty": b"",
        "the CA, labelled as OpenSSL's own form": common_authority().pem.replace(b"CERT", b"TRUSTED CERT"),
        "the CA behind a byte order mark": b"\xef\xbb\xbf" + common_authority().pem,
        "its key": common_authority().key_pem,
        "not PEM": b"hello",
    }
    return (
        *(_ca(kind, ca.pem, ca) for kind, ca in kinds.items()),
        *(_ca(f"is {title}, which signs", pem, intermediate) for title, pem in chain.items()),
        *(_ca(f"is {title}, the root signs", pem, wide) for title, pem in chain.items()),
        *(_ca(f"file is {title}", pem, common_authority()) for title, pem in files.items()),
        _ca("is an expired one, then another of its name, which signs", old.pem + renewed.pem, renewed),
        _ca("is an expired one, then its renewal, which signs", old.pem + again.pem, again),
        _ca("is an expired one, then its renewal of the same number, which signs", old.pem + numbered.pem, numbered),
        _ca("is the renewal of an expired one of the same number, which signs", numbered.pem, old),
        _ca("is an expired one, which signs, then another of its name", old.pem + renewed.pem, old),
        _ca("is one that signs, then an expired one", renewed.pem + old.pem, renewed),
        _ca("is one, then another of its name, which signs", renewed.pem + namesake.pem, namesake),
        _ca("is one, then another of its name, a leaf of which signs", renewed.pem + namesake.pem, below),
        _ca("is one, which signs, then another of its name", renewed.pem + namesake.pem, renewed),
        _ca("is one of SHA-512, then another, which signs", long.pem + other.pem, other),
        _ca("is one of SHA-512, which signs, then another", long.pem + other.pem, long),
        Recipe(title="permissions CA missing", files={"permissions_ca.cert.pem": None}),
        Recipe(title="governance missing", files={"governance.p7s": None}),
        Recipe(title="permissions missing", files={"permissions.p7s": None}),
    )


def _ca(title: str, pem: bytes, signer: Signed) -> Recipe:
    files = {"permissions_ca.cert.pem": pem}
    return Recipe(title=f"permissions CA {title}", sign_governance=by(signer), sign_permissions=by(signer), files=files)


@lru_cache
def recipes() -> tuple[Recipe, ...]:
    """All of them; keys are made, so not at import."""
    return (*signed_by_others(), *ways_to_sign(), *envelopes(), *authorities())
