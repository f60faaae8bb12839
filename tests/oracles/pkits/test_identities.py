"""Identities, certification paths and revocation lists of PKITS: the auditor beside OpenSSL as implementations ask it.

PKITS expects path validation of RFC 5280. DDS implementations give what X509_verify_cert gives with their flags, so
that this is the measure: PKITS says what is tried, the implementation's call what is right, and `suite.Counts` which
sections reach which implementation.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import pytest
from msgspec import Struct
from msgspec.structs import replace

from keystore_audit import toml
from tests.oracles.pkits import paths, suite
from tests.oracles.pkits.audited import REFUSALS, Row, rows_of

pytestmark = pytest.mark.xdist_group("pkits")  # every trial is made once

AT = datetime(2020, 1, 1, tzinfo=timezone.utc)
"""PKITS certificates are valid from 2010 to 2030, but for those whose validity is the test."""

LISTED: dict[str, list[dict[str, Any]]] = toml.loads((Path(__file__).parent / "deviations.toml").read_text("utf-8"))
STRICTER = LISTED["stricter"]


class Trial(Struct, frozen=True):
    """One identity under one identity CA file, with a revocation list or none.

    `layout`: "anchor" (the file holds the trust anchor), "path" (trust anchor and intermediates), "issuer" (nothing but
    the intermediate that issued the identity), each perhaps "with list".
    """

    layout: str
    label: str
    authorities: tuple[bytes, ...]
    identity: bytes
    crls: tuple[bytes, ...] = ()

    def __str__(self) -> str:
        return f"{self.layout}: {self.label}"


def trials(pkits: suite.Suite, openssl: paths.Paths) -> Iterator[Trial]:
    anchor = pkits.anchor
    for name, certificate in pkits.certificates.items():
        yield Trial("anchor", name, (anchor,), certificate)
        if openssl.issued(anchor, certificate):
            yield Trial("anchor with list", name, (anchor,), certificate, (pkits.anchor_list,))
    for case in pkits.cases:
        yield Trial("path", case.label, (anchor, *case.issuers), case.signer)
        issuer = next((each for each in case.issuers if openssl.issued(each, case.signer)), None)
        if issuer is None:
            continue
        yield Trial("issuer", case.label, (issuer,), case.signer)
        for name, revocations in pkits.lists.items():
            if openssl.names_issuer(issuer, revocations):
                label = f"{case.label}, {name}"
                yield Trial("path with list", label, (anchor, *case.issuers), case.signer, (revocations,))


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[Row]:
    pkits, openssl = suite.load(), paths.load()
    found: list[Row] = []
    for trial in trials(pkits, openssl):
        directory = tmp_path_factory.mktemp("keystore")
        found += rows_of(trial, openssl, directory, AT, trial.authorities, trial.identity, *trial.crls)
    return [replace(row, said=row.said - {"unloaded"}) for row in found]


def _is(row: Row, entry: dict[str, Any]) -> bool:
    """Whether it is what an entry of the list is about: layout, implementation, tests, and what either says."""
    return bool(
        re.fullmatch(entry["layout"], row.trial.layout)
        and row.vendor in entry["vendors"]
        and re.fullmatch(entry.get("tests", ".*"), row.trial.label)
        and re.fullmatch(entry.get("refused", ""), row.refused)
        and ("objections" not in entry or row.said == {*entry["objections"]})
    )


def _of(row: Row, entries: list[dict[str, Any]]) -> bool:
    return any(_is(row, entry) for entry in entries)


def accepted_wrongly(row: Row) -> bool:
    """That a participant is "unusable" is not enough: a rule of KA2 has to say why, or to be in doubt."""
    return not row.said - {"unusable"} and row.refused != ""


def refused_wrongly(row: Row) -> bool:
    return row.refused == "" and bool(row.said & REFUSALS)


def test_the_suite_is_complete() -> None:
    """Every number of every section once: the names were told apart rightly."""
    numbers = sorted(case.number for case in suite.load().cases)
    assert numbers == sorted(f"{name}.{n}" for name, each in suite.SECTIONS.items() for n in range(1, each.tests + 1))
    assert len(numbers) == 224


def test_rfc_5280_is_what_the_suite_says() -> None:
    """The oracle itself: on whole paths without lists and policies, OpenSSL says what the name of the test says."""
    pkits, openssl = suite.load(), paths.load()
    for case in pkits.cases:
        if suite.SECTIONS[case.section].counts is suite.Counts.ALWAYS and case.number != "4.1.5":
            # 4.1.5 inherits DSA parameters from its issuer, which OpenSSL 3 does not do.
            refused = openssl.accepts(paths.CALLERS[0], (pkits.anchor, *case.issuers), case.signer, AT)
            assert (refused == "") == case.valid, (case.label, refused)


def test_policies_count_for_fast_dds_alone() -> None:
    """Nothing in 4.8 to 4.12 but policies is wrong, and for callers without the flag nothing is."""
    pkits, openssl = suite.load(), paths.load()
    fast_dds, others = paths.CALLERS[0], replace(paths.CALLERS[0], flags=paths.Flag.NONE)
    refused = 0
    for case in pkits.cases:
        if suite.SECTIONS[case.section].counts is suite.Counts.POLICIES:
            path = (pkits.anchor, *case.issuers)
            assert openssl.accepts(others, path, case.signer, AT) == "", case.label
            refused += openssl.accepts(fast_dds, path, case.signer, AT) != ""
    assert refused > 40


def test_what_we_accept_is_accepted(rows: list[Row]) -> None:
    wrong = [row for row in rows if accepted_wrongly(row)]
    assert not wrong, "\n".join(map(str, wrong))


def test_what_we_call_refused_is_refused(rows: list[Row]) -> None:
    """An identity that peers take after all could do what no property has looked at."""
    wrong = [row for row in rows if refused_wrongly(row) and not _of(row, STRICTER)]
    assert not wrong, "\n".join(map(str, wrong))


def test_where_we_are_stricter_is_listed(rows: list[Row]) -> None:
    """Each with a reason; the list neither grows nor keeps what is no longer so."""
    found = [row for row in rows if row.said and not row.refused]
    unlisted = [row for row in found if not _of(row, STRICTER)]
    assert not unlisted, "\n".join(map(str, unlisted))
    for entry in STRICTER:
        assert entry["reason"]
        count = sum(_is(row, entry) for row in found)
        assert count == entry["count"], f"{count} of {entry['tests']} under {entry['layout']}"


def test_something_was_tried(rows: list[Row]) -> None:
    """Both verdicts occur in every layout but the issuer alone, which nobody takes."""
    for layout in {row.trial.layout for row in rows} - {"issuer"}:
        assert {bool(row.refused) for row in rows if row.trial.layout == layout} == {True, False}, layout
        assert {bool(row.said) for row in rows if row.trial.layout == layout} == {True, False}, layout
    assert all(row.refused for row in rows if row.trial.layout == "issuer")
