"""What is worked out once for several instants or implementations is what each of them gives by itself."""

from __future__ import annotations

import random
from datetime import datetime, timedelta, timezone
from itertools import pairwise
from pathlib import Path

import pytest

from keystore_audit.keystore.keystore import Keystore, read_keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.trust import chain
from keystore_audit.model.trust import verdicts as trust
from keystore_audit.profiles import VARIANTS
from keystore_audit.truth import Truth
from tests.keystore import builder
from tests.keystore.documents import criterion, grant, permissions, rule
from tests.model.comparing import Member, Store

AT = datetime(2026, 6, 1, tzinfo=timezone.utc)
SAMPLES = Path(__file__).parents[2] / "sample_keystores"
STORES = sorted(
    {
        path
        for pattern in ("KA2*", "KA5*", "KA317*")
        for path in (SAMPLES / "rules").glob(f"{pattern}/*")
        if path.is_dir()
    }
    | {SAMPLES / name for name in ("healthy/turtlesim", "stock/talker_listener", "flows/chatter_written_elsewhere")}
)


def instants(keystore: Keystore, accesses: AccessViews) -> list[datetime]:
    """Every date of a certificate, a list or a grant, the seconds around it, and what lies between, in no order."""
    dates = {AT}
    for enclave in keystore.enclaves:
        for file in (enclave.identity_ca, enclave.certificate, enclave.permissions_ca):
            for certificate in file.certificates if file else ():
                dates |= {certificate.not_before, certificate.not_after}
            for revocations in file.revocation_lists if file else ():
                dates |= {revocations.this_update, revocations.next_update or AT}
        for revocations in enclave.crl.revocation_lists if enclave.crl else ():
            dates |= {revocations.this_update, revocations.next_update or AT}
        for profile in VARIANTS.values():
            read = accesses.read(enclave.permissions, profile.access) if enclave.permissions else None
            for each in (read.grants or ()) if read else ():
                dates |= {each.not_before, each.not_after}
    ordered = sorted(dates)
    second = timedelta(seconds=1)
    found = {date + step for date in ordered if 1950 < date.year < 9999 for step in (-second, 0 * second, second)}
    found |= {low + (high - low) / 2 for low, high in pairwise(ordered)}
    shuffled = sorted(found)
    random.Random(7).shuffle(shuffled)
    return shuffled[:40]


@pytest.mark.parametrize("store", STORES, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_an_answer_kept_for_another_instant_is_that_of_the_instant(store: Path) -> None:
    keystore = read_keystore(store)
    accesses = AccessViews(documents_of(keystore), AT, None)
    kept = Usabilities(None, accesses)
    for at in instants(keystore, accesses):
        alone = Usabilities(None, accesses)
        for profile in VARIANTS.values():
            for enclave in keystore.enclaves:
                assert kept.of(enclave, at, profile) == alone.of(enclave, at, profile), (at, profile.name)


@pytest.mark.parametrize("store", STORES, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_an_answer_shared_among_enclaves_and_instants_is_that_of_each_alone(store: Path) -> None:
    keystore = read_keystore(store)
    accesses = AccessViews(documents_of(keystore), AT, None)
    shared = Usabilities(None, accesses)
    answers = {}
    for profile in VARIANTS.values():
        for enclave in keystore.enclaves:
            answers[enclave, profile.name] = shared.of(enclave, AT, profile)
            assert answers[enclave, profile.name] == Usabilities(None, accesses).of(enclave, AT, profile), profile.name
    for at in instants(keystore, accesses):
        for profile in VARIANTS.values():
            for enclave in keystore.enclaves:
                if at >= AT and not any(date <= at for date in shared.dates(enclave, profile, AT)):
                    later = Usabilities(None, accesses).of(enclave, at, profile)
                    assert later == answers[enclave, profile.name], (at, profile.name)


def test_of_copies_in_place_of_links_the_enclave_s_own_is_named(tmp_path: Path) -> None:
    root = builder.sros2(tmp_path / "k", ["/a", "/b"], links=False)
    another = builder.authority("another").pem
    for name in "ab":
        (root / f"enclaves/{name}/identity_ca.cert.pem").write_bytes(another)
    keystore = read_keystore(root)
    usabilities = Usabilities(None, AccessViews(documents_of(keystore), AT, None))
    for each in keystore.enclaves:
        (reason,) = usabilities.of(each, AT, VARIANTS["spec"]).reasons
        assert f" {each.files.directory}/identity_ca.cert.pem " in reason


def test_what_is_said_of_many_enclaves_at_an_instant_names_no_file_of_one(tmp_path: Path) -> None:
    root = builder.sros2(tmp_path / "keystore", ["/a", "/b"], split=True)
    year = timedelta(days=365)
    old, new = (builder.authority("p", start=builder.START + y, end=builder.END + y) for y in (0 * year, year))
    (root / "public/permissions_ca.cert.pem").write_bytes(old.pem + new.pem)
    (root / "enclaves/governance.p7s").write_bytes(builder.signed_document(builder.GOVERNANCE, old))
    for name in ("a", "b"):
        document = builder.PERMISSIONS.format(name=f"/{name}").encode()
        (root / f"enclaves/{name}/permissions.p7s").write_bytes(builder.signed_document(document, new))
    keystore = read_keystore(root)
    usabilities = Usabilities(None, AccessViews(documents_of(keystore), AT, None))
    first, second = (usabilities.of(each, AT, VARIANTS["fastdds-2.9"]).reasons for each in keystore.enclaves)
    assert first == second
    assert [reason.partition(" is")[0] for reason in first] == ["permissions.p7s"]


@pytest.mark.parametrize("store", STORES, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_a_chain_and_a_signer_looked_for_once_are_those_of_each_implementation(store: Path) -> None:
    keystore = read_keystore(store)
    for enclave in keystore.enclaves:
        for file in (enclave.identity_ca, enclave.permissions_ca):
            for other in keystore.enclaves:
                certificate = other.certificate.first if other.certificate else None
                if file is None or certificate is None:
                    continue
                for profile in VARIANTS.values():
                    own = profile.trust
                    for document in (other.governance, other.permissions):
                        if document is not None:
                            signed = document.signed
                            verdict = trust.document_verdict(signed, file, own)
                            assert verdict is trust._document_verdict(signed, file, own)
                    assert chain.chain_refusal(certificate, file, own) == chain._chain_refusal(
                        certificate, file, own, None
                    )
                    for at in (None, AT):
                        asked = trust.is_issued(file, certificate, own, at)
                        assert asked == trust._is_issued(file, certificate, own, at)


@pytest.mark.parametrize("own", ["/a", "/c"])
def test_who_stands_in_the_identity_ca_file_is_told_from_those_it_issued(own: str, tmp_path: Path) -> None:
    """A certificate there that is no authority is taken for itself, and vouches for nobody; whoever is asked first."""
    lone = builder.certificate(own)
    members = {
        path: Member(permissions=permissions(grant(path, rule(criterion("publish", "rt/t"))))) for path in (own, "/b")
    }
    files = {f"enclaves{own}/cert.pem": lone.pem, f"enclaves{own}/key.pem": lone.key_pem}
    root = Store(members=members, identity=(lone,), files=files).write(tmp_path / "k")
    shared = root / "enclaves/b/identity_ca.cert.pem"
    shared.unlink()
    shared.symlink_to(f"..{own}/identity_ca.cert.pem")
    keystore = read_keystore(root)
    for profile in VARIANTS.values():
        usabilities = Usabilities(None, AccessViews(documents_of(keystore), AT, None))
        found = {each.path: usabilities.of(each, AT, profile) for each in keystore.enclaves}
        assert found["/b"].usable is Truth.NO, profile.name
        assert any("is no authority" in reason for reason in found["/b"].reasons)
        refused = [reason for reason in found[own].reasons if "issue" in reason]
        assert not refused, (profile.name, refused)
