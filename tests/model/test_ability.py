"""`able`: what has to be true now and until a date, in the domain that is used."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa
from cryptography.hazmat.primitives.serialization import Encoding
from msgspec.structs import replace

from keystore_audit.engine.native import NativeEngine
from keystore_audit.findings import Location
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.claims.globs import Globs
from keystore_audit.model.claims.stated import Claim
from keystore_audit.model.formal.asked import Attacker, ClaimKind
from keystore_audit.model.interpret import interpret
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.profiles import resolve
from keystore_audit.properties import Status
from tests.keystore.builder import START, Signed, certificate, crl, key, signed_document
from tests.keystore.documents import criterion, domain_rule, governance, grant, permissions, rule, topic_rule
from tests.model.comparing import AT, Member, Store, authority

ONE, OTHER = authority("one"), authority("other")
NAMESAKE = certificate("one", ca=True, key=key("namesake"), serial=8)
WITH_RSA = certificate("one", ca=True, key=rsa.generate_private_key(65537, 2048), serial=9)

ENDS = datetime(2027, 3, 1, tzinfo=timezone.utc)
BEFORE, AFTER = (datetime(year, 2, 1, tzinfo=timezone.utc) for year in (2027, 2028))

TALKER = Member(permissions=permissions(grant("/e", rule(criterion("publish", "rt/a")))))
LISTENER = Member(permissions=permissions(grant("/f", rule(criterion("subscribe", "rt/a")))))
STORE = Store(
    members={"/e": TALKER, "/f": LISTENER}, governance=governance(domain_rule(domains="<id>0</id><id>9</id>"))
)


def apart(store: Store, root: Path, profile: str, *, until: datetime | None = None) -> bool:
    """Whether /e and /f never share a domain."""
    return holds(store, root, until=until, profiles=(profile,), kind=ClaimKind.SEPARATE_DOMAINS)


def holds(
    store: Store,
    root: Path,
    *,
    until: datetime | None = None,
    domain: int | None = None,
    profiles: tuple[str, ...] = ("fastdds", "cyclonedds"),
    kind: ClaimKind = ClaimKind.ABLE,
) -> bool:
    """Whether /e can reach /f, for every profile; or another kind of claim about the two."""
    keystore = read_keystore(store.write(root))
    accesses = AccessViews(documents_of(keystore), AT, None)
    claim = Claim(
        id="able",
        statement="",
        kind=kind,
        attacker=Attacker.HONEST,
        source=Globs(enclaves=("/e",)),
        target=Globs(enclaves=("/f",)),
        until=until,
        location=Location(path="s.toml", beside=True),
        place="s.toml:1:1",
    )
    found = interpret(keystore, resolve(profiles), AT, accesses, Usabilities(domain, accesses), [claim])
    answers = NativeEngine(found.systems).answers
    [answer] = {each["able"].status for each in answers}
    return answer is Status.HOLDS


@pytest.mark.parametrize(
    "ending",
    [
        STORE.member("/f", end=ENDS),
        Store(members=STORE.members, governance=STORE.governance, revoked=(), crl_end=ENDS),
        STORE.member("/f", permissions=LISTENER.permissions.replace("2034-01-01", "2027-03-01")),
    ],
    ids=["certificate", "revocation list", "grant"],
)
def test_it_lasts_until_something_ends(ending: Store, tmp_path: Path) -> None:
    assert holds(ending, tmp_path / "now")
    assert holds(ending, tmp_path / "before", until=BEFORE)
    assert not holds(ending, tmp_path / "after", until=AFTER)
    assert holds(STORE, tmp_path / "nothing", until=AFTER)


def test_a_key_that_signs_no_digest(tmp_path: Path) -> None:
    """Fast DDS starts with it, and never talks (measured on 2.9.1)."""
    kinds = {"ec": ec.generate_private_key(ec.SECP384R1()), "edwards": ed25519.Ed25519PrivateKey.generate()}
    for kind, private in kinds.items():
        own = certificate("/f", STORE.identity[0], key=private)
        files = {"enclaves/f/cert.pem": own.pem, "enclaves/f/key.pem": own.key_pem}
        talks = holds(replace(STORE, files=files), tmp_path / kind, profiles=("fastdds-2.9",))
        assert talks is (kind == "ec")


def test_it_is_asked_in_the_domain_that_is_used(tmp_path: Path) -> None:
    """Both start in 9 as well, by a rule about another topic, and nothing of one reaches the other there."""
    store = STORE
    for path, member in STORE.members.items():
        own = rule(criterion("publish", f"rt{path}"), domains="<id>9</id>")
        store = store.member(path, permissions=member.permissions.replace("<default>", own + "<default>"))
    assert holds(store, tmp_path / "any")
    assert holds(store, tmp_path / "zero", domain=0)
    assert not holds(store, tmp_path / "nine", domain=9)


def rights(topic: str, partitions: tuple[str, ...] = (), by: str = governance()) -> Store:
    """/e may publish the topic and /f subscribe to it, in these partitions."""
    talker = permissions(grant("/e", rule(criterion("publish", topic, partitions=partitions))))
    listener = permissions(grant("/f", rule(criterion("subscribe", topic, partitions=partitions))))
    members = {"/e": Member(permissions=talker), "/f": Member(permissions=listener)}
    return Store(members=members, governance=by)


def test_starting_is_asked_in_the_domain_of_the_path(tmp_path: Path) -> None:
    """OpenDDS starts in 9 alone, where neither has a right; without join access control in 0 it starts there too."""
    nine = domain_rule(domains="<id>9</id>", join="false")
    stock, loose = domain_rule(), domain_rule(join="false")
    assert not holds(rights("rt/a", by=governance(stock, nine)), tmp_path / "nine", profiles=("opendds",))
    assert holds(rights("rt/a", by=governance(loose, nine)), tmp_path / "zero", profiles=("opendds",))
    assert holds(rights("rt/a", by=governance(stock, nine)), tmp_path / "spec", profiles=("spec",))
    odd = topic_rule("rt/z", read="false") + topic_rule()
    assert holds(rights("rt/a", by=governance(domain_rule(odd), nine)), tmp_path / "z", profiles=("opendds",))


# --- never_share_domain: also what an enclave's own implementation makes of its permissions


def parted(by: str, own: str = "<id>9</id>", **dates: str) -> Store:
    """/e has rights in domain 0, /f in `own`."""
    talker = permissions(grant("/e", rule(criterion("publish", "rt/a"))))
    listener = permissions(grant("/f", rule(criterion("subscribe", "rt/a"), domains=own), **dates))
    return Store(members={"/e": Member(permissions=talker), "/f": Member(permissions=listener)}, governance=by)


BOTH = governance(domain_rule(domains="<id>0</id><id>9</id>"))


@pytest.mark.parametrize("profile", ["spec", "cyclonedds-11"])
@pytest.mark.parametrize(("own", "expected"), [("<id>0</id>", False), ("<id>9</id>", True)])
def test_members_of_one_domain_who_trust_different_authorities(
    profile: str, own: str, expected: bool, tmp_path: Path
) -> None:
    """Each is let in by peers that trust as it does. In domains of their own they are apart."""
    first, second = (governance(domain_rule(domains=domain)) for domain in ("<id>0</id>", own))
    store = parted(first, own).member("/f", signer=ONE, governance=second)
    signed = signed_document(second.encode(), ONE)
    files = {"enclaves/f/permissions_ca.cert.pem": ONE.pem, "enclaves/f/governance.p7s": signed}
    assert apart(replace(store, files=files), tmp_path, profile) is expected


@pytest.mark.parametrize("ends", [AFTER, datetime(2027, 4, 1, tzinfo=timezone.utc)], ids=["goes on", "is over"])
def test_one_that_starts_there_while_its_list_is_in_force(ends: datetime, tmp_path: Path) -> None:
    """Of one list no date is an instant of the system."""
    store = parted(BOTH)
    days = (ENDS - START).days
    listed = crl(store.identity[0], end=ends, days=days).public_bytes(Encoding.PEM)
    files = {f"enclaves/{name}/crl.pem": listed for name in ("e", "f")}
    later = replace(store, files=files)
    assert apart(later, tmp_path / "now", "fastdds-3.6")
    assert apart(later, tmp_path / "before", "fastdds-3.6", until=BEFORE)
    assert not apart(later, tmp_path / "after", "fastdds-3.6", until=AFTER)


def test_one_that_starts_there_before_the_date(tmp_path: Path) -> None:
    later = parted(BOTH, start="2027-03-01T00:00:00")
    assert apart(later, tmp_path / "now", "fastdds-3.6")
    assert apart(later, tmp_path / "before", "fastdds-3.6", until=BEFORE)
    assert not apart(later, tmp_path / "after", "fastdds-3.6", until=AFTER)


@pytest.mark.parametrize(
    ("profile", "theirs", "expected"),
    [
        ("fastdds", (ONE, OTHER), True),
        ("fastdds", (OTHER, ONE), False),
        ("fastdds-2.6", (OTHER, ONE), False),
        ("fastdds", (NAMESAKE, ONE, OTHER), True),  # names are compared, not keys
        ("fastdds", (WITH_RSA, ONE, OTHER), False),  # and kinds of signature
        ("spec", (WITH_RSA, ONE, OTHER), True),
        ("spec", (OTHER, ONE), True),
    ],
)
def test_fastdds_compares_the_names_of_the_first_permissions_cas(
    profile: str, theirs: tuple[Signed, ...], expected: bool, tmp_path: Path
) -> None:
    store = replace(STORE, permissions=(ONE, OTHER), governance_signer=ONE).member("/f", signer=OTHER)
    files = {"enclaves/f/permissions_ca.cert.pem": b"".join(each.pem for each in theirs)}
    assert holds(replace(store, files=files), tmp_path, profiles=(profile,)) is expected


@pytest.mark.parametrize(
    ("profile", "blanks", "expected"),
    [("fastdds-2.9", 59_000, True), ("fastdds-2.9", 62_000, False), ("cyclonedds-0.10", 62_000, True)],
)
def test_permissions_that_fit_in_no_handshake(profile: str, blanks: int, expected: bool, tmp_path: Path) -> None:
    """Fast DDS sends certificate and permissions in one message of 64 kB (measured on 2.9.1), Cyclone DDS in parts."""
    padded = LISTENER.permissions.replace("</permissions>", " " * blanks + "</permissions>")
    assert holds(STORE.member("/f", permissions=padded), tmp_path / "k", profiles=(profile,)) is expected
