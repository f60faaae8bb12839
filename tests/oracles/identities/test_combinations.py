"""Identity CA files of every make beside OpenSSL as implementations ask it: what PKITS has no combination of."""

from __future__ import annotations

from datetime import timedelta

import pytest

from keystore_audit.model.trust.chain import chain_refusal
from keystore_audit.model.trust.verdicts import is_issued
from keystore_audit.profiles import VARIANTS
from tests.amount import tried
from tests.keystore.builder import START, authority, certificate, evidence, read
from tests.oracles.identities.pool import combinations, pool
from tests.oracles.pkits import paths
from tests.oracles.pkits.audited import NO_PARTICIPANT, REFUSALS, Row, rows_of

pytestmark = pytest.mark.xdist_group("identities")  # every combination is tried once

AT = START + timedelta(days=400)
NUMBER = tried(300)
"""Random combinations, 15 ms each."""


def is_wrong(row: Row) -> bool:
    """Whether accepted does not mean accepted, or refused not refused. What is open is neither.

    That no participant is created is not enough: a rule of KA2 has to say why, or to be in doubt. Nor is a rule:
    what is proven rests on who has a participant.
    """
    if row.refused == "":
        return bool(row.said & REFUSALS)
    return not row.said - {"unusable", "unloaded"} or not row.said & NO_PARTICIPANT


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[Row]:
    made, openssl = pool(), paths.load()
    found: list[Row] = []
    for combination in combinations(made, NUMBER, seed=20261121):
        authorities = [made.authorities[name].der for name in combination.authorities]
        identity = made.identities[combination.identity].der
        lists = [made.lists[combination.revocations]] if combination.revocations is not None else []
        found += rows_of(combination, openssl, tmp_path_factory.mktemp("keystore"), AT, authorities, identity, *lists)
    return found


def test_accepted_is_accepted_and_refused_is_refused(rows: list[Row]) -> None:
    wrong = [row for row in rows if is_wrong(row)]
    assert not wrong, "\n".join(map(str, wrong))


@pytest.mark.parametrize(("days", "refused"), [(30, "certificate has expired"), (3650, "")])
def test_a_path_that_is_taken_has_to_be_in_force_though_another_one_is(days: int, refused: str) -> None:
    """A root that an older one certified, too, and both its certificates: the older one is found first."""
    older = authority("older", length=None, end=START + timedelta(days=days))
    root = authority("root")
    crossed = certificate("root", older, key=root.key, ca=True)
    authorities, identity = [each.der for each in (older, crossed, root)], certificate("/talker", root).der
    caller = next(each for each in paths.CALLERS if each.whole_file)
    assert paths.load().accepts(caller, authorities, identity, AT) == refused
    file, leaf = read(*(each.pem for each in (older, crossed, root))), evidence(certificate("/talker", root))
    trust = VARIANTS["fastdds-2.6"].trust
    assert is_issued(file, leaf, trust, AT)
    assert chain_refusal(leaf, file, trust) is None
    assert (chain_refusal(leaf, file, trust, AT) is not None) == bool(refused)


def test_both_verdicts_occur(rows: list[Row]) -> None:
    for vendor in {row.vendor for row in rows}:
        mine = [row for row in rows if row.vendor == vendor]
        assert sum(not row.said - {"unloaded"} for row in mine) > tried(20)
        assert sum(bool(row.said & REFUSALS) for row in mine) > tried(20)
        assert sum(row.refused == "" for row in mine) > 20
