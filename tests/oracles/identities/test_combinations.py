"""Identity CA files of every make beside OpenSSL as implementations ask it: what PKITS has no combination of."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta

import pytest
from cryptography.hazmat.primitives.serialization import Encoding

from tests.keystore.builder import START, Signed
from tests.oracles.identities.pool import Combination, combinations, pool
from tests.oracles.pkits import paths
from tests.oracles.pkits.audited import NO_PARTICIPANT, REFUSALS, objections

pytestmark = pytest.mark.xdist_group("identities")  # every combination is tried once

AT = START + timedelta(days=400)
NUMBER = 300
"""Random combinations, 15 ms each."""


@dataclass(frozen=True)
class Row:
    """What came of a combination for one implementation. Empty `refused` and empty `said`: both accept."""

    combination: Combination
    vendor: str
    refused: str
    said: frozenset[str]

    @property
    def wrong(self) -> bool:
        """Whether accepted does not mean accepted, or refused not refused. What is open is neither.

        That no participant is created is not enough: a rule of KA2 has to say why, or to be in doubt. Nor is a rule:
        what is proven rests on who has a participant.
        """
        if self.refused == "":
            return bool(self.said & REFUSALS)
        return not self.said - {"unusable", "unloaded"} or not self.said & NO_PARTICIPANT

    def __str__(self) -> str:
        return f"{self.combination}: {self.vendor} {self.refused or 'accepts'}, we: {sorted(self.said)}"


def der(signed: Signed) -> bytes:
    return signed.certificate.public_bytes(Encoding.DER)


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[Row]:
    made, openssl = pool(), paths.load()
    found = []
    for combination in combinations(made, NUMBER, seed=20261121):
        authorities = [der(made.authorities[name]) for name in combination.authorities]
        identity = der(made.identities[combination.identity])
        lists = [made.lists[combination.revocations]] if combination.revocations is not None else []
        said = objections(tmp_path_factory.mktemp("keystore"), AT, authorities, identity, *lists)
        for caller in paths.CALLERS:
            refused = openssl.accepts(caller, authorities, identity, AT, *lists)
            found.append(Row(combination, caller.name, refused, said[caller.name]))
    return found


def test_accepted_is_accepted_and_refused_is_refused(rows: list[Row]) -> None:
    wrong = [row for row in rows if row.wrong]
    assert not wrong, "\n".join(map(str, wrong))


def test_both_verdicts_occur(rows: list[Row]) -> None:
    for vendor in {row.vendor for row in rows}:
        mine = [row for row in rows if row.vendor == vendor]
        assert sum(not row.said - {"unloaded"} for row in mine) > 20
        assert sum(bool(row.said & REFUSALS) for row in mine) > 20
        assert sum(row.refused == "" for row in mine) > 20
