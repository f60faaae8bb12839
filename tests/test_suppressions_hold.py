"""What a suppression holds on to: for each sentence of docs/settings.md on fingerprint and meaning a pair about it.

Each finding of the keystore before is accepted by a baseline and by settings alike; after one change it is accepted
still, or asks again.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.baseline import create
from keystore_audit.findings import Finding
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.settings.settings import read_baseline, read_settings
from tests.rules.evidence import AT, DAY
from tests.test_fingerprints import STRANGER, enclave, renewed
from tools.samples.base import IDENTITY_CA, LISTENER, PERMISSIONS_CA, QUIET, TALKER, TWO
from tools.samples.documents import DISCOVERY, Governance, Grant, Permissions, Rule, TopicRule
from tools.samples.identity_stories import revocation_list
from tools.samples.keys import Key
from tools.samples.smime import signed_by
from tools.samples.store import Store, write

NO_FLOW = '[[property]]\nname = "apart"\nno_flow = { from = "/a", to = "/b" }\n'


def wild(*more: str) -> Store:
    """The talker may publish whatever begins so (KA510)."""
    return replace(TWO, enclaves=(enclave("/talker", Rule(publish=("rt/chatter*", *more))), LISTENER))


def reformatted(store: Store) -> Store:
    """The talker's document with lines between its rules."""

    def spaced(document: bytes) -> bytes:
        return signed_by(PERMISSIONS_CA).smime(document.replace(b"<allow_rule>", b"\n\n\n<allow_rule>"))

    first = replace(store.enclaves[0], seal=spaced)
    return replace(store, enclaves=(first, *store.enclaves[1:]))


def trusting(*authorities: bytes) -> Store:
    """The listener trusts more authorities for identities."""
    changes = {"identity_ca.cert.pem": b"".join((IDENTITY_CA.pem(), *authorities))} if authorities else {}
    return replace(wild(), enclaves=(wild().enclaves[0], replace(LISTENER, changes=changes)))


def ending(days: int, *, anew: bool = False) -> Store:
    """The talker's identity ends so soon (KA205)."""
    key = Key(label="suppressions anew") if anew else TALKER.certificate.key
    certificate = replace(TALKER.certificate, key=key, not_after=AT + days * DAY)
    return replace(TWO, enclaves=(replace(TALKER, certificate=certificate), LISTENER))


def through(*ways: str) -> Store:
    """/a reaches /b over these."""
    read = {"/c": ("rt/ac",), "/d": ("rt/ad",)}
    enclaves = (
        enclave("/a", Rule(publish=("rt/ac", "rt/ad"))),
        enclave("/b", Rule(subscribe=("rt/cb", "rt/db"))),
        *(enclave(way, Rule(publish=(f"rt{way}b",), subscribe=read[way])) for way in ways),
    )
    return replace(TWO, enclaves=enclaves)


def relaying(relay: str = "NONE", **changes: bytes) -> Store:
    """The listener may relay rt/chatter, whose payload is in the clear (KA725)."""
    topics = (TopicRule(expression="rt/chatter", data=relay), TopicRule())
    listener = replace(enclave("/listener", Rule(relay=("rt/chatter",))), changes=changes)
    return replace(TWO, enclaves=(TALKER, listener), governance=Governance(rules=(replace(QUIET, topics=topics),)))


def unmanaged(*topics: str) -> Store:
    """A document of no enclave, for nobody here, beside them."""
    grants = (Grant(path="/elsewhere", rules=(Rule(publish=topics), DISCOVERY)),)
    signed = signed_by(PERMISSIONS_CA).smime(Permissions(grants=grants).xml().encode())
    return replace(relaying(), changes={"old.p7s": signed})


CASES: dict[str, tuple[str, Store, Store, bool]] = {
    "identity: no line numbers": ("KA510", wild(), reformatted(wild()), True),
    "identity: another key of the rule": ("KA510", wild(), wild("rt/map*"), False),
    "signing again keeps it": ("KA510", wild(), renewed(wild()), True),
    "another writer asks again": ("KA510", wild(), wild("rt/map"), False),
    "renewing with the same key keeps it": ("KA205", ending(5), ending(9), True),
    "renewing with another key asks again": ("KA205", ending(5), ending(9, anew=True), False),
    "another anchor asks again": ("KA510", trusting(), trusting(STRANGER.pem()), False),
    "an anchor renewed with its key keeps it": (
        "KA510",
        trusting(STRANGER.pem()),
        trusting(replace(STRANGER, not_after=STRANGER.not_after + DAY).pem()),
        True,
    ),
    "an authority that nobody expects keeps it when it is renewed with its key": (
        "KA223",
        trusting(STRANGER.pem()),
        trusting(replace(STRANGER, not_after=STRANGER.not_after + DAY).pem()),
        True,
    ),
    "another authority that nobody expects asks again": (
        "KA223",
        trusting(STRANGER.pem()),
        trusting(replace(STRANGER, key=Key(label="suppressions stranger")).pem()),
        False,
    ),
    "another way to violate a property asks again": ("KA740", through("/c"), through("/d"), False),
    "a further way to violate a property asks again": ("KA740", through("/c"), through("/c", "/d"), False),
    "all documents signed again keep a property": ("KA740", through("/c"), renewed(through("/c")), True),
    "a revocation list is a part of what a property is about": (
        "KA725",
        relaying(),
        relaying(**{"crl.pem": revocation_list()}),
        False,
    ),
    "so is a document of no enclave": ("KA725", unmanaged("rt/a"), unmanaged("rt/b"), False),
}


def accepting(root: Path, options: Options, folder: Path, found: list[Finding]) -> list[Options]:
    """The options with these findings accepted, by a baseline and by settings."""
    baseline, settings = folder / "baseline.toml", folder / "settings.toml"
    text = create(str(root), options, reason="so", owner="Ada", until=(AT + DAY).date()).text
    baseline.write_text(text, "utf-8")
    why = f'reason = "so"\nowner = "Ada"\nuntil = {(AT + DAY).date()}\n'
    entries = (
        f'[[suppression]]\ncode = "{each.code}"\nfingerprint = "{each.fingerprint}"\nmeaning = "{each.meaning}"\n{why}'
        for each in found
    )
    settings.write_text(NO_FLOW * (options.settings is not None) + "".join(entries), "utf-8")
    return [
        replace(options, baseline=read_baseline(baseline, [root])),
        replace(options, settings=read_settings(settings, [root])),
    ]


@pytest.mark.parametrize("case", CASES)
def test_one_change_keeps_a_suppression_or_asks_again(case: str, tmp_path: Path) -> None:
    code, before, after, held = CASES[case]
    asserted = tmp_path / "asserted.toml"
    asserted.write_text(NO_FLOW if code == "KA740" else "", "utf-8")
    options = Options(at=AT, engine="native", settings=read_settings(asserted, ()) if code == "KA740" else None)
    for name, store in (("before", before), ("after", after)):
        write(store.tree(), tmp_path / name)
    found = [each for each in audit(str(tmp_path / "before"), options).findings if each.code == code]
    assert found
    for accepted in accepting(tmp_path / "before", options, tmp_path, found):
        for name, expected in (("before", True), ("after", held)):
            marks = [f.suppressed for f in audit(str(tmp_path / name), accepted).findings if f.code == code]
            assert marks
            assert all(mark is not None for mark in marks) is expected


@pytest.mark.parametrize("change", [{"profiles": ("spec",)}, {"domain": 0}])
def test_another_scope_asks_again_about_what_rests_on_it(change: dict[str, object], tmp_path: Path) -> None:
    write(relaying().tree(), tmp_path / "keystore")
    options = Options(at=AT, engine="native")
    (first, second) = (
        {each.code: each for each in audit(str(tmp_path / "keystore"), asked).findings}
        for asked in (options, replace(options, **change))
    )
    assert first["KA725"].fingerprint == second["KA725"].fingerprint
    assert first["KA725"].meaning != second["KA725"].meaning
