"""Profiles share a system only where they read the keystore alike."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.serialization import Encoding
from msgspec.structs import replace

from keystore_audit import toml
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.participants.lone_endpoints import LoneEndpoints
from keystore_audit.model.participants.views import Fleet, Kind
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.profiles import VARIANTS, Access
from tests.keystore.builder import Signed, authority
from tests.keystore.messages import by_openssl, with_signature
from tests.oracles.smime.der import attribute, tlv
from tests.oracles.smime.signed_data import CONTENT_TYPE, GOOD, Info
from tests.oracles.vendors.recipes_signers import _ca

SAMPLES = Path(__file__).resolve().parents[2] / "sample_keystores"
STORES = sorted(
    [
        *(SAMPLES / "healthy").glob("*/"),
        *(SAMPLES / "stock").glob("*/"),
        *(SAMPLES / "rules").glob("KA2*/bad"),
        *(SAMPLES / "rules").glob("KA3*/bad"),
        *(SAMPLES / "rules").glob("KA5*/bad"),
        *(SAMPLES / "rules").glob("KA70*/bad"),
    ]
)


def builder_of(store: Path, at: datetime) -> tuple[SystemBuilder, Callable[[str], Kind]]:
    """What builds the systems of a keystore, and what a variant makes of it by itself."""
    keystore = read_keystore(store)
    accesses = AccessViews(documents_of(keystore), at, None)
    builder = SystemBuilder(keystore, list(VARIANTS.values()), at, accesses)
    channels = builder.channels
    lone = LoneEndpoints(keystore, accesses, channels, builder.instants, at, channels.meets)

    def kind(name: str) -> Kind:
        variant = VARIANTS[name]
        return Kind(variant.trust, accesses.row(variant.access), lone.of(variant))

    return builder, kind


class WithSwitch(Access, frozen=True, kw_only=True, eq=False):
    """A switch that nobody has told when a document gives an occasion for it."""

    ignores_deny_rules: bool


def test_a_switch_that_nobody_thought_of_is_never_the_specifications() -> None:
    """Rows were rebuilt from the specification's, field by field, and `can` said DENY where a new profile allows."""
    accesses = AccessViews((), datetime(2026, 11, 24, tzinfo=UTC), None)
    own = {name: getattr(VARIANTS["fastdds-2.14"].access, name) for name in Access.__struct_fields__}
    ignoring, obeying = (accesses.row(WithSwitch(ignores_deny_rules=which, **own)) for which in (True, False))
    assert [row.ignores_deny_rules for row in (ignoring, obeying)] == [True, False]  # type: ignore[attr-defined]
    assert ignoring is not obeying


def test_no_document_gives_an_occasion_for_a_difference() -> None:
    """Every field of a row is known, so that without documents all implementations read alike."""
    accesses = AccessViews((), datetime(2026, 11, 24, tzinfo=UTC), None)
    assert len({accesses.row(variant.access) for variant in VARIANTS.values()}) == 1


@pytest.mark.parametrize("store", STORES, ids=lambda store: str(store.relative_to(SAMPLES)))
def test_what_one_system_stands_for_is_equal(store: Path) -> None:
    about = toml.loads(store.with_suffix(".toml").read_text(encoding="utf-8"))
    builder, alone = builder_of(store, datetime.fromisoformat(about["at"].replace("Z", "+00:00")))
    systems = [system for system in builder.systems() if system.may]
    assert sorted(name for system in systems for name in system.profiles) == sorted(VARIANTS)
    for system in systems:
        for name in system.profiles:
            built = builder.build(Fleet((alone(name),)), may=True)
            assert replace(built, profiles=system.profiles) == system, name


def test_whoever_pins_takes_the_first_of_a_number_by_its_key(tmp_path: Path) -> None:
    """A renewed authority of the old key and number signs for the old one, one with another key for nobody."""
    at = datetime.fromisoformat("2026-11-21T12:00:00+00:00")
    first = authority(serial=1)
    renewed, twin = authority(key=first.key, serial=1), authority(serial=1)
    for name, file, signer in (("a", first.pem + twin.pem, renewed), ("b", renewed.pem, first), ("c", twin.pem, twin)):
        _ca("of the test", file, signer).build(tmp_path / "enclaves" / name)
    builder, alone = builder_of(tmp_path, at)
    system = builder.build(Fleet((alone("fastdds-3.6"),)), may=True)
    trust_domains = {
        enclave.label: system.trust_domains[enclave.trust_domain].permissions_ca for enclave in system.enclaves
    }
    signers = {document.location.path.split("/")[1]: document.signers for document in system.documents}
    assert trust_domains["/a"] == trust_domains["/b"] >= signers["a"] | signers["b"]
    assert trust_domains["/c"] == signers["c"]


def bringing(document: bytes, signer: Signed, *brought: Signed) -> bytes:
    """A message of which the certificates stand in this order."""
    entity = b"Content-Type: text/plain\r\n\r\n" + document.replace(b"\n", b"\r\n")
    digest = attribute("1.2.840.113549.1.9.4", tlv(4, hashlib.sha256(entity).digest()))
    certificates = tlv(0xA0, *(each.certificate.public_bytes(Encoding.DER) for each in brought))
    info = Info(signer=signer, attributes=(CONTENT_TYPE, digest))
    made = replace(GOOD, certificates=certificates, infos=(info,)).der()
    return with_signature(by_openssl(("smime", "-text"), signer, content=document), made)


def test_whoever_does_not_pin_takes_the_first_of_a_number_in_the_message(tmp_path: Path) -> None:
    """One with another key did not sign it, whoever stands behind (tests/oracles/smime asks OpenSSL)."""
    signer = authority(serial=1)
    twin = authority(serial=1)
    for name, brought in (("a", (signer, twin)), ("b", (twin, signer))):
        recipe = _ca("of the test", signer.pem, signer)
        enclave = recipe.build(tmp_path / "enclaves" / name)
        (enclave / "permissions.p7s").write_bytes(bringing(recipe.permissions.encode(), signer, *brought))
    builder, alone = builder_of(tmp_path, datetime.fromisoformat("2026-11-21T12:00:00+00:00"))
    system = builder.build(Fleet((alone("fastdds-2.9"),)), may=True)
    signers = {document.location.path.split("/")[1]: document.signers for document in system.documents}
    assert (len(signers["a"]), signers["b"]) == (1, frozenset())


def test_kinds_are_told_apart() -> None:
    """By signer alone where all is plain; by subjects and by what of a CA file is read where that matters."""
    at = datetime.fromisoformat("2026-11-21T12:00:00+00:00")

    def kinds(name: str) -> set[frozenset[str]]:
        store = next((SAMPLES / "rules").glob(f"{name}*")) / "bad" if name.startswith("KA") else SAMPLES / name
        return {frozenset(system.profiles) for system in builder_of(store, at)[0].systems()}

    unpinned = frozenset({"fastdds-2.6.4", "fastdds-2.9", "cyclonedds-0.10"})
    assert kinds("healthy/turtlesim") == {unpinned, frozenset(VARIANTS) - unpinned}
    assert frozenset({"cyclonedds-11"}) in kinds("KA519")
    assert frozenset({"cyclonedds-0.10"}) in kinds("KA519")
    assert {frozenset({"cyclonedds-11"}), frozenset({"opendds"})} <= kinds("KA226"), "kinds with origin"
