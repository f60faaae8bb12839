"""What pictures show, held against what the engines and `can` are asked with."""

from __future__ import annotations

import re
from datetime import datetime, timezone
from functools import cache
from pathlib import Path

import pytest

from keystore_audit.access import Access
from keystore_audit.circumstances import Circumstances
from keystore_audit.findings import Location
from keystore_audit.keystore.keystore import Keystore, read_keystore
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.formal.asked import Attacker, Place, Search
from keystore_audit.model.formal.attacker import trust_domain_views
from keystore_audit.model.formal.bit_sets import members
from keystore_audit.model.formal.flow import Flows
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.question import Question
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.model.tables.overview import MAX_VIEWS, Overview, overview
from keystore_audit.profiles import VARIANTS, resolve
from keystore_audit.truth import Truth
from tests.cli.keystores import keystore, rule
from tests.keystore.documents import allow, domain_rule, governance, grant, permissions, pub, topic_rule
from tests.model.comparing import Member, Store

SAMPLES = Path(__file__).resolve().parents[2] / "sample_keystores"
AT = datetime(2026, 11, 21, 12, tzinfo=timezone.utc)
LOOKED_AT = (
    "flows/vehicle_healthy",
    "flows/vehicle_governance_flag",
    "flows/vehicle_plain_grant",
    "flows/turtlesim_shared_ca",
    "flows/chatter_unreadable_enclave",
    "stock/talker_listener",
    "healthy/service_action",
)
Drawn = set[tuple[str | None, int, str | None, bool]]


def overview_of(root: Path, profiles: tuple[str, ...] = ()) -> tuple[Keystore, Overview]:
    read = read_keystore(root)
    accesses = AccessViews(documents_of(read), AT, None)
    chosen = resolve(profiles)
    systems = SystemBuilder(read, chosen, AT, accesses).systems()
    return read, overview(read, chosen, AT, accesses, None, systems)


@cache
def sample(name: str) -> tuple[Keystore, Overview]:
    return overview_of(SAMPLES / name)


def drawn(seen: Overview) -> tuple[Drawn, Drawn]:
    """Every hop as its sender's picture shows it, and as its receiver's does."""
    sent = {
        (flow.path, name, peer, hop.by_right)
        for flow in seen.neighbourhoods
        for hop in flow.outgoing
        for name in hop.names
        for peer in hop.peers
    }
    received = {
        (peer, name, flow.path, hop.by_right)
        for flow in seen.neighbourhoods
        for hop in flow.incoming
        for name in hop.names
        for peer in hop.peers
    }
    return sent, received


class TestNeighbours:
    @pytest.mark.parametrize("name", LOOKED_AT)
    def test_both_ends_of_a_hop_show_it(self, name: str) -> None:
        sent, received = drawn(sample(name)[1])
        assert sent
        enclaves = {flow.path for flow in sample(name)[1].neighbourhoods}
        assert {hop for hop in sent if hop[2] in enclaves} == {hop for hop in received if hop[0] in enclaves}

    @pytest.mark.parametrize("name", LOOKED_AT)
    def test_a_hop_is_drawn_where_a_search_finds_it_and_nowhere_else(self, name: str) -> None:
        """The search of `keystore-audit flow`, asked for each pair and each name: is there a flow of one hop?"""
        read, seen = sample(name)
        assert seen.access is not None
        accesses = AccessViews(documents_of(read), AT, None)
        profile = VARIANTS[seen.access.groups[-1].profiles[0]]
        points = [(named.topic, named.partition) for named in seen.access.names]
        builder = SystemBuilder(read, [profile], AT, accesses, points)
        system = builder.systems()[0]
        flows = Flows(system, trust_domain_views(system))
        labels = [*(enclave.label for enclave in system.enclaves), None]
        places = [*(Place(enclaves=frozenset({n})) for n in range(len(system.enclaves))), Place(outsider=True)]
        everything = frozenset(range(len(system.channels)))
        found: Drawn = set()
        for number in set(range(len(points))) - set(members(seen.ambient)):
            channel = builder.channels.of_point(seen.access.domain, number)
            for sender, source in zip(labels, places, strict=True):
                for receiver, target in zip(labels, places, strict=True):
                    if sender == receiver:
                        continue
                    direct = {}
                    for attacker in (Attacker.HONEST, Attacker.RELAYS):
                        search = Search(
                            attacker=attacker, source=source, target=target, left_out=everything - {channel}
                        )
                        legs = flows.shortest(search)
                        direct[attacker] = legs is not None and len(legs) == 1
                    if any(direct.values()):
                        found.add((sender, number, receiver, direct[Attacker.HONEST]))
        sent, received = drawn(seen)
        assert sent | received == found

    @pytest.mark.slow
    def test_too_many_ways_to_trust_are_not_drawn_and_that_is_said(self, tmp_path: Path) -> None:
        count = int(MAX_VIEWS**0.5) + 1  # each with a governance that says something else
        written = permissions(grant("/e", allow(pub("rt/t"))))
        rules = (domain_rule(topic_rule(f"rt/e{number}", data="NONE"), topic_rule()) for number in range(count))
        each = (Member(permissions=written, governance=governance(rule)) for rule in rules)
        root = Store(members={f"/e{number}": member for number, member in enumerate(each)}).write(tmp_path)
        seen = overview_of(root, ("spec",))[1]
        assert seen.neighbourhoods == ()
        assert seen.undrawn.startswith(f"{count} trust domains are too many")
        assert seen.access is not None


class TestAllowances:
    @pytest.mark.parametrize("name", LOOKED_AT)
    def test_they_cover_the_table_and_no_more(self, name: str) -> None:
        _read, seen = sample(name)
        assert seen.access is not None
        for path, enclave in seen.access.groups[-1].enclaves.items():
            if not enclave.usable.must:
                continue
            for operation, right in enclave.rights.items():
                allowed = 0
                for allowance in seen.allowances[path]:
                    if allowance.operation is operation:
                        assert not allowed & allowance.names, "each name is allowed by one line"
                        allowed |= allowance.names
                assert allowed == right.allowed

    @pytest.mark.parametrize(("written", "by_pattern"), [("rt/a*", True), ("rt/ab", False)])
    def test_a_name_that_no_rule_writes_out_is_told(self, written: str, *, by_pattern: bool, tmp_path: Path) -> None:
        """The other enclave names it, so that it stands in the table."""
        rules = {"/a": (rule((written,)),), "/b": (rule((), ("rt/ab",)),)}
        _read, seen = overview_of(keystore(tmp_path / "k", rules), ("spec",))
        assert seen.access is not None
        (number,) = (n for n, named in enumerate(seen.access.names) if named.topic == "rt/ab")
        assert {bool(each.by_pattern >> number & 1) for each in seen.allowances["/a"]} == {by_pattern}

    @pytest.mark.parametrize("name", ["flows/vehicle_governance_flag", "stock/talker_listener"])
    def test_the_line_is_that_of_can(self, name: str) -> None:
        read, seen = sample(name)
        assert seen.access is not None
        profile = VARIANTS[seen.access.groups[-1].profiles[0]]
        questions = {
            (path, operation, number): Question(
                enclave=path,
                operation=operation,
                topic=named.topic,
                partitions=(named.partition,),
                domain=seen.access.domain,
            )
            for path in seen.access.groups[-1].enclaves
            for operation in Operation
            for number, named in enumerate(seen.access.names)
        }
        access = Access(read.root, list(questions.values()), Circumstances(profiles=[profile], at=AT))
        starts = {
            (enclave.permissions.signed.file.place, rule.line or 0)
            for enclave in read.enclaves
            if enclave.permissions is not None
            for grant in enclave.grants
            for rule in grant.rules
        }

        def of_rule(location: Location | None, reason: str) -> tuple[str, int, str]:
            """What is said, at the rule in which the line stands: `can` names the expression, of one name."""
            assert location is not None
            path, line = location.path, location.line or 0
            return (
                path,
                max([at for place, at in starts if place == path and at <= line], default=line),
                re.sub(r"^line \d+( \(.*?\))? is ", "", reason),
            )

        told = 0
        for (path, operation, number), question in questions.items():
            answer = access.answers(question)[profile.name]
            lines = [
                of_rule(allowance.location, allowance.reason)
                for allowance in seen.allowances[path]
                if allowance.operation is operation and allowance.names >> number & 1
            ]
            allowed = answer.decision is Truth.YES
            assert lines == ([of_rule(answer.location, answer.reason)] if allowed else [])
            told += len(lines)
        assert told > 20
