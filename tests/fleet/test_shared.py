"""Which identities keystores share, held against comparing each with each."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterable
from datetime import datetime, timezone

from hypothesis import given
from hypothesis import strategies as st

from keystore_audit.fleet.run import Identities
from keystore_audit.keystore.identity import Compared, Identity, alike

AT = datetime(2026, 11, 21, tzinfo=timezone.utc)


def identity(key: str, subject: str, authorities: Iterable[str]) -> Identity:
    return Identity(
        root="r",
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
    )


identities = st.builds(
    identity,
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
        known.add(number, place, Compared())
    assert [sorted(known.within(number)) for number in range(5)] == [
        ["a b", "a b/c"],
        ["c"],
        [],
        [],
        ["a b", "a b/c"],
    ]


@given(fleets, st.sets(st.sampled_from(["CN=/x", "CN=/talker", "CN=/nobody"])))
def test_those_and_only_those_that_are_alike_or_named_are_given(
    fleet: list[tuple[str, list[Identity]]], named: set[str]
) -> None:
    """`named`: whom grants name in the first keystore, under an authority of which they count."""
    known = Identities()
    for number, (place, own) in reversed(list(enumerate(fleet))):
        known.add(number, place, Compared(identities=tuple(own)), named if number == 0 else ())
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
        assert list(known.shared_with(number).identities) == wanted


def test_names_of_nobody_cost_nothing() -> None:
    """A hostile keystore has 1,000 authorities and 10,000 names."""
    known = Identities()
    own = identity("a", "CN=/e", map(str, range(200)))
    known.add(0, "/1", Compared(identities=(own,)), [f"CN=/{number}" for number in range(200)])
    tracemalloc.start()
    try:
        assert known.shared_with(0) == Compared()
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()
