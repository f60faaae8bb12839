"""Nothing changes before "safe until": keystores of random dates are audited anew at seconds before it."""

from __future__ import annotations

import os
import random
from datetime import datetime, timedelta, timezone
from functools import cache
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding

from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.report.content import Report
from keystore_audit.settings.settings import read_settings
from tests.amount import tried
from tests.keystore import documents
from tests.keystore.builder import (
    GOVERNANCE,
    PrivateKey,
    Signed,
    authority,
    certificate,
    crl,
    signed_document,
    write,
    write_enclave,
)
from tests.keystore.documents import criterion

AT = datetime(2026, 6, 1, 12, tzinfo=timezone.utc)
LONG_AGO = AT - timedelta(days=900)
FAR = AT + timedelta(days=3000)
SECOND = timedelta(seconds=1)
DATES = [AT + timedelta(days=days, seconds=second) for days in (-1, 1, 2, 3) for second in (-1, 0, 0, 1)]
"""Few, so that some coincide, and some lie next to each other."""

PROFILES = ("spec", "fastdds-3.6", "fastdds-2.6.4", "cyclonedds-0.10", "cyclonedds-11", "opendds")
ZONES = (None, ZoneInfo("UTC"), ZoneInfo("Asia/Tokyo"), ZoneInfo("America/Los_Angeles"))
CLAIMS = """
[[property]]
name = "apart"
never_share_domain = ["/e", "/f"]
[[property]]
name = "writes-alone"
only_publish = { topic = "dds:rt/*", enclaves = "/e" }
[[property]]
name = "arrives"
able = { from = "/e", to = "/f" }
[[property]]
name = "arrives-tomorrow"
until = 2026-06-02T12:00:00Z
able = { from = "/e", to = "/f" }
"""


@cache
def key(number: int) -> PrivateKey:  # noqa: ARG001 (another key for each)
    return ec.generate_private_key(ec.SECP256R1())


def grant(chance: random.Random, subject: str) -> str:
    """A grant of one topic or two, with random dates."""
    start, end = dates(chance)
    named = chance.choice((("rt/a",), ("rt/a", "rt/b"), ("rt/a", "rt/b"), ("rt/b",)))
    fraction = chance.choice(("", "", "", ".5"))
    both = documents.rule(criterion("publish", *named), criterion("subscribe", *named))
    first, last = f"{start:%Y-%m-%dT%H:%M:%S}", f"{end:%Y-%m-%dT%H:%M:%S}{fraction}"
    return documents.grant(subject, both, start=first, end=last)


def dates(chance: random.Random) -> tuple[datetime, datetime]:
    """Of what is mostly in force at AT."""
    start = chance.choice([LONG_AGO, LONG_AGO, *DATES])
    end = chance.choice([FAR, *DATES])
    return (start, end) if start <= end else (end, start)


def rarely(chance: random.Random) -> tuple[datetime, datetime]:
    return dates(chance) if chance.random() < 0.2 else (LONG_AGO, FAR)


def keystore(chance: random.Random, root: Path) -> Path:
    """Two enclaves; what each part of it is worth changes at random dates."""
    start, end = rarely(chance)
    identity = authority("identityCA", key=key(0), start=start, end=end)
    start, end = rarely(chance)
    permissions = authority("permissionsCA", key=key(1), start=start, end=end)
    for number, path in enumerate(("/e", "/f"), 2):
        directory = root / "enclaves" / path.strip("/")
        start, end = rarely(chance)
        own = certificate(path, identity, key=key(number), start=start, end=end)
        granted = "".join(grant(chance, path) for _ in range(chance.choice((1, 2))))
        document = documents.permissions(granted).encode()
        write_enclave(directory, own, document, identity, permissions, GOVERNANCE)
        os.chmod(directory / "key.pem", 0o600)
        if chance.random() < 0.1:
            write(directory, {"crl.pem": revocations(chance, identity)})
    if chance.random() < 0.3:  # a document that any enclave may present
        granted = grant(chance, chance.choice(("/e", "/f")))
        document = documents.permissions(granted).encode()
        write(root, {"enclaves/old.p7s": signed_document(document, permissions)})
    return root


def revocations(chance: random.Random, issuer: Signed) -> bytes:
    start, end = dates(chance)
    made = crl(issuer, days=(start - datetime(2024, 1, 1, tzinfo=timezone.utc)).days, end=max(end, start + 2 * SECOND))
    return made.public_bytes(Encoding.PEM)


def said(report: Report) -> tuple[object, object]:
    """Who starts under which profile, and what each property is."""
    usable = {(e.path, name): e.profiles[name].usable for e in report.enclaves for name in e.profiles}
    return usable, {each.prop.id: {name: p.status for name, p in each.profiles.items()} for each in report.properties}


def probes(chance: random.Random, until: datetime | None) -> list[datetime]:
    """Seconds after AT and before `until`: those around dates above all."""
    until = until and until.replace(microsecond=0)  # as reports say it
    near = {date + step * SECOND for date in DATES for step in (-1, 0, 1, 2)}
    near |= {AT + timedelta(hours=chance.randint(1, 100)) for _ in range(2)}
    if until is not None:
        near |= {until - step * SECOND for step in (1, 2)}
    before = sorted(each for each in near if each > AT and (until is None or each < until))
    return chance.sample(before[-6:], min(3, len(before))) + chance.sample(before, min(2, len(before)))


@pytest.mark.parametrize("start", range(0, tried(60), 10))
def test_nothing_changes_before_safe_until(start: int, tmp_path: Path) -> None:
    """Who starts, and what each property is, under profiles and in zones at random."""
    settings_file = tmp_path / "keystore-audit.toml"
    settings_file.write_text(CLAIMS)
    settings = read_settings(settings_file, ())
    asked = 0
    for seed in range(start, start + 10):
        chance = random.Random(seed)
        root = keystore(chance, tmp_path / str(seed))
        profiles = tuple(chance.sample(PROFILES, chance.choice((1, 1, 2, len(PROFILES)))))
        zone = chance.choice(ZONES)

        def at(
            moment: datetime, root: Path = root, profiles: tuple[str, ...] = profiles, zone: ZoneInfo | None = zone
        ) -> Report:
            options = Options(at=moment, engine="native", profiles=profiles, time_zone=zone, settings=settings)
            return audit(root, options)

        now = at(AT)
        for moment in probes(chance, now.safe_until):
            assert said(at(moment)) == said(now), (seed, profiles, zone, moment, now.safe_until)
            asked += 1
    assert asked >= 10
