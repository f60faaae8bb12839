"""What a real participant accepts from an enclave that does what it likes: the same as we say, for random documents."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import pytest

from keystore_audit.truth import Truth
from tests.amount import tried
from tests.oracles.vendors.pairs import PATIENCE, Pairs
from tests.oracles.vendors.remote import ENDPOINTS_OF_A_PAIR, Remote, random_remote
from tests.oracles.vendors.remote_ours import effective
from tests.oracles.vendors.remote_reference import accepted_by_cyclone, accepted_by_fastdds

pytestmark = pytest.mark.xdist_group("vendors-pairs")  # every keystore is asked about once

SEEDS = (*range(tried(50)), 58, 61, 64, 81, 104)
"""Each a keystore that both vendors are asked about: 4,400 decisions. After the first 50, those that found faults."""

_REFERENCES = {"cyclone": accepted_by_cyclone, "fastdds": accepted_by_fastdds}

Accepted = Mapping[int, tuple[bool, ...]]
"""By seed, which of the second side's endpoints the first one accepted."""


@pytest.fixture(scope="module", params=["cyclone", "fastdds"])
def vendor(request: pytest.FixtureRequest) -> str:
    """The name of one of them."""
    return str(request.param)


@pytest.fixture(scope="module")
def places(vendor: str, tmp_path_factory: pytest.TempPathFactory) -> Mapping[int, Path]:
    """By seed, the directory of its keystore."""
    return {seed: tmp_path_factory.mktemp(f"{vendor}{seed}") for seed in SEEDS}


@pytest.fixture(scope="module")
def accepted(vendor: str, vendors: dict[str, Pairs], places: Mapping[int, Path]) -> Accepted:
    """What the vendor accepted; where it was other than was expected, asked again with patience."""
    remotes = {seed: random_remote(seed) for seed in places}
    sides = {seed: remote.sides(places[seed]) for seed, remote in remotes.items()}
    meetings = zip(sides, vendors[vendor].meet_all(list(sides.values())), strict=True)
    seen = {seed: remotes[seed].accepted(meeting) for seed, meeting in meetings}
    for seed, remote in remotes.items():
        if seen[seed] != _REFERENCES[vendor](remote):
            seen[seed] = remote.accepted(vendors[vendor].meet(*sides[seed], patience=4 * PATIENCE))
    return seen


def test_decisions_are_many_and_of_both_kinds(accepted: Accepted) -> None:
    answers = Counter(answer for each in accepted.values() for answer in each)
    assert sum(answers.values()) == len(SEEDS) * ENDPOINTS_OF_A_PAIR
    assert min(answers[True], answers[False]) > len(SEEDS) * ENDPOINTS_OF_A_PAIR / 10


def test_what_is_accepted_is_what_the_measurements_led_to(vendor: str, accepted: Accepted) -> None:
    others: list[str] = []
    for seed, answers in accepted.items():
        remote = random_remote(seed)
        expected = [Truth.YES if answer else Truth.NO for answer in _REFERENCES[vendor](remote)]
        others += _differences(seed, remote, answers, expected)
    assert not others


def test_what_is_accepted_is_what_we_call_effective(
    vendor: str, vendors: dict[str, Pairs], accepted: Accepted, places: Mapping[int, Path]
) -> None:
    remotes = {seed: random_remote(seed) for seed in places}
    others: list[str] = []
    asked = 0
    for seed, remote in remotes.items():
        rulings = effective(places[seed] / "keystore", "/second", remote.domain, remote.endpoints, vendor)
        asked += len(rulings) - rulings.count(None)
        different = list(_differences(seed, remote, accepted[seed], rulings))
        for patience in (PATIENCE, 4 * PATIENCE):
            if different:
                # It may also present nothing at all.
                alone = remote.accepted(vendors[vendor].meet(*remote.without_document(places[seed]), patience))
                theirs = [either or other for either, other in zip(accepted[seed], alone, strict=True)]
                different = list(_differences(seed, remote, theirs, rulings))
        others += different
    assert not others
    assert asked >= tried(1_000)


def _differences(seed: int, remote: Remote, theirs: Sequence[bool], expected: Sequence[Truth | None]) -> Iterator[str]:
    """`expected` None: an endpoint in several partitions, of which we are not asked."""
    for endpoint, their, our in zip(remote.endpoints, theirs, expected, strict=True):
        if our is not None and our is not (Truth.YES if their else Truth.NO):
            yield f"{seed}: {endpoint}: the vendor says {their}, we {our.value}"
