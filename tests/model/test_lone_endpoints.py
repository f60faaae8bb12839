"""What an enclave's own implementation lets it read and write is in its system, whether or not peers concede it."""

from __future__ import annotations

from collections import Counter
from datetime import timedelta
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.serialization import Encoding
from msgspec.structs import replace

from keystore_audit.keystore.keystore import Enclave, read_keystore
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.channels import Channels
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.formal.attacker import TrustDomainView
from keystore_audit.model.formal.bit_sets import bits, members
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import System
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.profiles import VARIANTS
from keystore_audit.truth import Truth
from tests.amount import tried
from tests.keystore import documents
from tests.keystore.builder import START, Signed, certificate, crl
from tests.keystore.documents import criterion, governance, grant, permissions, rule
from tests.model.comparing import Member, Store
from tests.oracles.vendors import random_keystores, recipe

EVERY = tuple(VARIANTS.values())


def alone(permissions: str, root: Path, profile: str) -> tuple[set[tuple[str, str]], set[tuple[str, str]]]:
    """Names and partitions that /talker reads, and writes, though peers refuse, in the stock governance."""
    recipe.Recipe(title="", permissions=permissions).build(root)
    keystore = read_keystore(root)
    accesses = AccessViews(documents_of(keystore), recipe.NOW, None)
    [system] = SystemBuilder(keystore, (VARIANTS[profile],), recipe.NOW, accesses).systems()
    peer_authorised = TrustDomainView(system, 0, Permissions(system)).abilities(0)
    enclave = system.enclaves[0]

    def named(channels: frozenset[int], peer_authorised: int) -> set[tuple[str, str]]:
        found = (system.channels[c] for c in channels if not peer_authorised >> c & 1)
        return {(channel.topic, channel.partition) for channel in found}

    return named(enclave.reads_alone, peer_authorised.may_read), named(enclave.writes_alone, peer_authorised.may_write)


@pytest.mark.parametrize(("relayed", "expected"), [("rt/a", {("rt/a", "")}), ("rt/b", set())])
def test_what_a_relay_takes_from_peers_alone(relayed: str, expected: set[tuple[str, str]], tmp_path: Path) -> None:
    """Fast DDS: to peers, a rule that lists a topic for relaying in some partitions denies it in all others."""
    rules = (
        documents.allow(documents.criterion("relay", relayed, partitions=("p",))),
        documents.allow(documents.sub("rt/a")),
    )
    assert alone(recipe.of_rules(*rules), tmp_path / "k", "fastdds-3.6") == (expected, set())


def test_a_rule_of_another_domain(tmp_path: Path) -> None:
    """Fast DDS applies it to its own readers and writers; Cyclone DDS does not."""
    rules = recipe.of_rules(documents.allow(documents.sub("rt/a"), documents.pub("rt/b"), domains=documents.ids(9)))
    assert alone(rules, tmp_path / "fast", "fastdds-3.6") == ({("rt/a", "")}, {("rt/b", "")})
    assert alone(rules, tmp_path / "cyclone", "cyclonedds-11") == (set(), set())


@pytest.mark.parametrize(("partition", "met"), [("?", True), ("secre?", True), ("open", False)])
def test_endpoints_that_peers_refuse_are_met_where_their_partitions_are_patterns(
    partition: str, met: bool, tmp_path: Path
) -> None:
    """A rule for `?` admits an endpoint in `*`, which meets every partition."""
    rules = recipe.of_rules(
        documents.allow(documents.sub("rt/a", partitions=(partition,)), domains=documents.ids(9)),
        documents.allow(documents.pub("rt/b", partitions=(partition,)), domains=documents.ids(9)),
        documents.allow(documents.pub("rt/a", partitions=("secret",)), documents.sub("rt/b", partitions=("secret",))),
    )
    reads, writes = alone(rules, tmp_path / "k", "fastdds-3.6")
    assert (("rt/a", "secret") in reads, ("rt/b", "secret") in writes) == (met, met)


def days_of(keystore_root: Path, profile: str) -> list[int]:
    """The days, of the first thousand, on which what /e reads by itself becomes something, or nothing, in turn."""
    accesses = AccessViews(documents_of(keystore := read_keystore(keystore_root)), recipe.NOW, None)
    [system] = SystemBuilder(keystore, (VARIANTS[profile],), recipe.NOW, accesses).systems()
    [enclave] = system.enclaves
    found = [False]
    days = []
    for moment in range(2 * system.now, 2 * len(system.instants)):
        reads = bool(enclave.at(moment).reads_alone)
        if reads != found[-1]:
            found.append(reads)
            days.append(round((system.instants[moment // 2] - recipe.NOW) / timedelta(days=1)))
    return [each for each in days if each < 1000]


@pytest.mark.parametrize(
    ("begins", "ends", "days"), [(5, 10, [5, 10]), (-10, 10, [0, 10]), (-10, -5, []), (None, None, [0])]
)
def test_what_it_reads_while_its_revocation_list_is_in_force(
    begins: int | None, ends: int | None, days: list[int], tmp_path: Path
) -> None:
    """Until then it does not start, and where the list has ended it never does."""
    document = permissions(grant("/e", rule(criterion("subscribe", "rt/a"), domains="<id>9</id>")))
    store = Store(members={"/e": Member(permissions=document)}, governance=governance())
    if begins is not None and ends is not None:
        since = round((recipe.NOW - START) / timedelta(days=1))
        listed = crl(
            store.identity[0],
            end=recipe.NOW + timedelta(days=ends),
            days=since + begins,
        )
        store = replace(store, files={"enclaves/e/crl.pem": listed.public_bytes(Encoding.PEM)})
    assert days_of(store.write(tmp_path), "fastdds-3.6") == days


@pytest.mark.parametrize(("first", "last", "days"), [(-9, 9, [0, 9]), (3, 9, [3, 9]), (-9, -3, [])])
def test_what_a_grant_of_other_dates_lets_it_read(first: int, last: int, days: list[int], tmp_path: Path) -> None:
    """Not before it begins, nor after it has ended."""
    dates = [f"{recipe.NOW + timedelta(days=each):%Y-%m-%dT%H:%M:%S}" for each in (first, last)]
    lasting = grant("/e", rule(criterion("subscribe", "rt/a"), domains="<id>9</id>"), start=dates[0], end=dates[1])
    store = Store(members={"/e": Member(permissions=permissions(lasting))}, governance=governance())
    assert days_of(store.write(tmp_path), "fastdds-3.6") == days


@pytest.mark.parametrize(("profile", "reads"), [("fastdds-2.9", True), ("cyclonedds-0.10", False)])
def test_what_it_reads_once_the_older_authority_is_over(profile: str, reads: bool, tmp_path: Path) -> None:
    """Until then Fast DDS takes the older one of the name for the issuer; Cyclone DDS knows no other than the first."""
    store, new = rolled_over()
    document = permissions(grant("/e", rule(criterion("subscribe", "rt/a"), domains="<id>9</id>")))
    keystore = read_keystore(replace(store, members={"/e": Member(permissions=document, issuer=new)}).write(tmp_path))
    accesses = AccessViews(documents_of(keystore), recipe.NOW, None)
    [enclave], usabilities = keystore.enclaves, Usabilities(None, accesses)
    assert usabilities.of(enclave, recipe.NOW, VARIANTS[profile]).usable is Truth.NO
    assert usabilities.of(enclave, recipe.NOW + timedelta(days=31), VARIANTS[profile]).usable.must is reads
    assert days_of(Path(keystore.root), profile) == ([30] if reads else [])


@pytest.mark.parametrize("lists", [1, 2])
def test_whom_the_list_of_an_authority_takes_back_until_that_is_over(lists: int, tmp_path: Path) -> None:
    """Then the list of the next authority of the name counts; where there is none, nobody is let in."""
    store, new = rolled_over()
    document = permissions(grant("/e", rule(criterion("subscribe", "rt/a"))))
    store = replace(store, members={"/e": Member(permissions=document, issuer=new, serial=100)})
    old, next_ = (each.public_bytes(Encoding.PEM) for each in (crl(store.identity[0], [100]), crl(new, days=1)))
    files = {"enclaves/e/identity_ca.cert.pem": b"".join(each.pem for each in store.identity) + old}
    files |= {"enclaves/e/crl.pem": next_} if lists == 2 else {}
    keystore = read_keystore(replace(store, files=files).write(tmp_path))
    accesses, row = AccessViews(documents_of(keystore), recipe.NOW, None), VARIANTS["fastdds-2.9"]
    [system] = SystemBuilder(keystore, (row,), recipe.NOW, accesses).systems()
    [trust_domain], [identity] = system.trust_domains, {enclave.identity for enclave in system.enclaves}
    assert trust_domain.revoked == {identity}
    after = recipe.NOW + timedelta(days=31)
    assert Usabilities(None, accesses).of(keystore.enclaves[0], after, row).usable.must is (lists == 2)
    by_moment = [each for moment, each in trust_domain.revoked_later if system.instants[moment // 2] <= after]
    assert by_moment[-1:] == ([frozenset()] if lists == 2 else [])


def rolled_over() -> tuple[Store, Signed]:
    """A keystore whose identity CA file holds one that has a month left, and behind it the next of its name."""
    old = certificate("root", ca=True, serial=7, end=recipe.NOW + timedelta(days=30))
    new = certificate("root", ca=True, serial=8)
    return Store(members={}, identity=(old, new)), new


def random_case(seed: int, root: Path) -> tuple[Enclave, AccessViews, Channels, dict[str, System]]:
    """An enclave whose rules compete, and by profile what may be read of its keystore."""
    random_keystores.keystore(seed).build(root / str(seed))
    keystore = read_keystore(root / str(seed))
    accesses = AccessViews(documents_of(keystore), recipe.NOW, None)
    builder = SystemBuilder(keystore, EVERY, recipe.NOW, accesses)
    [enclave] = keystore.enclaves
    systems = {name: s for s in builder.systems() if s.may for name in s.profiles}
    return enclave, accesses, builder.channels, systems


@pytest.mark.parametrize("start", range(0, tried(240, 80), 40))
def test_nothing_that_is_read_or_written_is_missing(start: int, tmp_path: Path) -> None:
    """Of random documents whose rules compete: by the decision about each channel, and whether it starts there."""
    lone: Counter[Operation] = Counter()
    for seed in range(start, start + 40):
        enclave, accesses, channels, systems = random_case(seed, tmp_path)
        rights = LocalRights(accesses, channels, recipe.NOW)
        starts = [Usabilities(each.intervals[0][0], accesses) for each in channels.domains]
        for profile in EVERY:
            system = systems[profile.name]
            atom, peer_authorised = system.enclaves[0], TrustDomainView(system, 0, Permissions(system)).abilities(0)
            sides = (
                (Operation.SUBSCRIBE, peer_authorised.may_read, bits(atom.reads_alone)),
                (Operation.PUBLISH, peer_authorised.may_write, bits(atom.writes_alone)),
            )
            for operation, by_peers, kept in sides:
                found = bits(
                    channel
                    for channel in members(rights.allowed(enclave, profile, operation))
                    if starts[system.channels[channel].domain].of(enclave, recipe.NOW, profile).usable.may
                )
                assert found & ~by_peers & ~kept == 0, (seed, profile.name, operation)
                lone[operation] += bool(kept & ~by_peers)
    assert min(lone[Operation.SUBSCRIBE], lone[Operation.PUBLISH]) >= 10
