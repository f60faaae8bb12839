"""Dates of grants, against lxml's xs:dateTime and the examples of the facts."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from keystore_audit.model.validity import parse_instant

SCHEMA = etree.XMLSchema(
    etree.fromstring(
        '<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema"><xs:element name="d" type="xs:dateTime"/></xs:schema>'
    )
)


@given(
    st.datetimes(min_value=datetime(1, 1, 3), max_value=datetime(9999, 12, 29)),
    st.integers(-12 * 60, 12 * 60),
)
def test_every_offset_names_the_same_instant(instant: datetime, minutes: int) -> None:
    instant = instant.replace(microsecond=0)
    zone = timezone(timedelta(minutes=minutes))
    text = instant.replace(tzinfo=timezone.utc).astimezone(zone).isoformat()
    if len(text) == 25:
        assert parse_instant(text) == instant.replace(tzinfo=timezone.utc)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("2026-11-21T00:00:00", datetime(2026, 11, 21, tzinfo=timezone.utc)),
        ("2026-11-21T00:00:00Z", datetime(2026, 11, 21, tzinfo=timezone.utc)),
        ("2026-11-21T02:00:00+02:00", datetime(2026, 11, 21, tzinfo=timezone.utc)),
        ("2026-11-20T24:00:00", None),
        ("2026-11-21T00:00:00.25", datetime(2026, 11, 21, 0, 0, 0, 250000, tzinfo=timezone.utc)),
        ("2026-02-30T00:00:00", None),
        ("2026-11-21", None),
        ("2026-11-21T24:00:01", None),
        ("2026-11-21T00:00:00+12:01", None),
        ("99999-01-01T00:00:00", None),
        ("0001-01-01T00:00:00+12:00", None),
        ("9999-12-31T23:59:59-12:00", None),
        ("２026-11-21T00:00:00", None),
        ("", None),
    ],
)
def test_examples(text: str, expected: datetime | None) -> None:
    assert parse_instant(text) == expected


@given(st.from_regex(r"\A\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d{1,3})?(Z|[+-]\d\d:\d\d)?\Z").filter(str.isascii))
def test_what_we_read_is_a_date_to_the_schema(text: str) -> None:
    element = etree.Element("d")
    element.text = text
    if parse_instant(text) is not None:
        assert SCHEMA.validate(element)
