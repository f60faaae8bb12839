"""Which identities keystores share, held against comparing each with each."""

from __future__ import annotations

from datetime import datetime, timezone

from hypothesis import given
from hypothesis import strategies as st

from keystore_audit.fleet.shared import Identities
from keystore_audit.keystore.identity import Identity, alike

AT = datetime(2026, 11, 21, tzinfo=timezone.utc)

identities = st.builds(
    lambda root, key, subject, authorities: Identity(
        root=root,
        enclave="/e",
        path="cert.pem",
        line=1,
        key=key,
        subject=subject,
        subject_alike=alike(subject),
        issuer="CN=ca",
        not_before=AT,
        not_after=AT,
        authorities=frozenset(authorities),
    ),
    root=st.just("r"),
    key=st.sampled_from("abcdef"),
    subject=st.sampled_from(["CN=/talker", "CN=/listener", "CN=/x"]),
    authorities=st.sets(st.sampled_from("ABC"), max_size=2),
)
fleets = st.lists(st.tuples(st.sampled_from(["/1", "/2", "/3", "/4"]), st.lists(identities, max_size=3)), max_size=6)


def have_in_common(one: Identity, other: Identity) -> bool:
    return one.key == other.key or (one.subject == other.subject and bool(one.authorities & other.authorities))


def test_what_lies_in_a_keystore_is_known_by_its_place_in_it() -> None:
    known = Identities()
    for number, place in enumerate(["/k", "/k/a b", "/k/a b/c", "/k2", "/k"]):
        known.add(number, place, ())
    assert [sorted(known.within(number)) for number in range(5)] == [
        ["a b", "a b/c"],
        ["c"],
        [],
        [],
        ["a b", "a b/c"],
    ]


@given(fleets)
def test_those_and_only_those_that_are_alike_are_given(fleet: list[tuple[str, list[Identity]]]) -> None:
    known = Identities()
    for number, (place, own) in reversed(list(enumerate(fleet))):
        known.add(number, place, own)
    for number, (place, own) in enumerate(fleet):
        wanted = [
            other
            for elsewhere, others in fleet
            if elsewhere != place
            for other in others
            if any(have_in_common(identity, other) for identity in own)
        ]
        assert list(known.shared_with(number)) == wanted


@given(fleets, st.sets(st.sampled_from(["CN=/x", "CN=/talker", "CN=/nobody"])))
def test_whom_a_grant_names_under_an_authority_of_this_keystore_is_given_too(
    fleet: list[tuple[str, list[Identity]]], named: set[str]
) -> None:
    known = Identities()
    for number, (place, own) in enumerate(fleet):
        known.add(number, place, own, named if number == 0 else ())
    for number, (place, own) in enumerate(fleet):
        trusted = {authority for identity in own for authority in identity.authorities}
        wanted = [
            other
            for elsewhere, others in fleet
            if elsewhere != place
            for other in others
            if any(have_in_common(identity, other) for identity in own)
            or (number == 0 and other.subject in named and bool(trusted & other.authorities))
        ]
        assert list(known.shared_with(number)) == wanted
