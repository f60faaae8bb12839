"""Random keystores with odd documents: no profile is answered with another's reading, no name with another's class."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime, timedelta, timezone
from functools import lru_cache
from itertools import product
from pathlib import Path
from random import Random
from zoneinfo import ZoneInfo

from hypothesis import given, settings
from hypothesis import strategies as st

from keystore_audit.access import Access as Answers
from keystore_audit.circumstances import Circumstances
from keystore_audit.keystore.keystore import Keystore, read_keystore
from keystore_audit.keystore.typed import Operation, Rule
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.channels import Channels, Point
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.domains import contains
from keystore_audit.model.formal.rights import EffectiveRights
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.matching.expression import parse
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.question import Question
from keystore_audit.model.semantics import read_rules
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.profiles import VARIANTS, Access, Profile
from keystore_audit.truth import Truth
from tests.keystore import documents as d
from tests.keystore.builder import Signed, authority, certificate, write_enclave
from tests.keystore.chance import Rules
from tests.oracles.vendors import recipe as r

AT = datetime(2030, 6, 1, 12, tzinfo=timezone.utc)
ENCLAVES = ("a", "b", "c")
DOMAINS = (0, 1, 2, 3, 5, 230, 231, 232)
PROFILES = tuple(VARIANTS.values())

_PLAIN_EXPRESSIONS = ("*", "rt/*", "rt/a", "rt/b", "rt/[ab]", "r?/a")
_ODD_EXPRESSIONS = (
    *(
        "rt/[!a]",
        "rt/[^a]",
        "rt/\\a",
        "rt/\\*",
        "rt/[a",
        "rt/[]a]",
        "rt/[[:alpha:]]",
        "??/a",
        "*a*",
        "rt/é",
        "rt/[b-a]",
    ),
    *("[*]", "rt/[\\]]", "rt/a*b*", "rt/**", "rt/[!", "[[=a=]]", "rt/[a-]", "rt//a"),
)
_TOPICS = (
    "rt/a",
    "rt/b",
    "rt/c",
    "rt/ab",
    "rt/*",
    "*",
    "rt/\\a",
    "rt/axb",
    "rr/zz",
    "x",
    "rt/[a",
    "rt/]",
    "rt//a",
    "rt/-",
)
_PARTITION_EXPRESSIONS = ("", "p", "q", "*", "?", "[pq]", "p*", "[!p]", "\\p", "[p")
_PARTITIONS = ("", "p", "q", "pq", "*", "z", "\\p", "[p")
_PLAIN_IDS: tuple[d.Domain, ...] = (0, 0, 1, 2, (0, 1), (1, 5), (0, 230))
_ODD_IDS: tuple[d.Domain, ...] = (
    *(229, 230, 231, 232, (0, 0), (1, None), (0, None), (None, 3), (None, 0), (3, 3)),
    *((229, 231), (0, 232), (230, None), (None, 230), (None, 231)),
)
_ODD_DATES = ("1969-12-31T23:59:59", "2263-01-01T00:00:00", "0001-01-01T00:00:00", "9999-12-31T23:59:59")
_ZONES = ("", "Z", "+00:00", "-00:00", "+02:00", "-11:30", "+13:00", ".5", "+14:00")
_DISTANCES = (0, 1, 2, 3600, 11 * 3600, 13 * 3600, 15 * 3600, 86_400 * 3, 86_400 * 400)


class _Unmerged(AccessViews):
    """Every profile with all of its own row, whatever the documents hold."""

    def row(self, access: Access) -> Access:
        return access


class _Documents:
    """Random governance and permissions; `odd`: how often something rare is in them."""

    def __init__(self, random: Random) -> None:
        self._random = random
        self._odd = random.choice((0, 0, 0.05, 0.15, 0.4))
        counts = (None, None, 1, 1, 2) if random.random() < 0.5 else (None,)
        self._rules = Rules(
            expressions=lambda _random: _ODD_EXPRESSIONS if self._is_odd() else _PLAIN_EXPRESSIONS,
            partitions=_PARTITION_EXPRESSIONS,
            count=counts,
            domains=lambda _random: _ODD_IDS if self._is_odd() else _PLAIN_IDS,
            relays=(0, 0, 1) if random.random() < 0.4 else (0,),
            allows=random.choice((1, 0.85, 0.6)),
        )
        self._allows_by_default = random.choice((0, 0, 0.3))

    def governance(self) -> str:
        return d.governance(*(self._domain_rule() for _ in range(self._random.choice((1, 1, 2, 3)))))

    def permissions(self, enclave: str) -> str:
        return d.permissions(*(self._grant(enclave) for _ in range(self._random.choice((1, 1, 2, 3)))))

    def _is_odd(self) -> bool:
        return self._random.random() < self._odd

    def _flag(self, often: float) -> bool:
        return self._random.random() < often

    def _domain_rule(self) -> str:
        some = [
            self._topic_rule(self._random.choice(self._rules.expressions(self._random)))
            for _ in range(self._random.choice((1, 1, 2)))
        ]
        rtps = self._random.choice(("SIGN", "NONE", "ENCRYPT"))
        every = [self._topic_rule("*")] if self._flag(0.6) else []
        return d.domain_rule(
            *some,
            *every,
            domains=self._rules.where(self._random),
            join=self._flag(0.6),
            unauthenticated=self._flag(0.15),
            rtps=rtps,
        )

    def _topic_rule(self, expression: str) -> str:
        metadata, data = self._random.choice(("ENCRYPT", "SIGN", "NONE")), self._random.choice(("ENCRYPT", "NONE"))
        return d.topic_rule(expression, read=self._flag(0.7), write=self._flag(0.7), metadata=metadata, data=data)

    def _grant(self, enclave: str) -> str:
        return r.grant(
            *(self._rules.rule(self._random) for _ in range(self._random.choice((1, 1, 2, 3, 4)))),
            subject=f"CN=/{self._random.choice(ENCLAVES) if self._flag(0.4) else enclave}",
            start=self._date("2025-01-01T00:00:00"),
            end=self._date("2036-01-01T00:00:00"),
            default="ALLOW" if self._flag(self._allows_by_default) else "DENY",
        )

    def _date(self, plain: str) -> str:
        if not self._is_odd():
            return plain
        near = AT + timedelta(seconds=self._random.choice(_DISTANCES)) * self._random.choice((1, -1))
        text = self._random.choice(_ODD_DATES) if self._flag(0.15) else near.strftime("%Y-%m-%dT%H:%M:%S")
        return text + self._random.choice(_ZONES)


@lru_cache
def _authority(name: str) -> Signed:
    return authority(name)


@lru_cache
def _identity(enclave: str) -> Signed:
    return certificate(f"/{enclave}", _authority("identity CA"))


def _write(directory: Path, enclave: str, permissions_ca: Signed, governance: str, permissions: str) -> None:
    identity_ca, document = _authority("identity CA"), permissions.encode()
    write_enclave(directory, _identity(enclave), document, identity_ca, permissions_ca, governance.encode())


@contextmanager
def _keystore(random: Random) -> Iterator[Keystore]:
    documents = _Documents(random)
    permissions_ca = _authority(random.choice(("identity CA", "permissions CA")))
    shared = documents.governance()
    with tempfile.TemporaryDirectory() as folder:
        for enclave in ENCLAVES[: random.choice((1, 2, 3))]:
            governance = shared if random.random() < 0.6 else documents.governance()
            directory = Path(folder) / "enclaves" / enclave
            _write(directory, enclave, permissions_ca, governance, documents.permissions(enclave))
        yield read_keystore(folder)


class _Answers:
    """What is said of one keystore, by views of a kind. `points` None: in classes; they never meet if `literal`."""

    def __init__(
        self, keystore: Keystore, accesses: AccessViews, points: Sequence[Point] | None, *, literal: bool = False
    ) -> None:
        self._accesses = accesses
        self._keystore = keystore
        builder = SystemBuilder(keystore, PROFILES, AT, accesses, points, literal=literal or points is not None)
        self.channels = builder.channels
        self.systems = builder.systems()
        self._local = LocalRights(accesses, builder.channels, AT)
        self._effective = EffectiveRights(self.systems)

    def rights(self, channels: Mapping[object, int]) -> dict[object, dict[object, object]]:
        """By what names the channel, and by profile, enclave and operation: decision, may and must be accepted."""
        found: dict[object, dict[object, object]] = {name: {} for name in channels}
        for profile, enclave, operation in product(PROFILES, self._keystore.enclaves, Operation):
            asked = (profile.name, enclave.path, operation.value)
            allowed = self._local.allowed(enclave, profile, operation)
            accepted = self._effective.accepted(enclave.path, profile.name, operation)
            may, must = accepted.may, accepted.must
            for name, channel in channels.items():
                found[name][asked] = (allowed >> channel & 1, may >> channel & 1, must >> channel & 1)
        return found

    def usability(self) -> dict[object, object]:
        found: dict[object, object] = {}
        for domain in (None, *DOMAINS):
            usabilities = Usabilities(domain, self._accesses)
            for profile in PROFILES:
                for enclave in self._keystore.enclaves:
                    found[profile.name, enclave.path, domain] = usabilities.of(enclave, AT, profile)
        return found


def _views(kind: type[AccessViews], keystore: Keystore, zone: ZoneInfo | None) -> AccessViews:
    return kind(documents_of(keystore), AT, zone)


def _of_points(channels: Channels, points: Sequence[Point]) -> dict[object, int]:
    return {
        (domain, point): channels.of_point(domain, number) for domain in DOMAINS for number, point in enumerate(points)
    }


_SEEDS = st.integers(0, 2**32)
_ZONE = st.sampled_from((None, ZoneInfo("UTC"), ZoneInfo("America/New_York"), ZoneInfo("Asia/Tokyo")))


@settings(max_examples=50)
@given(_SEEDS, _ZONE)
def test_profiles_share_a_reading_only_where_theirs_is_equal(seed: int, zone: ZoneInfo | None) -> None:
    random = Random(seed)
    with _keystore(random) as keystore:
        points = [(topic, partition) for topic in random.sample(_TOPICS, 6) for partition in _PARTITIONS]
        merged = _Answers(keystore, _views(AccessViews, keystore, zone), points)
        apart = _Answers(keystore, _views(_Unmerged, keystore, zone), points)
        assert merged.usability() == apart.usability()
        assert merged.rights(_of_points(merged.channels, points)) == apart.rights(_of_points(apart.channels, points))


@settings(max_examples=50)
@given(_SEEDS, _ZONE)
def test_a_class_decides_as_each_of_its_names(seed: int, zone: ZoneInfo | None) -> None:
    """Names that an implementation refuses or takes for expressions are not asked: those are points alone.

    A partition is a plain name here, so what classes meet is left out. It tells classes apart all the same: of several
    that the same regions hold, one has to decide as the name does.
    """
    random = Random(seed)
    plain = [topic for topic in _TOPICS if topic.replace("/", "").isalnum()]
    points = [(topic, partition) for topic in plain for partition in random.sample(_PARTITIONS, 4)]
    with _keystore(random) as keystore:
        classes = _Answers(keystore, _views(AccessViews, keystore, zone), None, literal=True)
        single = _Answers(keystore, _views(AccessViews, keystore, zone), points)
        asked = list(product(DOMAINS, points))
        names = single.rights(_of_points(single.channels, points))
        found = {where: _classes_of(classes.channels, *where) for where in asked}
        decided = classes.rights({(where, n): n for where in asked for n in found[where]})
        for where in asked:
            assert not found[where] or names[where] in [decided[where, n] for n in found[where]], where


def _classes_of(channels: Channels, domain: int, point: Point) -> list[int]:
    """The classes by their definition: which regions hold the name; none in an ungoverned domain, of one channel."""
    topic, partition = point
    hits = {
        (matcher, region)
        for matcher, region in channels.regions
        if any(
            any(parse(text, matcher).matches(topic) for text in area.topics)
            and (area.partitions is None or any(parse(text, matcher).matches(partition) for text in area.partitions))
            for area in region
        )
    }
    number = next(n for n, atom in enumerate(channels.domains) if contains(atom.intervals, domain))
    inside = [n for n, channel in enumerate(channels.channels) if channel.domain == number]
    if len(inside) == 1:
        return []
    found = [n for n in inside if {named for named, held in channels.regions.items() if n in held} == hits]
    assert len(found) == 1 or (found and channels.meets), "classes are disjoint and leave out no name"
    return found


@settings(max_examples=50)
@given(_SEEDS)
def test_an_allow_rule_blocks_where_a_later_one_allows_in_other_partitions(seed: int) -> None:
    """Against the definition, by their number: it is worked out in one pass (10,000 rules took minutes)."""
    profile: Profile = VARIANTS["fastdds-3.6"]
    with _keystore(Random(seed)) as keystore:
        for enclave in keystore.enclaves:
            permissions = enclave.permissions.permissions if enclave.permissions else None
            for grant in permissions.grants if permissions else ():
                read = read_rules(grant, profile.access)
                for operation in (Operation.PUBLISH, Operation.SUBSCRIBE):
                    denying = [each for each in read if not (each.allow or each.of_peers) and each.region(operation)]
                    listing = [(place, rule) for place, rule in enumerate(grant.rules) if _lists(rule, operation)]
                    blocking = [
                        rule
                        for place, rule in listing
                        if rule.allow
                        if any(_admits(later, operation) - _own(rule, operation) for later in grant.rules[place + 1 :])
                    ]
                    assert len(denying) == len(blocking) + sum(not rule.allow for _place, rule in listing)


def _lists(rule: Rule, operation: Operation) -> bool:
    return any(criterion.operation is operation for criterion in rule.criteria)


def _own(rule: Rule, operation: Operation) -> set[str]:
    return {
        text
        for criterion in rule.criteria
        if criterion.operation is operation
        for text in ([""] if criterion.partitions is None else [each.text for each in criterion.partitions])
    }


def _admits(rule: Rule, operation: Operation) -> set[str]:
    """Where a later rule may allow: a <relay> lets readers in as a <subscribe> does."""
    if not rule.allow:
        return set()
    relayed = _own(rule, Operation.RELAY) if operation is Operation.SUBSCRIBE else set()
    return _own(rule, operation) | relayed


def test_a_range_without_an_end_is_audited(tmp_path: Path) -> None:
    domains = d.ids((0, None))
    permissions = d.permissions(r.grant(d.allow(d.pub("rt/a"), domains=domains), subject="CN=/a"))
    ca = _authority("permissions CA")
    _write(tmp_path / "enclaves/a", "a", ca, d.governance(d.domain_rule(domains=domains)), permissions)
    report = audit(tmp_path, Options(at=r.NOW, engine="native"))
    assert not [finding for finding in report.findings if finding.code.startswith("KA9")]
    assert "KA515" in {finding.code for finding in report.findings}


def test_a_range_without_a_beginning_is_unknown_where_it_may_be_passed_over(tmp_path: Path) -> None:
    """Cyclone DDS 0.10.2 crashes where it comes to one, and starts where an id before it matches (measured)."""
    permissions = d.permissions(r.grant(d.allow(d.pub("rt/b"), domains=d.ids(0, (None, 3))), subject="CN=/a"))
    _write(tmp_path / "enclaves/a", "a", _authority("permissions CA"), d.governance(), permissions)
    question = Question(enclave="/a", operation=Operation.PUBLISH, topic="rt/b", domain=0)
    answers = Answers(tmp_path, [question], Circumstances(profiles=PROFILES, at=r.NOW)).answers(question)
    for name, answer in answers.items():
        expected = (Truth.UNKNOWN,) * 2 if name.startswith("cyclonedds") else (Truth.YES,) * 2
        if name != "opendds":  # refuses the stock governance
            assert (answer.usable, answer.decision) == expected, name
        assert answer.effective is not Truth.NO, name
