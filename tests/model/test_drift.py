"""Drift: every difference in meaning is found, in the right direction, and no other; compared name by name."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from keystore_audit.findings import Location
from keystore_audit.intent.intent import Action, IntendedRight
from keystore_audit.intent.policy import Policy, Profiles, read_policy
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.files import Status
from keystore_audit.keystore.layout import Role
from tests.amount import tried
from tests.model.drifting import Listed, allowed, compared, listed_in, matches, only, policy_of, sole, store
from tests.rules.divergent import ruled
from tests.rules.evidence import (
    absent,
    allow,
    defect,
    domain_rule,
    enclave,
    governance,
    grant,
    keystore,
    permissions,
    text,
)

ROOT = Path(__file__).resolve().parents[2]
OWN = ROOT / "sample_keystores/policies"
SHARED = ROOT.parent / "shared/reference/policies"
MADE_BY_SROS2 = {
    **{
        name: (
            SHARED / f"sros2-rolling/{name}.policy.xml",
            SHARED / f"sros2-rolling/permissions/{name}/permissions.xml",
        )
        for name in ("sample", "single_context", "minimal_action", "talker_listener", "add_two_ints")
    },
    "dashing": (SHARED / "sros2-dashing/sample_policy.xml", SHARED / "sros2-dashing/permissions.xml"),
}
DISCOVERY = Listed(True, ("ros_discovery_info",), ("ros_discovery_info",))


def pairs() -> Iterator[object]:
    """Policies and what sros2 makes of them: its own examples, where they are, and ours."""
    for name, (policy, document) in MADE_BY_SROS2.items():
        there = pytest.mark.skipif(not document.exists(), reason="the reference policies are not there")
        yield pytest.param(policy, [document], id=name, marks=there)
    for name in ("talker_listener", "turtlesim", "vehicle"):
        documents = sorted((ROOT / "sample_keystores/healthy" / name / "enclaves").rglob("permissions.xml"))
        assert documents
        yield pytest.param(OWN / f"{name}.policy.xml", documents, id=f"our {name}")


PAIRS = list(pairs())


def rules_of(documents: Sequence[Path]) -> dict[str, list[Listed]]:
    return {path: rules for document in documents for path, rules in listed_in(document).items()}


@pytest.mark.parametrize(("file", "documents"), PAIRS)
def test_what_sros2_makes_of_a_policy_has_no_drift(file: Path, documents: list[Path]) -> None:
    found = compared(read_policy(file), store(dict(rules_of(documents))), "spec", "fastdds-3.6", "cyclonedds-0.10")
    assert (found.enclaves, found.undecided, found.missing, found.unnamed, found.lost) == ((), (), (), (), ())


@pytest.mark.parametrize(("file", "documents"), PAIRS)
def test_each_topic_more_or_less_is_found(file: Path, documents: list[Path]) -> None:
    policy, rules = read_policy(file), rules_of(documents)
    for path, (first, *others) in rules.items():
        for operation in ("publish", "subscribe"):
            topics = first.topics(operation)
            for topic in [*dict.fromkeys(topics)][: tried(len(topics), 3)]:
                fewer = first._replace(**{operation: tuple(each for each in topics if each != topic)})
                assert differs(policy, path, [fewer, *others]) == ({(operation, topic)}, set())
            more = first._replace(**{operation: (*topics, "rt/added/by_hand")})
            assert differs(policy, path, [more, *others]) == (set(), {(operation, "rt/added/by_hand")})
        lost = {("publish", topic) for topic in first.publish} | {("subscribe", topic) for topic in first.subscribe}
        assert differs(policy, path, others or [DISCOVERY]) == (lost, set())


def differs(policy: Policy, path: str, changed: Sequence[Listed]) -> tuple[set[tuple[str, str]], set[tuple[str, str]]]:
    """What drifts where one enclave is granted these rules; that the others are not there is no drift of this one."""
    return sole(compared(policy, store({path: changed}), "spec"))


def test_a_denial_behind_what_it_takes_from_is_found_whether_or_not_the_rules_are_the_policys(tmp_path: Path) -> None:
    but_secrets = (
        '<topics publish="DENY"><topic>secret</topic></topics><topics publish="ALLOW"><topic>*</topic></topics>'
    )
    policy = policy_of(tmp_path, f'<profiles><profile ns="/" node="talker">{but_secrets}</profile></profiles>')
    denied, wide = Listed(False, ("rt/secret",), ()), Listed(True, ("rt/*",), ())
    assert differs(policy, "/talker", [denied, wide]) == (set(), set())
    assert differs(policy, "/talker", [wide, denied]) == (set(), {("publish", "rt/secret")})


# Against every name

EXPRESSIONS = ("rt/a", "rt/b", "rt/aa", "rt/a*", "rt/*", "rt/?", "*a", "rq/sRequest", "rr/sReply", "rq/*", "a")
NAMES = (
    *("rt/a", "rt/b", "rt/c", "rt/aa", "rt/ab", "rt/ba", "rt/bb", "rt/aaa", "rt/baa", "rt/", "a", "ba", "b"),
    *("rq/sRequest", "rq/tRequest", "rq/a", "rr/sReply", "rr/tReply"),
)
texts = st.lists(st.sampled_from(EXPRESSIONS), max_size=3).map(tuple)
some_rules = st.lists(st.builds(Listed, st.booleans(), texts, texts), max_size=4)
some_rights = st.lists(
    st.tuples(
        st.sampled_from(("publish", "subscribe", "request", "reply")), st.sampled_from(EXPRESSIONS[:6]), st.booleans()
    ),
    max_size=5,
)


def as_sros2(rights: Sequence[tuple[str, str, bool]]) -> list[Listed]:
    """The rules of a policy with these rights, on names as in EXPRESSIONS but without `rt`."""
    found = []
    for allows in (False, True):
        publish: list[str] = []
        subscribe: list[str] = []
        for action, expression, qualifier in rights:
            name = expression[2:]
            if qualifier is not allows:
                continue
            if action in ("publish", "subscribe"):
                (publish if action == "publish" else subscribe).append(f"rt{name}")
            else:
                asks, answers = (publish, subscribe) if action == "request" else (subscribe, publish)
                asks.append(f"rq{name}Request")
                answers.append(f"rr{name}Reply")
        found.append(Listed(allows, tuple(publish), tuple(subscribe)))
    return found


def as_policy(rights: Sequence[tuple[str, str, bool]]) -> Policy:
    where = Location(path="a.policy.xml", line=3, beside=True)
    meant = tuple(
        IntendedRight(
            enclave="/talker", node="/talker", action=Action(action), name=name[2:], allow=allows, location=where
        )
        for action, name, allows in rights
    )
    profiles = Profiles(enclave="/talker", location=where, nodes=(), rights=meant, lost="")
    return Policy(path="a.policy.xml", version="0.2.0", files=(), profiles=(profiles,))


@settings(max_examples=tried(150), deadline=None, derandomize=True)
@given(rights=some_rights, rules=some_rules)
def test_all_and_only_what_differs_by_name_is_found(rights: list[tuple[str, str, bool]], rules: list[Listed]) -> None:
    meant = as_sros2(rights)
    held = [rule for rule in rules if rule.publish or rule.subscribe]
    profiles = ("spec", "fastdds-3.6", "cyclonedds-11")
    found = compared(as_policy(rights), store({"/talker": held}), *profiles)
    drifted = (right for each in found.enclaves for right in each.lacking.rights + each.exceeding.rights)
    assert all(right.profiles == profiles for right in drifted)
    every = [text for rule in (*meant, *held) for text in (*rule.publish, *rule.subscribe)]
    lacking, exceeding = sole(found)
    names = {*NAMES, *(topic for _operation, topic in lacking | exceeding)}
    ours, theirs = allowed(meant, names), allowed(held, names)

    def alike(right: tuple[str, str]) -> tuple[object, ...]:
        return right[0], tuple(matches(text, right[1]) for text in every)

    assert lacking <= ours - theirs
    assert exceeding <= theirs - ours
    assert {alike(right) for right in ours - theirs} == {alike(right) for right in lacking}
    assert {alike(right) for right in theirs - ours} == {alike(right) for right in exceeding}


PARTITIONS = (None, ("",), ("lab",), ("l*", ""), ("*",))
listings = st.lists(
    st.tuples(
        st.booleans(),
        st.sampled_from(("publish", "subscribe")),
        st.lists(st.sampled_from(EXPRESSIONS[:5]), min_size=1, max_size=2).map(tuple),
        st.sampled_from(PARTITIONS),
    ),
    max_size=4,
)


def decides(
    listed: tuple[bool, str, tuple[str, ...], tuple[str, ...] | None], operation: str, topic: str, partition: str
) -> bool:
    """DDS-Security 1.1, 9.4.1.3.2.3: without partitions an allow rule is for the default one, a deny rule for all."""
    allows, about, texts, partitions = listed
    if about != operation or not any(matches(text, topic) for text in texts):
        return False
    if partitions is None:
        return not allows or partition == ""
    return any(matches(text, partition) for text in partitions)


@settings(max_examples=tried(100), deadline=None, derandomize=True)
@given(rights=some_rights, rules=listings)
def test_partitions_too_by_name(
    rights: list[tuple[str, str, bool]],
    rules: list[tuple[bool, str, tuple[str, ...], tuple[str, ...] | None]],
) -> None:
    own = [ruled(allows=allows, **{about: [(texts, partitions)]}) for allows, about, texts, partitions in rules]
    place = "enclaves/talker/permissions.p7s"
    held = keystore(enclave("/talker", permissions=permissions(place, grant("/talker", *(own or [allow()])))))
    found = compared(as_policy(rights), held, "spec")
    meant = as_sros2(rights)

    def difference(operation: str, topic: str, partition: str) -> int:
        wanted = not partition and (operation, topic) in allowed(meant, [topic])
        first = next((rule for rule in rules if decides(rule, operation, topic, partition)), None)
        return (first is not None and first[0]) - wanted

    told = {
        (right.operation.value, right.topic, right.partition): sign
        for each in found.enclaves
        for sign, drifted in ((-1, each.lacking), (1, each.exceeding))
        for right in drifted.rights
    }
    assert {right: difference(*right) for right in told} == told

    def alike(operation: str, topic: str, partition: str) -> tuple[object, ...]:
        """Whatever tells names apart: the rules of both sides."""
        ours = (not partition and matches(text, topic) for rule in meant for text in rule.topics(operation))
        return operation, *(decides(rule, operation, topic, partition) for rule in rules), *ours

    topics, partitions = ({right[part] for right in told} for part in (1, 2))
    every = itertools.product(("publish", "subscribe"), {*NAMES, *topics}, {"", "lab", "l", "x", *partitions})
    assert {alike(*right) for right in told} == {alike(*right) for right in every if difference(*right)}


# What makes a difference beside names


CHATTER = (
    '<profiles><profile ns="/" node="talker"><topics publish="ALLOW">'
    "<topic>chatter</topic></topics></profile></profiles>"
)


def test_domains_that_governance_and_grant_have_in_common(tmp_path: Path) -> None:
    rules = [allow(["rt/chatter"], domains=[(0, 0), (7, 7)]), allow(["rt/map"], domains=[(7, 7)])]
    own = permissions("enclaves/talker/permissions.p7s", grant("/talker", *rules))
    policy = policy_of(tmp_path, CHATTER)
    assert compared(policy, keystore(enclave("/talker", permissions=own))).enclaves == ()
    both = governance(domain_rule(domains=[(0, 9)]))
    each = only(compared(policy, keystore(enclave("/talker", permissions=own, governance=both))))
    assert [(right.topic, right.domain) for right in each.exceeding.rights] == [("rt/map", 7)]
    lacks = only(compared(policy, keystore(enclave("/talker", permissions=own)), domain=3))
    assert [(right.topic, right.domain) for right in lacks.lacking.rights] == [("rt/chatter", 3)]
    assert compared(policy, keystore(enclave("/talker", permissions=own)), domain=0).enclaves == ()


def test_what_another_document_concedes(tmp_path: Path) -> None:
    """A peer takes the listener's permissions from the talker, if they hold a grant for it."""
    shared = permissions(
        "enclaves/listener/permissions.p7s", grant("/listener"), grant("/talker", allow(["rt/map", "rt/chatter"]))
    )
    own = permissions("enclaves/talker/permissions.p7s", grant("/talker", allow(["rt/chatter"])))
    held = keystore(enclave("/talker", permissions=own), enclave("/listener", permissions=shared))
    each = only(compared(policy_of(tmp_path, CHATTER), held))
    assert (each.enclave, each.document, each.own) == ("/talker", "enclaves/listener/permissions.p7s", False)
    assert ([right.topic for right in each.exceeding.rights], each.lacking.rights) == (["rt/map"], ())
    over = grant("/talker", allow(["rt/map"]), not_after=text("2021-01-01T00:00:00", 41))
    late = permissions("enclaves/listener/permissions.p7s", grant("/listener"), over)
    held = keystore(enclave("/talker", permissions=own), enclave("/listener", permissions=late))
    assert compared(policy_of(tmp_path, CHATTER), held).enclaves == ()


def test_which_grant_is_compared(tmp_path: Path) -> None:
    """The one that counts; one out of date where there is no other; none where none names the enclave."""
    policy = policy_of(tmp_path, CHATTER)
    past = {"not_after": text("2021-01-01T00:00:00", 41)}
    assert compared(policy, store({"/talker": [Listed(True, ("rt/chatter",), ())]}, **past)).enclaves == ()
    old = grant("/talker", allow(["rt/map"]), **past)
    own = permissions("enclaves/talker/permissions.p7s", old, grant("/talker", allow(["rt/chatter"])))
    assert compared(policy, keystore(enclave("/talker", permissions=own)), "fastdds-3.6").enclaves == ()
    assert compared(policy, keystore(enclave("/talker", permissions=own)), "cyclonedds-11").enclaves != ()
    others = permissions("enclaves/talker/permissions.p7s", grant("/listener", allow(["rt/chatter"])))
    each = only(compared(policy, keystore(enclave("/talker", permissions=others))))
    assert (each.granted, [right.topic for right in each.lacking.rights]) == (False, ["rt/chatter"])
    bare = only(compared(policy, keystore(enclave("/talker", permissions=None), enclave("/other"))))
    assert (bare.granted, [right.topic for right in bare.lacking.rights]) == (None, ["rt/chatter"])


def test_what_cannot_be_read_is_undecided(tmp_path: Path) -> None:
    place = "enclaves/talker/permissions.p7s"
    ambiguous = permissions(place, defects=(defect(Kind.XML_AMBIGUOUS, place),))
    unread = {Role.PERMISSIONS: absent(place, Status.OUTSIDE, "leads out of the keystore")}
    for held in (enclave("/talker", permissions=ambiguous), enclave("/talker", permissions=None, files=unread)):
        found = compared(policy_of(tmp_path, CHATTER), keystore(held, enclave("/listener")))
        assert (found.enclaves, [doubt.enclave for doubt in found.undecided]) == ((), ["/talker"])


def test_of_several_reasons_that_of_the_first_profile_is_told(tmp_path: Path) -> None:
    """Whatever order a set of implementations has."""
    policy = policy_of(tmp_path, CHATTER)
    held = store({"/talker": [Listed(True, ("rt/[[=a][b",), ())]})
    for profiles, said in ((("spec", "opendds"), "[= in brackets"), (("opendds", "spec"), "OpenDDS reads on")):
        (doubt,) = compared(policy, held, *profiles).undecided
        assert said in doubt.reason


def test_an_expression_that_means_nothing_is_undecided(tmp_path: Path) -> None:
    policy = policy_of(tmp_path, CHATTER.replace(">chatter<", ">arm_[!<"))
    held = store({"/talker": [Listed(True, ("rt/chatter",), ())]})
    assert compared(policy, held, "spec").undecided == ()
    (doubt,) = compared(policy, held, "spec", "opendds").undecided
    assert doubt.location.path.endswith("a.policy.xml")
