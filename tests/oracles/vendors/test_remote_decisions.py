"""What a real participant accepts from an enclave that does what it likes: the same as we say, for random documents."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path

import pytest

from keystore_audit.truth import Truth
from tests.amount import tried
from tests.oracles.vendors.ours import Asked
from tests.oracles.vendors.pairs import PATIENCE, Meeting, Pairs, Side
from tests.oracles.vendors.remote import ENDPOINTS_OF_A_PAIR, random_remote

pytestmark = pytest.mark.xdist_group("vendors-pairs")  # every keystore is asked about once

SEEDS = (*range(tried(50)), 58, 61, 64, 81, 104)
"""Each a keystore that both vendors are asked about: 4,400 decisions. After the first 50, those that found faults."""

Accepted = Mapping[int, tuple[bool, ...]]
"""By seed, which of the second side's endpoints the first one accepted."""

Rulings = Mapping[int, Sequence[Truth]]


@pytest.fixture(scope="module", params=["cyclone", "fastdds"])
def vendor(request: pytest.FixtureRequest) -> str:
    """The name of one of them."""
    return str(request.param)


@pytest.fixture(scope="module")
def places(vendor: str, tmp_path_factory: pytest.TempPathFactory) -> Mapping[int, Path]:
    """By seed, the directory of its keystore."""
    return {seed: tmp_path_factory.mktemp(f"{vendor}{seed}") for seed in SEEDS}


@pytest.fixture(scope="module")
def rulings(vendor: str, places: Mapping[int, Path], sides: Mapping[int, tuple[Side, Side]]) -> Rulings:
    """What we say that the most permissive peer accepts, of each endpoint."""
    found = {}
    for seed in sides:
        remote = random_remote(seed)
        now = datetime.now(timezone.utc)
        asked = Asked(places[seed] / "keystore", "/second", remote.domain, remote.endpoints, now)
        found[seed] = [answer.effective for answer in asked.endpoints(vendor)]
    return found


@pytest.fixture(scope="module")
def sides(places: Mapping[int, Path]) -> Mapping[int, tuple[Side, Side]]:
    """By seed, the two that meet."""
    return {seed: random_remote(seed).sides(place) for seed, place in places.items()}


@pytest.fixture(scope="module")
def accepted(
    vendor: str, vendors: dict[str, Pairs], sides: Mapping[int, tuple[Side, Side]], rulings: Rulings
) -> Accepted:
    """What the vendor accepted; where it was other than we say, asked again with patience."""
    seeds = list(sides)

    def expected(number: int, meeting: Meeting) -> bool:
        seed = seeds[number]
        return not any(_differences(seed, random_remote(seed).accepted(meeting), rulings[seed]))

    meetings = vendors[vendor].meet_all(list(sides.values()), expected)
    return {seed: random_remote(seed).accepted(meeting) for seed, meeting in zip(seeds, meetings, strict=True)}


def test_decisions_are_many_and_of_both_kinds(accepted: Accepted) -> None:
    answers = Counter(answer for each in accepted.values() for answer in each)
    assert sum(answers.values()) == len(SEEDS) * ENDPOINTS_OF_A_PAIR
    assert min(answers[True], answers[False]) > len(SEEDS) * ENDPOINTS_OF_A_PAIR / 10


def test_what_is_accepted_is_what_we_call_effective(
    vendor: str, vendors: dict[str, Pairs], accepted: Accepted, places: Mapping[int, Path], rulings: Rulings
) -> None:
    others: list[str] = []
    for seed, place in places.items():
        remote = random_remote(seed)
        different = list(_differences(seed, accepted[seed], rulings[seed]))
        for patience in (PATIENCE, 4 * PATIENCE):
            if different:
                # It may also present nothing at all.
                alone = remote.accepted(vendors[vendor].meet(*remote.without_document(place), patience))
                theirs = [either or other for either, other in zip(accepted[seed], alone, strict=True)]
                different = list(_differences(seed, theirs, rulings[seed]))
        others += different
    assert not others


def _differences(seed: int, theirs: Sequence[bool], ours: Sequence[Truth]) -> Iterator[str]:
    for endpoint, their, our in zip(random_remote(seed).endpoints, theirs, ours, strict=True):
        if our is not Truth(their):
            yield f"{seed}: {endpoint}: the vendor says {their}, we {our.value}"
