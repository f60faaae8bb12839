"""What an attestation says of files is what was audited: a file swapped or added afterwards is noticed."""

from __future__ import annotations

import hashlib
import io
import json
import shutil
import ssl
import sys
from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from keystore_audit.cli.program import run
from keystore_audit.keystore.traces import MAX_HASHED
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.report.content import Report
from keystore_audit.report.statement import render_svr
from keystore_audit.settings.settings import read_settings
from tools.samples.made_at_test_time import RECIPES

SAMPLE = Path(__file__).parents[2] / "sample_keystores" / "healthy" / "turtlesim"


@pytest.fixture
def keystore(tmp_path: Path) -> Path:
    copy = tmp_path / "keys"
    shutil.copytree(SAMPLE, copy, symlinks=True)
    for key in copy.rglob("key.pem"):
        key.chmod(0o600)
    return copy


def declared(sample: Path = SAMPLE) -> list[str]:
    """The options that declare the authorities of a sample, or of a keystore, by fingerprint."""
    roles = ("identity", "permissions")
    ders = {role: ssl.PEM_cert_to_DER_cert((sample / f"public/{role}_ca.cert.pem").read_text()) for role in roles}
    digests = {role: hashlib.sha256(der).hexdigest() for role, der in ders.items()}
    return [word for role in roles for word in (f"--expect-{role}-ca", f"sha256:{digests[role]}")]


def _pairs(options: list[str]) -> list[tuple[str, str]]:
    return list(zip(options[::2], options[1::2], strict=True))


def statement(keystore: Path, *options: str, kind: str = "svr", trusting: Path | None = SAMPLE) -> dict[str, Any]:
    target = keystore.parent / "statement.json"
    given = declared(trusting) if trusting is not None else []
    run(["audit", str(keystore), "--engine", "native", "-q", "-o", f"{kind}={target}", *given, *options])
    loaded: dict[str, Any] = json.loads(target.read_text())
    return loaded


def broken(keystore: Path, said: dict[str, Any]) -> list[str]:
    """Subjects whose file is another one now."""
    return [
        subject["name"]
        for subject in said["subject"]
        if hashlib.sha256((keystore / subject["name"]).read_bytes()).hexdigest() != subject["digest"]["sha256"]
    ]


@pytest.fixture(autouse=True)
def _no_output(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BytesIO(), "utf-8"))


@pytest.mark.parametrize("kind", ["svr", "statement"])
def test_it_says_what_it_was_judged_as(keystore: Path, kind: str) -> None:
    """CA private keys are a note where keystores are made: a verifier has to see that no robot was asked about."""
    for options, expected in (((), (False, None)), (("--deployed", "--domain", "0"), (True, 0))):
        predicate = statement(keystore, *options, kind=kind)["predicate"]
        details = predicate.get("verifier", predicate)["keystoreAudit"]
        assert (details["deployed"], details["domain"]) == expected
        assert details["engines"] == {"native": details["version"]}, "it is part of the program"


def test_what_nobody_asked_did_not_pass(keystore: Path) -> None:
    """Without an environment nothing is known of it, hence nothing attested."""
    environment = str(Path(__file__).parents[2] / "sample_keystores/environments/right.env")
    alone = statement(keystore, kind="statement")["predicate"]["passedTests"]
    asked = statement(keystore, "--env", environment, kind="statement")["predicate"]["passedTests"]
    assert "KA670" not in alone
    assert "KA670" in asked
    assert "KA203" in alone


def test_a_property_never_passed_without_its_condition(keystore: Path) -> None:
    """Neither as a test."""
    passed = statement(keystore, kind="statement")["predicate"]["passedTests"]
    assert "nobody-writes-without-a-grant-if-nothing-else-certified-and-truthful-announcements" in passed
    assert not [each for each in passed if each.startswith("KA7")]
    narrow = statement(keystore, "--profile", "spec", kind="statement")["predicate"]["passedTests"]
    assert narrow == ["pass-the-text-of-dds-security-1-1-if-nothing-else-certified"]


def test_it_says_with_which_arguments_launch_files_are_started(keystore: Path, tmp_path: Path) -> None:
    """By its default this one starts without security: a statement that does not say so would pass for it."""
    file = tmp_path / "some.launch.xml"
    file.write_text(
        '<launch><arg name="secure" default="no"/><set_env name="ROS_SECURITY_ENABLE" value="$(var secure)"/>'
        '<node pkg="p" exec="e" args="--ros-args --enclave /turtlesim"/></launch>',
        "utf-8",
    )
    alone = statement(keystore, "--launch", str(file), kind="statement")["predicate"]
    told = statement(keystore, "--launch", str(file), "--launch-argument", "secure:=true", kind="statement")[
        "predicate"
    ]
    assert (alone["result"], told["result"]) == ("FAILED", "WARNED")
    assert ["secure:=true" in " ".join(each["keystoreAudit"]["stated"]) for each in (alone, told)] == [False, True]


NOW = datetime(2026, 11, 21, 12, tzinfo=timezone.utc)
LARGE = 5_000_000
"""More than is read of a file."""


@pytest.mark.parametrize("name", ["map.bin", "enclaves/random/map.bin"])
def test_a_swapped_large_file_breaks_it(keystore: Path, name: str) -> None:
    large = keystore / name
    large.write_bytes(bytes(LARGE))
    said = statement(keystore)
    assert name in {subject["name"] for subject in said["subject"]}
    large.write_bytes(bytes(LARGE - 1) + b"x")
    assert broken(keystore, said) == [name]
    assert not verified(keystore, said, audit(str(keystore), Options(at=NOW, engine="native")))


@pytest.mark.parametrize("size", [MAX_HASHED, MAX_HASHED + 1, 10 * 1024**3])
def test_what_nobody_read_passes_in_no_statement_unless_it_is_accepted(tmp_path: Path, size: int) -> None:
    """A recording beside the keys: the audit passes, and no statement does before somebody accepts the file."""
    root = tmp_path / "keys"
    RECIPES["KA230"][1](root)  # with keys of its own: those of samples are a finding
    with (root / "map.bin").open("wb") as sparse:
        sparse.write(b"a map\n\n")
        sparse.truncate(size)
    hashed = size <= MAX_HASHED
    report = audit(str(root), Options(at=NOW, engine="native"))
    assert (report.exit_code, report.unread_foreign) == (0, ("map.bin",))
    assert any("map.bin first. This report holds if" in sentence for sentence in report.checked.not_checked)
    said = statement(root, trusting=root)
    assert not said["predicate"]["properties"]
    assert ("map.bin" in {subject["name"] for subject in said["subject"]}) is hashed
    result = statement(root, kind="statement", trusting=root)["predicate"]
    assert (result["result"], result["keystoreAudit"]["unread"]) == ("WARNED", ["map.bin"])
    assert result["keystoreAudit"]["uncovered"] == ([] if hashed else ["map.bin"])
    settings = tmp_path / "settings.toml"
    digest = next((each["digest"]["sha256"] for each in said["subject"] if each["name"] == "map.bin"), "0" * 64)
    trusted = "".join(f'{role[9:].removesuffix("-ca")} = "{sha256}"\n' for role, sha256 in _pairs(declared(root)))
    settings.write_text(f'[files]\naccepted = ["sha256:{digest}"]\n[authorities]\n{trusted}')
    given = read_settings(settings, ())
    accepted = replace(Options(at=NOW, engine="native"), settings=given, authorities=given.authorities)
    assert bool(json.loads(render_svr([audit(str(root), accepted)]))["predicate"]["properties"]) is hashed


def test_nobody_attests_to_authorities_that_nobody_declared(tmp_path: Path) -> None:
    """Neither PASS in any form nor a property; verdict and exit code stay."""
    root = tmp_path / "keys"
    RECIPES["KA230"][1](root)
    told = {}
    for trusting in (None, root):
        result = statement(root, kind="statement", trusting=trusting)["predicate"]
        properties = statement(root, trusting=trusting)["predicate"]["properties"]
        assert result["keystoreAudit"]["verdict"] == "pass"
        passes = any(each.startswith("KEYSTORE_AUDIT_PASS") for each in properties)
        told[trusting] = result["result"], passes, bool(properties)
        assumed = [each["name"] for each in result["keystoreAudit"]["assumptions"]]
        assert ("authorities-as-found" in assumed) is (trusting is None)
        said = result["keystoreAudit"]["authorities"]["identity"]["declared"]
        assert bool(said) is (trusting is not None)
    assert told == {None: ("WARNED", False, False), root: ("PASSED", True, True)}
    half = statement(root, *declared(root)[:2], trusting=None)["predicate"]["properties"]
    assert half == [], "one role is not enough"


@pytest.mark.parametrize(
    "weakening",
    [
        ["--at", "2026-11-21"],
        ["--ignore", "KA203"],
        ["--select", "KA2"],
        ["--fail-on", "critical"],
        ["--fail-on", "never"],
        ["--expires-within", "5"],
    ],
    ids=" ".join,
)
def test_a_weakened_gate_passes_in_no_statement(keystore: Path, weakening: list[str]) -> None:
    assert statement(keystore, kind="statement")["predicate"]["result"] != "FAILED"
    assert statement(keystore, *weakening, kind="statement")["predicate"]["result"] == "WARNED"
    assert statement(keystore, *weakening)["predicate"]["properties"] == []


def test_an_incomplete_audit_fails(keystore: Path) -> None:
    (keystore / "enclaves" / "random" / "permissions.p7s").write_bytes(b"MIME-Version: 1.0\n")
    permissions = keystore / "enclaves" / "random" / "permissions.p7s"
    permissions.unlink()
    permissions.mkdir()
    assert statement(keystore, kind="statement")["predicate"]["result"] == "FAILED"
    assert statement(keystore)["predicate"]["properties"] == []


class Tampering:
    """Changes the keystore in the middle of its audit: at a stage, or when so many enclaves are read."""

    def __init__(self, moment: str | int, change: Callable[[], object]) -> None:
        self._moment = moment
        self._change: Callable[[], object] | None = change

    def _at(self, moment: str | int) -> None:
        if self._change is not None and moment == self._moment:
            self._change()
            self._change = None

    def stage(self, name: str) -> None:
        """A stage begins."""
        self._at("read" if "mean" in name else name)

    def enclaves(self, done: int, total: int) -> None:  # noqa: ARG002 - the audit's signature
        """So many are read."""
        self._at(done)

    @property
    def done(self) -> bool:
        """Whether it has happened."""
        return self._change is None


def verified(keystore: Path, said: dict[str, Any], now: Report) -> bool:
    """What docs/ci.md checks: the hashes of the files, and the digest of the tree."""
    digest = said["predicate"]["verifier"]["keystoreAudit"]["keystoreDigest"]
    there = all((keystore / subject["name"]).is_file() for subject in said["subject"])
    return there and not broken(keystore, said) and digest == now.digest


CHANGES: dict[str, Callable[[Path], object]] = {
    "swapped": lambda root: shutil.copyfile(root / "keyboard/permissions.p7s", root / "random/permissions.p7s"),
    "touched": lambda root: (root / "random/cert.pem").write_bytes((root / "random/cert.pem").read_bytes() + b"\n"),
    "added": lambda root: shutil.copytree(root / "random", root / "zebra", symlinks=True),
    "added a file": lambda root: (root / "random/crl.pem").write_bytes(b"-----BEGIN X509 CRL-----"),
    "removed": lambda root: (root / "turtlesim/permissions.p7s").unlink(),
}


@pytest.mark.parametrize("moment", [1, 2, 3, "read", "after"])
@pytest.mark.parametrize("change", CHANGES)
def test_what_changes_during_the_audit_breaks_verification_or_was_audited(
    keystore: Path, change: str, moment: str | int
) -> None:
    """Whoever verifies the tree against the statement has the verdict of that very tree."""
    options = Options(at=datetime(2026, 11, 21, 12, tzinfo=timezone.utc), engine="native")
    enclaves = keystore / "enclaves"
    tampering = Tampering(moment, lambda: CHANGES[change](enclaves))
    report = audit(str(keystore), options, progress=tampering)
    assert tampering.done is (moment != "after")
    if moment == "after":
        CHANGES[change](enclaves)
    said = json.loads(render_svr([report]))
    now = audit(str(keystore), options)
    if verified(keystore, said, now):
        assert (now.verdict, now.findings, now.properties) == (report.verdict, report.findings, report.properties)
    if moment in ("read", "after"):
        assert not verified(keystore, said, now)


POLICY = """<policy version="0.2.0" xmlns:xi="http://www.w3.org/2001/XInclude"><enclaves><enclave path="/random">
<profiles><profile ns="/" node="random"><xi:include href="common.xml" xpointer="xpointer(/profile/*)"/></profile>
</profiles></enclave></enclaves></policy>
"""
COMMON = '<profile><topics publish="ALLOW"><topic>chatter</topic></topics></profile>\n'
LAUNCH = '<launch><include file="$(dirname)/more.launch.xml"/></launch>\n'
ASKED = "module asked\nopen keystore_audit\n\nassert Something { some Enclave }\ncheck Something for 0\n"
MORE = '<launch><node pkg="demo" exec="random" name="random"/></launch>\n'


def test_every_file_that_it_was_judged_with_is_named_with_its_digest(keystore: Path) -> None:
    """Somebody who checks a statement has to see which policy it was, and included files decide as well."""
    beside = keystore.parent
    samples = SAMPLE.parents[1]
    files = {"p.xml": POLICY, "common.xml": COMMON, "a.launch.xml": LAUNCH, "more.launch.xml": MORE}
    for name, text in files.items():
        (beside / name).write_text(text)
    shutil.copy(samples / "graphs" / "turtlesim.graph.json", beside / "g.json")
    (beside / "asked.als").write_text(ASKED)
    (beside / "robot.env").write_text("ROS_SECURITY_ENABLE=true\n")
    (beside / "s.toml").write_text("max_suppression_days = 30\n")
    shown = {
        "--env": ["robot.env"],
        "--policy": ["p.xml", "common.xml"],
        "--graph": ["g.json"],
        "--launch": ["a.launch.xml", "more.launch.xml"],
        "--alloy-property": ["asked.als"],
        "--settings": ["s.toml"],
    }
    options = [str(part) for option, names in shown.items() for part in (option, beside / names[0])]
    digests = {
        str(beside / name): hashlib.sha256((beside / name).read_bytes()).hexdigest()
        for names in shown.values()
        for name in names
    }
    for kind, told in (("svr", ("verifier", "policies")), ("statement", ("configuration",))):
        entries: Any = statement(keystore, *options, kind=kind)["predicate"]
        for key in told:
            entries = entries[key]
        assert {entry["name"]: entry["digest"]["sha256"] for entry in entries} == digests
        assert len(entries) == len(digests)
    before = statement(keystore, *options, kind="statement")["predicate"]["configuration"]
    (beside / "common.xml").write_text(COMMON.replace("chatter", "other"))
    after = statement(keystore, *options, kind="statement")["predicate"]["configuration"]
    assert [entry["name"] for entry in after if entry not in before] == [str(beside / "common.xml")]
