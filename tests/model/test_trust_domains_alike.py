"""Governances that say the same, each signed anew, make one trust domain; nothing is answered otherwise."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from functools import cache
from itertools import count
from pathlib import Path
from shutil import rmtree
from typing import Any

import pytest

from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model import inventory, systems
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.profiles import resolve
from keystore_audit.report.json import render
from keystore_audit.settings.settings import Settings, read_settings
from tests.amount import tried
from tests.engine.test_horizon_exactly import PROFILES
from tests.keystore.builder import Signed, certificate, key, signed_document
from tests.keystore.chance import Rules
from tests.keystore.documents import allow, domain_rule, governance, grant, ids, permissions, pub, topic_rule
from tests.model.comparing import AT, Member, Store, authority

TOPICS = ("rt/a", "rt/b", "rt/*", "*", "rt/c*")
RULES = Rules(
    expressions=lambda _random: TOPICS,
    partitions=("", "p", "*"),
    count=(None, None, None, None, 1),
    domains=lambda _random: (0, 1, (0, 1), (0, 230)),
)

PATHS = ("/a", "/a-b", "/c/d", "/e")
CLAIMS = """
[[property]]
name = "apart"
never_share_domain = ["/a", "/a-b"]
[[property]]
name = "alone"
only_publish = { topic = "/a", enclaves = "/a" }
[[property]]
name = "arrives"
able = { from = "/a", to = "/a-b" }
[[property]]
name = "kept"
no_flow = { from = "/a", to = "/a-b" }
"""


def said(chance: random.Random) -> str:
    """What a governance says; a comment does not count."""
    kinds = ("NONE", "SIGN", "ENCRYPT", "ENCRYPT")
    rules = [
        domain_rule(
            *(
                topic_rule(
                    chance.choice(("*", "*", *TOPICS)),
                    read=chance.random() < 0.8,
                    write=chance.random() < 0.8,
                    metadata=chance.choice(kinds),
                    data=chance.choice(("NONE", "ENCRYPT", "ENCRYPT")),
                )
                for _ in range(chance.choice((1, 1, 2)))
            ),
            domains=ids(*chance.choice(((0,), (0, 1), ((0, 230),)))),
            join=chance.random() < 0.7,
            rtps=chance.choice(kinds),
            unauthenticated=chance.random() < 0.1,
        )
        for _ in range(chance.choice((1, 1, 2)))
    ]
    return governance(*rules)


issued = cache(certificate)
Sign = Callable[[bytes, Signed], bytes]


def keystore(chance: random.Random, root: Path, sign: Sign = signed_document, *, copies: bool = False) -> Path:
    """Enclaves of two or three authorities, each with a governance of its own; identities of nobody lie beside.

    `copies`: keys of enclaves may lie beside, too.
    """
    authorities = [authority(name) for name in ("identityCA", "permissionsCA", "other")]
    texts, serial = [said(chance) for _ in range(chance.choice((1, 2, 2, 3)))], count(100)
    files: dict[str, bytes] = {}
    members: dict[str, Member] = {}
    signing = authorities[chance.choice((0, 1))]
    for path in PATHS[: chance.choice((2, 3, 4, 4))]:
        rules = [*(RULES.rule(chance) for _ in range(chance.choice((1, 1, 2, 3)))), allow(pub("rt/a"))]
        members[path] = Member(
            permissions=permissions(grant(path, *rules)),
            key=chance.choice((path, path, path, "/a")),
            serial=next(serial),
            issuer=chance.choice((None, None, None, authorities[2])),
        )
        text = chance.choice(texts) + chance.choice(("", "<!-- a comment -->"))
        signer = chance.choice((signing,) * 5 + (authorities[2], leaf(signing)))
        files[f"enclaves{path}/governance.p7s"] = sign(text.encode(), signer)
        for role in ("identity_ca", "permissions_ca"):
            if chance.random() < 0.2:
                trusted = chance.sample(authorities, chance.choice((1, 2)))
                files[f"enclaves{path}/{role}.cert.pem"] = b"".join(each.pem for each in trusted)
    strays = {}
    if chance.random() < 0.5:
        subject = chance.choice((*members, "/admin"))
        strays["old.p7s"] = permissions(grant(subject, RULES.rule(chance)))
    if chance.random() < 0.5:
        whose = chance.choice(("admin", "/a"))
        nobodys = issued("/admin", authorities[0], key=key(whose), serial=next(serial))
        held = {"backup/key.pem": nobodys.key_pem} if copies or whose == "admin" else {}
        files |= {"backup/cert.pem": nobodys.pem, **held}
        if chance.random() < 0.3:
            files["backup/governance.p7s"] = signed_document(chance.choice(texts).encode(), signing)
    revoked = (chance.choice((100, 101)),) if chance.random() < 0.2 else None
    made = Store(members=members, permissions=(signing,), revoked=revoked, strays=strays, files=files)
    return made.write(root)


def leaf(signer: Signed) -> Signed:
    """Who may sign where the signer is not pinned."""
    return issued("/signer", signer, key=key("signer"), serial=5)


def told(root: Path, settings: Settings | None = None, profiles: tuple[str, ...] = ("spec",)) -> dict[str, Any]:
    """What an audit says."""
    options = Options(at=AT, engine="native", profiles=profiles, settings=settings)
    found: dict[str, Any] = json.loads(render(audit(root, options)))
    return found


def answers(report: dict[str, Any]) -> object:
    """Whether each enclave starts, what holds, and what comes of it."""
    properties = [
        {**each, "profiles": {name: answer["status"] for name, answer in each["profiles"].items()}}
        for each in report["properties"]
    ]
    stated = [(each["id"], each["status"], each["profiles"]) for each in properties]
    return stated, report["enclaves"], report["verdict"], report["exit_code"], report["safe_until"]


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    place = tmp_path / "keystore-audit.toml"
    place.write_text(CLAIMS)
    return read_settings(place, ())


@pytest.mark.parametrize("start", range(0, tried(100, 20), 20))
def test_answers_are_the_same_whether_or_not_they_are_one(
    start: int, settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a key of an enclave that lies beside this is not asked: who has it adds nothing to a trust domain that has the
    enclave, and is somebody else in another one, however alike.
    """
    for seed in range(start, start + 20):
        chance = random.Random(seed)
        root = keystore(chance, tmp_path / str(seed))
        profiles = tuple(chance.sample(PROFILES, chance.choice((1, 2, len(PROFILES)))))
        one = told(root, settings, profiles)
        with monkeypatch.context() as apart:
            apart.setattr(inventory, "_unplaced", lambda _part: object())
            assert answers(told(root, settings, profiles)) == answers(one), seed


@pytest.mark.parametrize("start", range(0, tried(100, 20), 20))
def test_signing_anew_changes_nothing_in_a_report(start: int, settings: Settings, tmp_path: Path) -> None:
    """Beside copies of what was signed once."""
    for seed in range(start, start + 20):
        reports = []
        for sign in (signed_document, cache(signed_document)):
            root, chance = tmp_path / "store", random.Random(seed)
            keystore(chance, root, sign, copies=True)
            report = told(root, settings, tuple(chance.sample(PROFILES, chance.choice((1, 2, len(PROFILES))))))
            reports.append({**report, "keystore": {**report["keystore"], "digest": ""}})
            rmtree(root)
        assert reports[0] == reports[1], seed


LOOSE = governance(domain_rule(topic_rule(write=False)))


def store(**governances: bytes) -> Store:
    """Enclaves by name, each with the bytes of its governance."""
    granted = {f"/{name}": permissions(grant(f"/{name}", allow(pub("rt/a")))) for name in governances}
    members = {path: Member(permissions=each, serial=n) for n, (path, each) in enumerate(granted.items(), 100)}
    files = {f"enclaves/{name}/governance.p7s": content for name, content in governances.items()}
    return Store(members=members, files=files)


def signed(text: str, signer: str = "permissionsCA") -> bytes:
    """Anew each time."""
    return signed_document(text.encode(), authority(signer))


@pytest.mark.parametrize(
    ("second", "count"),
    [
        (governance(), 1),
        (governance().replace("<dds>", "<dds><!-- of b -->"), 1),
        (governance(domain_rule(topic_rule(), topic_rule())), 2),
        (LOOSE, 2),
    ],
)
def test_those_that_say_the_same_are_one(second: str, count: int, tmp_path: Path) -> None:
    written = read_keystore(store(a=signed(governance()), b=signed(second)).write(tmp_path))
    accesses = AccessViews(documents_of(written), AT, None)
    made = SystemBuilder(written, resolve(()), AT, accesses).systems()
    assert {len(system.trust_domains) for system in made} == {count}


def test_who_signed_it_tells_them_apart(tmp_path: Path) -> None:
    """The second is nobody's whom its enclave trusts."""
    root = store(a=signed(governance()), b=signed(governance(), "other")).write(tmp_path)
    failed = {e["path"]: e["profiles"]["spec"]["usable"] for e in told(root)["enclaves"]}
    assert failed == {"/a": True, "/b": False}


@pytest.mark.parametrize(("most", "code"), [(9, 1), (8, 4)])
def test_more_pairs_than_the_budget_are_no_answer(
    most: int, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(systems, "MAX_JUDGED", most)
    each = [governance(domain_rule(topic_rule(f"rt/{name}", data="NONE"), topic_rule())) for name in "abc"]
    report = told(store(a=signed(each[0]), b=signed(each[1]), c=signed(each[2])).write(tmp_path))
    assert report["exit_code"] == code
    said = any("3 trust domains are too many for 3 participants" in each["message"] for each in report["findings"])
    assert said is (code == 4)
