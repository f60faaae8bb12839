"""Facts 4.2: messages that show one text and sign another, signatures of the wrong hand, structures that cost."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, Final

from asn1crypto import cms, core  # type: ignore[import-untyped]
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, pkcs7

from tests.hostile.store import ANY, PERMISSIONS_OF_VICTIM, Case, Finds, Store, case
from tests.keystore.builder import Signed, authority, rsa_key, signed_document
from tests.keystore.messages import by_openssl, taken_apart, with_signature

TEXT: Final = PERMISSIONS_OF_VICTIM
DECOY: Final = TEXT.replace(b"rt/chatter", b"*")
SIGNATURE: Final = re.compile(rb"(?s)(base64\r?\n(?:Content-Disp[^\n]*\n)?\r?\n)([A-Za-z0-9+/=\r\n]+?)(\r?\n\r?\n?--)")
MEDIUM: Final = ("--fail-on", "medium")

Edit = Callable[[bytes], bytes]


def rewritten(edit: Edit) -> Callable[[Store], None]:
    """The victim's message with its text changed."""

    def spoil(store: Store) -> None:
        message = store.message()
        changed = edit(message)
        assert changed != message
        store.put("permissions.p7s", changed)

    return spoil


def replaced(old: bytes, new: bytes) -> Callable[[Store], None]:
    return rewritten(lambda message: message.replace(old, new, 1))


def with_der(edit: Edit) -> Callable[[Store], None]:
    """The victim's message with another signature structure."""
    return rewritten(lambda message: with_signature(message, edit(taken_apart(message)[1])))


def with_structure(edit: Callable[[Any, Store], None]) -> Callable[[Store], None]:
    """The same, edited as SignedData; `edit` may sign again."""

    def spoil(store: Store) -> None:
        def changed(der: bytes) -> bytes:
            info = cms.ContentInfo.load(der)
            edit(info["content"], store)
            return bytes(info.dump(force=True))

        with_der(changed)(store)

    return spoil


def _attributes(data: Any, store: Store, edit: Callable[[list[Any]], list[Any]]) -> None:
    """Change the signed attributes, and sign them."""
    info = data["signer_infos"][0]
    changed = cms.CMSAttributes(edit(list(info["signed_attrs"])))
    key = store.base.permissions.key
    assert isinstance(key, ec.EllipticCurvePrivateKey)
    info["signed_attrs"] = changed
    info["signature"] = key.sign(changed.dump(force=True), ec.ECDSA(hashes.SHA256()))


def attributes(edit: Callable[[list[Any]], list[Any]]) -> Callable[[Store], None]:
    return with_structure(lambda data, store: _attributes(data, store, edit))


def by(*options: str, signers: Callable[[Store], tuple[Signed, ...]] = lambda store: (store.base.permissions,)) -> Any:
    """Sign with OpenSSL's command line tool."""
    return lambda store: store.put("permissions.p7s", by_openssl((*options, "-text"), *signers(store), content=TEXT))


def signed_by(signer: Callable[[Store], Signed]) -> Callable[[Store], None]:
    return lambda store: store.put("permissions.p7s", signed_document(TEXT, signer(store)))


def _impostor(store: Store) -> Signed:
    """Another authority of the same name."""
    return authority(store.base.permissions.certificate.subject)


def _plain(path: str, old: bytes, new: bytes) -> Callable[[Store], None]:
    def spoil(store: Store) -> None:
        file = store.root / path
        assert old in file.read_bytes()
        file.write_bytes(file.read_bytes().replace(old, new))

    return spoil


def _boundary(message: bytes) -> bytes:
    match = re.search(rb'boundary="([^"]*)"', message)
    assert match is not None
    return b"--" + match[1]


def _pieces(edit: Callable[[bytes, list[bytes]], list[bytes]]) -> Callable[[Store], None]:
    """The parts between the boundaries rearranged: what stands before, the text, the signature, what stands behind."""

    def rearranged(message: bytes) -> bytes:
        mark = _boundary(message)
        return mark.join(edit(mark, message.split(mark)))

    return rewritten(rearranged)


def _nested(_: bytes, parts: list[bytes]) -> list[bytes]:
    inner = b'\nContent-Type: multipart/mixed; boundary="in"\n\n--in' + parts[1] + b"--in--\n"
    return [parts[0], inner, *parts[2:]]


def _deep(levels: int) -> bytes:
    der = b"\x05\x00"
    for _ in range(levels):
        length = len(der)
        size = b"%c" % length if length < 128 else b"\x83" + length.to_bytes(3, "big")
        der = b"\x30" + size + der
    return der


def _inner_text(data: Any, _: Store) -> None:
    """Another text inside the structure whose signature covers the text outside."""
    data["encap_content_info"] = cms.ContentInfo({"content_type": "data", "content": DECOY})


def _no_signers(data: Any, _: Store) -> None:
    data["signer_infos"] = cms.SignerInfos([])


def _enveloped(der: bytes) -> bytes:
    return der.replace(
        core.ObjectIdentifier("1.2.840.113549.1.7.2").dump(), b"\x06\x09\x2a\x86\x48\x86\xf7\r\x01\x07\x03", 1
    )


def _certificates_alone(store: Store) -> None:
    der = pkcs7.serialize_certificates([store.base.permissions.certificate], Encoding.DER)
    with_der(lambda _: der)(store)


def _md5(data: Any, _: Store) -> None:
    for algorithm in (data["digest_algorithms"][0], data["signer_infos"][0]["digest_algorithm"]):
        algorithm["algorithm"] = "md5"


def _late_digest(values: list[Any]) -> list[Any]:
    """A second messageDigest, of the other text."""
    other = next(each for each in values if each["type"].native == "message_digest").copy()
    other["values"] = [b"\x00" * 32]
    return [*values, other]


def _without(kind: str) -> Callable[[list[Any]], list[Any]]:
    return lambda values: [each for each in values if each["type"].native != kind]


def of_message(
    name: str,
    spoil: Callable[[Store], None],
    code: str,
    at: bytes | None = b"\nMI",
    line: int | None = None,
    **more: Any,
) -> Case:
    """`at`: by default the first line of the signature."""
    return case(name, spoil, code, at=None if line is not None else at, line=line, **more)


def _rsa(bits: int, *options: str) -> Callable[[Store], None]:
    """The victim trusts a permissions CA with an RSA key, which signs with `options`."""

    def spoil(store: Store) -> None:
        other = authority(key=rsa_key(bits))
        store.put("permissions_ca.cert.pem", other.pem)
        store.put("governance.p7s", signed_document((store.root / "enclaves/governance.xml").read_bytes(), other))
        by("smime", *options, signers=lambda _: (other,))(store)

    return spoil


PLAIN: Final = "enclaves/victim/permissions.xml"
CA: Final = "enclaves/victim/permissions_ca.cert.pem"

UNSIGNED: Final = (
    of_message(
        "a permissions document in front of the first part",
        replaced(b"This is an S/MIME signed message", DECOY),
        "KA308",
        b"<?xml",
        exit=1,
        options=MEDIUM,
    ),
    of_message(
        "a permissions document behind the last part",
        rewritten(lambda m: m + DECOY),
        "KA308",
        DECOY,
        exit=1,
        options=MEDIUM,
    ),
    of_message(
        "a permissions document in a header",
        rewritten(lambda m: b"X-Note: <dds>*</dds>\n" + m),
        "KA308",
        line=1,
        exit=1,
        options=MEDIUM,
    ),
    Case(
        "a permissions.xml that shows less than what is signed",
        _plain(PLAIN, b"rt/chatter", b"rt/nothing"),
        (Finds("KA110", PLAIN, b"rt/nothing"), Finds("KA110", at=b"rt/chatter")),
        exit=1,
        options=MEDIUM,
    ),
    Case(
        "a governance.xml that shows more protection than what is signed",
        _plain("enclaves/governance.xml", b">SIGN<", b">ENCRYPT<"),
        (Finds("KA110", "enclaves/governance.xml", b"<rtps"), Finds("KA110", "enclaves/governance.p7s", b"<rtps")),
        exit=1,
        options=MEDIUM,
    ),
)

PARTS: Final = (
    of_message("three parts", _pieces(lambda _, p: [*p[:2], b"\n\nx\n", *p[2:]]), "KA305", b"\n--"),
    of_message("a multipart in a part", _pieces(_nested), "KA307", b"multipart/mixed", exit=1),
    of_message("the parts exchanged", _pieces(lambda _, p: [p[0], p[2], p[1], p[3]]), "KA305", line=ANY),
    of_message("the text twice", _pieces(lambda _, p: [p[0], p[1], p[1], *p[2:]]), "KA305", b"\n--"),
    of_message(
        "a second Content-Type",
        rewritten(lambda m: b'Content-Type: multipart/signed; boundary="x"\n' + m),
        "KA305",
        line=3,
    ),
    of_message(
        "a second boundary parameter", replaced(b'; boundary="', b'; boundary="x"; boundary="'), "KA305", line=3
    ),
    of_message(
        "a boundary that begins another one",
        rewritten(lambda m: m.replace(_boundary(m)[2:] + b'"', _boundary(m)[2:-4] + b'"', 1)),
        "KA305",
        line=ANY,
    ),
    of_message("a part that is not text/plain", replaced(b"text/plain", b"text/html"), "KA307", b"text/html", exit=1),
    of_message(
        "the decoy as the signed part",
        rewritten(lambda m: m.replace(TEXT.replace(b"\n", b"\r\n"), DECOY)),
        "KA303",
        line=1,
        exit=1,
    ),
    of_message("no multipart at all", lambda store: store.put("permissions.p7s", TEXT), "KA304", line=1, exit=1),
    of_message("an empty file", lambda store: store.put("permissions.p7s", b""), "KA304", line=1, exit=1),
    of_message("a NUL in front", rewritten(lambda m: b"\x00" + m), "KA304", line=1),
)

HANDS: Final = (
    of_message("signed by the enclave itself", signed_by(lambda store: store.base.victim), "KA302", line=1, exit=1),
    of_message("signed by the other enclave", signed_by(lambda store: store.base.bystander), "KA302", line=1, exit=1),
    of_message("signed by the identity CA", signed_by(lambda store: store.base.identity), "KA301", line=1, exit=1),
    of_message("signed by another authority of the same name", signed_by(_impostor), "KA301", line=1, exit=1),
    of_message(
        "two signers", by("smime", signers=lambda store: (store.base.permissions, store.base.victim)), "KA310", exit=1
    ),
    of_message("no signer", with_structure(_no_signers), "KA315", exit=1),
    of_message("SHA-1", by("smime", "-md", "sha1"), "KA309", exit=1),
    of_message("MD5 as a label", with_structure(_md5), "KA306", exit=1),
    of_message("MD5", _rsa(2048, "-md", "md5"), "KA309", exit=1, bystander_changes=True),
    case("an RSA key of 1,024 bits", _rsa(1024), "KA216", CA, line=1, exit=1, bystander_changes=True),
    of_message("opaque", by("smime", "-nodetach"), "KA311", exit=1, options=MEDIUM),
)

STRUCTURES: Final = (
    of_message("another text inside", with_structure(_inner_text), "KA312"),
    of_message("two digests in the attributes", attributes(_late_digest), "KA306"),
    of_message("no digest in the attributes", attributes(_without("message_digest")), "KA306"),
    of_message("no content type in the attributes", attributes(_without("content_type")), "KA306"),
    of_message("enveloped data", with_der(_enveloped), "KA315", exit=1),
    of_message("certificates alone", _certificates_alone, "KA315", exit=1),
    of_message("an indefinite length", with_der(lambda der: b"\x30\x80" + der[4:] + b"\0\0"), "KA306"),
    of_message("a length of 2^64", with_der(lambda der: b"\x30\x88" + b"\xff" * 8 + der[4:]), "KA306", b"\nMIj/"),
    of_message("bytes behind the structure", with_der(lambda der: der + b"\0"), "KA306"),
    of_message("10,000 levels", with_der(lambda _: _deep(10_000)), "KA306"),
    of_message("300,000 levels of indefinite length", with_der(lambda _: b"\x30\x80" * 300_000), "KA306"),
    of_message(
        "1,500,000 signers that are none",
        with_der(lambda _: b"\x30\x84\x00\x2d\xc6\xc0" + b"\x30\x00" * 1_500_000),
        "KA306",
    ),
    of_message("text in the base64", rewritten(lambda m: SIGNATURE.sub(rb"\1evil!\n\2\3", m)), "KA305", b"evil!"),
    of_message("a signature of nothing", rewritten(lambda m: SIGNATURE.sub(rb"\1\3", m)), "KA306", line=30),
    of_message("random bytes as the signature", with_der(lambda _: bytes(range(256)) * 4), "KA306", b"\nAAEC"),
)

COSTS: Final = (
    of_message("250,000 header lines", rewritten(lambda m: b"X: y\n" * 250_000 + m), "KA305", line=ANY),
    of_message(
        "40,000 boundaries",
        _pieces(lambda _, p: [p[0], *[b"\n"] * 40_000, *p[1:]]),
        "KA305",
        line=ANY,
    ),
    of_message(
        "40,000 boundaries behind the last one",
        rewritten(lambda m: m + (_boundary(m) + b"\n") * 40_000),
        "KA305",
        line=ANY,
    ),
    of_message(
        "a header line of 3 MB", rewritten(lambda m: b"X-Long: " + b"x" * (3 << 20) + b"\n" + m), "KA305", line=1
    ),
    of_message(
        "3 MB of semicolons in a header", replaced(b"; boundary", b";" * (3 << 20) + b" boundary"), "KA305", line=2
    ),
    of_message(
        "3 MB of parentheses in a header", replaced(b"; protocol", b"(" * (3 << 20) + b"; protocol"), "KA305", line=2
    ),
    of_message(
        "3 MB of carriage returns", rewritten(lambda m: m.replace(b"\n", b"\r" * 60_000 + b"\n")), "KA305", line=ANY
    ),
    of_message("3 MB of base64", with_der(lambda _: b"\x30" * (2 << 20)), "KA306", b"\nMDAw"),
    of_message(
        "a text of 3 MB in front",
        replaced(b"This is", b"-" * (3 << 20) + b"\nThis is"),
        "KA308",
        line=ANY,
        exit=1,
        options=MEDIUM,
    ),
    case(
        "3 MB of blank lines in the base64",
        rewritten(lambda m: SIGNATURE.sub(rb"\1" + b"\\n" * (3 << 20) + rb"\2\3", m)),
        exit=0,
    ),
)

CASES: Final = UNSIGNED + PARTS + HANDS + STRUCTURES + COSTS
