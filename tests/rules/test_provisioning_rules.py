"""KA660 to KA669, on whole keystores: what lies outside enclaves, what robots share, and how long it lasts."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    PrivateFormat,
)
from cryptography.hazmat.primitives.serialization.pkcs12 import serialize_key_and_certificates
from cryptography.x509.name import _ASN1Type
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from keystore_audit.access import Access
from keystore_audit.circumstances import Circumstances
from keystore_audit.findings import Finding, Severity
from keystore_audit.fleet import run
from keystore_audit.fleet.task import Audited, Task, carry_out
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.question import Question
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.profiles import resolve
from keystore_audit.report.content import Report
from tests.cli.keystores import answer
from tests.keystore.builder import (
    GOVERNANCE,
    PERMISSIONS,
    Signed,
    authority,
    certificate,
    signed_document,
    write_enclave,
)

AT = datetime(2026, 11, 21, 12, tzinfo=timezone.utc)
INSTANT = "2026-11-21T12:00:00Z"


class Fleet:
    """Two authorities, and keystores of robots whose enclaves they made."""

    def __init__(self) -> None:
        self.identity, self.permissions = authority("identityCA"), authority("permissionsCA")

    def robot(self, root: Path, *enclaves: str, topics: tuple[str, ...] = ("rt/chatter",)) -> Path:
        """A keystore whose enclaves may publish these topics."""
        for path in enclaves or ("/talker", "/listener"):
            folder, own = root / "enclaves" / path.strip("/"), certificate(path, self.identity)
            write_enclave(folder, own, _text(path, *topics), self.identity, self.permissions, GOVERNANCE)
            (folder / "key.pem").chmod(0o600)
        return root

    def document(self, path: str, *topics: str, signer: Signed | None = None, **replaced: str) -> bytes:
        """Signed permissions to publish these topics."""
        return signed_document(_text(path, *topics, **replaced), signer or self.permissions)


def _text(path: str, *topics: str, **replaced: str) -> bytes:
    text = PERMISSIONS.format(name=path).replace("rt/chatter", "</topic><topic>".join(topics))
    for old, new in replaced.items():
        text = text.replace(*{"end": ("2034", new), "start": ("2024", new)}[old])
    return text.encode()


@pytest.fixture(scope="module")
def fleet() -> Fleet:
    return Fleet()


def report(root: Path, **options: object) -> Report:
    return audit(root, Options(at=AT, engine="native", **options))  # type: ignore[arg-type]


def found(root: Path, **options: object) -> dict[str, Finding]:
    """The findings of KA66 by code, the worst of each."""
    findings = [finding for finding in report(root, **options).findings if finding.code.startswith("KA66")]
    return {finding.code: finding for finding in reversed(findings)}


Change = Callable[[Fleet, Path], None]


def kept(name: str, *topics: str, **replaced: str) -> Change:
    """Further permissions of the talker."""

    def change(fleet: Fleet, root: Path) -> None:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(fleet.document("/talker", *topics, **replaced))

    return change


def governance(fleet: Fleet, root: Path) -> None:
    (root / "test").write_bytes(signed_document(GOVERNANCE.replace(b"SIGN", b"NONE"), fleet.permissions))


def moved(path: str, start: str = "backup", **left_out: str) -> Change:
    """A further enclave, whose folder lies outside enclaves/; `left_out`: files that do not."""

    def change(fleet: Fleet, root: Path) -> None:
        other = fleet.robot(root.parent / "other", path)
        shutil.move(other / "enclaves" / path.strip("/"), root / start)
        for name in left_out.values():
            (root / start / name).unlink()

    return change


def unpacked(place: str) -> Change:
    """Another robot's keystore, of authorities that nobody trusts here."""
    return lambda _fleet, root: Fleet().robot(root / place).stat()


# --- permissions outside enclaves


def effective(root: Path, topic: str) -> str:
    question = Question(enclave="/talker", operation=Operation.PUBLISH, topic=topic, domain=0)
    answers = Access(root, [question], Circumstances(profiles=resolve(("spec",)), at=AT)).answers(question)
    return answers["spec"].accepted


UNREAD: dict[str, Callable[[bytes], bytes]] = {
    "a base64 line too short": lambda document: document.replace(b"MII", b"MI\nI", 1),
    "too large": lambda document: document + b"\n" * 4 * 1024 * 1024,
    "behind a letter": lambda document: b"Subject: your rights\n\n" + document,
}


@pytest.mark.parametrize("how", UNREAD)
def test_a_document_outside_enclaves_that_was_not_read_is_no_pass(how: str, fleet: Fleet, tmp_path: Path) -> None:
    root = fleet.robot(tmp_path / "robot")
    assert effective(root, "rt/other") == "deny"
    (root / "old").write_bytes(UNREAD[how](fleet.document("/talker", "rt/*")))
    assert effective(root, "rt/other") == "unknown"
    told = report(root)
    assert told.exit_code == 4
    assert {"KA305", "KA663"} & {each.code for each in told.findings if each.locations[0].path == "old"}


def test_an_enclave_s_own_document_in_der_was_not_read(fleet: Fleet, tmp_path: Path) -> None:
    root = fleet.robot(tmp_path / "robot")
    own = root / "enclaves/talker/permissions.p7s"
    taken = ["openssl", "smime", "-pk7out", "-outform", "DER", "-in", str(own)]
    own.write_bytes(subprocess.run(taken, capture_output=True, check=True).stdout)
    told = report(root)
    assert "KA304" in {each.code for each in told.findings}
    assert told.unread_foreign == ("enclaves/talker/permissions.p7s",)


# --- identities outside enclaves


def beside(root: Path, **options: object) -> dict[str | None, Severity]:
    """The severity of KA668 by file of the identity."""
    findings = [finding for finding in report(root, **options).findings if finding.code == "KA668"]
    return {finding.locations[0].path: finding.severity for finding in findings}


def test_whom_nobody_takes_or_who_is_known_already(fleet: Fleet, tmp_path: Path) -> None:
    root = fleet.robot(tmp_path / "robot")
    (root / "old").write_bytes(fleet.document("/gripper", "rt/*"))
    for place, made, severity in (
        ("expired", certificate("/gripper", fleet.identity, end=AT - timedelta(days=1)), None),
        ("stranger", certificate("/gripper", authority("identityCA")), None),
        ("signer", certificate("/gripper", fleet.permissions), None),
        ("renewed", certificate("/talker", fleet.identity), Severity.MEDIUM),
        ("valid", certificate("/gripper", fleet.identity), Severity.HIGH),
    ):
        (root / place).write_bytes(made.pem + made.key_pem)
        assert beside(root) == ({place: severity} if severity else {})
        (root / place).unlink()
    shutil.copy(root / "enclaves/talker/cert.pem", root / "copy")
    shutil.copy(root / "enclaves/talker/key.pem", root / "copy of key")
    assert beside(root) == {}


def test_without_join_access_control_no_grant_is_wanted(fleet: Fleet, tmp_path: Path) -> None:
    root = fleet.robot(tmp_path / "robot")
    made = certificate("/gripper", fleet.identity)
    (root / "spare").write_bytes(made.pem + made.key_pem)
    assert beside(root) == {}
    open_to_all = GOVERNANCE.replace(b"<enable_join_access_control>true", b"<enable_join_access_control>false")
    (root / "enclaves/talker/governance.p7s").write_bytes(signed_document(open_to_all, fleet.permissions))
    assert beside(root) == {"spare": Severity.HIGH}


def in_pem(made: Signed) -> bytes:
    return made.key_pem


def test_an_identity_that_could_not_be_read_is_no_pass(fleet: Fleet, tmp_path: Path) -> None:
    """Where peers would let in who has its key, and wherever nobody knows what the file holds."""
    password = BestAvailableEncryption(b"secret")
    for name, subject, content, code in (
        ("key.pem", "/gripper", "key", 4),
        ("key.pem", "/nobody", "key", 0),
        ("some.p12", "/nobody", "both", 0),
    ):
        root = fleet.robot(tmp_path / (subject + content).strip("/"))
        (root / "old").write_bytes(fleet.document("/gripper", "rt/*"))
        made = certificate(subject, fleet.identity)
        locked = made.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, password)
        both = serialize_key_and_certificates(None, made.key, made.certificate, None, password)
        (root / name).write_bytes(locked if content == "key" else both)
        if content == "key":
            (root / "spare").write_bytes(made.pem)
        findings = [finding for finding in report(root).findings if finding.code == "KA668"]
        assert [finding.severity for finding in findings] == [Severity.HIGH] * (code == 4)
        assert report(root).exit_code == code


def test_a_link_out_of_the_keystore_may_be_anything_whatever_its_name(fleet: Fleet, tmp_path: Path) -> None:
    for name in ("spare.crt", "spare.p7s", "spare.key", "spare.txt"):
        root = fleet.robot(tmp_path / name)
        (root / name).symlink_to("/etc/hostname")
        made = report(root)
        assert ({*beside(root)}, made.exit_code, made.unread_foreign) == ({name}, 4, (name,))


# --- what robots have beside their keys


def test_a_bag_beside_the_keys_is_no_fault_and_bars_a_statement_alone(fleet: Fleet, tmp_path: Path) -> None:
    root = fleet.robot(tmp_path / "robot")
    assert report(root).unread_foreign == ()
    (root / "drive.db3").write_bytes(b"SQLite format 3\0" + bytes(20_000_000))
    told = report(root)
    assert (told.exit_code, told.unread_foreign, [*found(root)]) == (0, ("drive.db3",), [])
    assert report(root, deployed=True).exit_code == 1
    (root / "drive.db3").write_bytes(b"log\n\n" + bytes(20_000_000) + in_pem(certificate("/gripper", fleet.identity)))
    assert report(root).exit_code == 4


def about(root: Path, path: Path) -> set[str]:
    place = str(path.relative_to(root))
    return {f.code for f in report(root).findings if place in {each.path for each in f.locations}}


def test_a_locked_key_of_an_authority_is_good_practice(fleet: Fleet, tmp_path: Path) -> None:
    root = fleet.robot(tmp_path / "robot")
    locked = fleet.identity.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(b"secret"))
    (root / "private").mkdir()
    (root / "private/ca.key.pem").write_bytes(locked)
    told = report(root)
    assert (told.exit_code, told.unread_foreign) == (0, ("private/ca.key.pem",))


# --- keystores in the keystore


def inside(root: Path) -> list[str | None]:
    """The places that KA669 names."""
    return [place.path for finding in report(root).findings if finding.code == "KA669" for place in finding.locations]


@pytest.mark.parametrize("place", ["robot2", "public/robot2", "private/old/robot2", "robot2/enclaves/robot3"])
def test_a_keystore_in_a_keystore_is_said_wherever_it_lies(place: str, fleet: Fleet, tmp_path: Path) -> None:
    root = fleet.robot(tmp_path / "robot")
    unpacked(place)(fleet, root)
    assert inside(root) == [place.removesuffix("/enclaves/robot3")]
    shutil.rmtree(root / place.partition("/")[0])
    assert inside(root) == []


@pytest.mark.parametrize(
    "name",
    ["cert.pem", "key.pem", "identity_ca.cert.pem", "permissions_ca.cert.pem", "governance.p7s", "permissions.p7s"],
)
def test_a_folder_is_an_enclave_whichever_file_is_missing(name: str, fleet: Fleet, tmp_path: Path) -> None:
    """Without a key or a certificate nobody can be started from it: no more than a finding."""
    root = fleet.robot(tmp_path / "robot")
    moved("/gripper")(fleet, root)
    assert (inside(root), report(root).exit_code) == (["backup"], 4)
    (root / "backup" / name).unlink()
    assert inside(root) == ["backup"]
    assert report(root).exit_code == (0 if name in ("cert.pem", "key.pem") else 4)


def test_what_the_same_run_audits_leaves_nothing_open(fleet: Fleet, tmp_path: Path) -> None:
    root = fleet.robot(tmp_path / "robot")
    unpacked("robot2")(fleet, root)
    (tmp_path / "way").symlink_to(root / "robot2")
    own = ("--engine", "native", "--at", INSTANT, "--quiet")
    assert answer("audit", root, *own)[0] == 4
    assert answer("audit", "-r", root, *own)[0] == 0
    assert answer("audit", root, tmp_path / "way", *own)[0] == 0
    assert answer("audit", root, fleet.robot(tmp_path / "other", "/camera"), *own)[0] == 4


def test_a_statement_is_about_what_its_own_report_judged(fleet: Fleet, tmp_path: Path) -> None:
    root = fleet.robot(tmp_path / "robot")
    unpacked("robot2")(fleet, root)
    (root / "robot20").write_bytes(b"")  # of another name
    governance = root / "enclaves/talker/governance.p7s"
    shared = root / "robot2/enclaves/governance.p7s"
    shared.write_bytes(governance.read_bytes())
    governance.unlink()
    governance.symlink_to("../../robot2/enclaves/governance.p7s")
    trusted = next(root.glob("robot2/**/identity_ca.cert.pem")).relative_to(root)
    (root / "public").mkdir()
    (root / "public/other.cert.pem").symlink_to(".." / trusted)
    alone = [name for name, _digest in report(root).files]
    statements = tmp_path / "out"
    own = ("--engine", "native", "--at", INSTANT, "--quiet", "-o", f"statement={statements}/")
    assert answer("audit", "-r", root, *own)[0] == 0
    said = {
        file.parent.name: [each["name"] for each in json.loads(file.read_bytes())["subject"]]
        for file in statements.rglob("*.statement.json")
    }
    below = "robot2/"
    linked = {"robot2/enclaves/governance.p7s", str(trusted)}
    assert said == {
        "out": [name for name in alone if not name.startswith(below) or name in linked],
        "robot2": [name.removeprefix(below) for name in alone if name.startswith(below)],
    }


def test_enclaves_of_an_older_layout_are_never_passed_over(fleet: Fleet, tmp_path: Path) -> None:
    """A keystore before Foxy, or an enclave's own folder, and a good enclaves/ laid beside what fails."""
    root = tmp_path / "robot"
    shutil.move(fleet.robot(tmp_path / "made", "/talker") / "enclaves", root)
    (root / "talker/permissions.p7s").write_bytes(fleet.document("/talker", "rt/a", signer=authority("permissionsCA")))
    (root / "ca.cert.pem").write_bytes(fleet.identity.pem)
    alone = tmp_path / "alone"
    shutil.copytree(root / "talker", alone)
    assert (report(root).exit_code, report(alone).exit_code) == (1, 1)
    for place, named in ((root, ["talker"]), (alone, ["."])):
        fleet.robot(place, "/listener")
        (place / "public").mkdir()
        assert (report(place).exit_code, inside(place)) == (4, named)
    (root / "talker/governance.p7s").unlink()
    assert (report(root).exit_code, inside(root)) == (4, ["talker"])


TOPICS = ("rt/a", "rt/b", "rt/c", "rt/d", "rt/dd", "other")
"""Names for every way in which the expressions differ."""

EXPRESSIONS = ("rt/a", "rt/b", "rt/c", "rt/[ab]", "rt/*", "rt/?", "rt/[!a]", "*")
SOME = st.lists(st.sampled_from(EXPRESSIONS), min_size=1, max_size=2, unique=True)


@settings(max_examples=12, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(own=SOME, old=SOME)
def test_wider_is_what_peers_take_only_with_the_old_document(
    own: list[str], old: list[str], fleet: Fleet, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Each name is asked for by itself, with and without the old document."""
    root = fleet.robot(tmp_path_factory.mktemp("keystores") / "robot", topics=tuple(own))
    before = {topic: effective(root, topic) for topic in TOPICS}
    kept("old", *old)(fleet, root)
    after = {topic: effective(root, topic) for topic in before}
    assert all(after[topic] == "allow" for topic, said in before.items() if said == "allow")
    beyond = any(said != before[topic] for topic, said in after.items())
    assert found(root)["KA660"].severity is (Severity.HIGH if beyond else Severity.LOW)


# --- several robots


def shared(*roots: Path) -> list[dict[str, str]]:
    """The severity of KA666 by message in the report of each."""
    _code, out = answer("audit", *roots, "--engine", "native", "--format", "json", "--at", INSTANT)
    reports = json.loads(out)["reports"]
    return [{f["severity"]: f["message"] for f in each["findings"] if f["code"] == "KA666"} for each in reports]


def behind_the_comparison(monkeypatch: pytest.MonkeyPatch, change: Callable[[], object]) -> None:
    """Before each keystore is audited, when all were compared."""

    def later(task: Task) -> Audited:
        change()
        return carry_out(task)

    monkeypatch.setattr(run, "carry_out", later)


def test_robots_share_keys_or_subjects_and_both_are_told(fleet: Fleet, tmp_path: Path) -> None:
    one, two = fleet.robot(tmp_path / "one"), fleet.robot(tmp_path / "two", "/other")
    assert shared(one, two) == [{}, {}]
    shutil.copytree(one / "enclaves/talker", two / "enclaves/talker")
    first, second = shared(one, two)
    assert (list(first), list(second)) == (["high"], ["high"])
    assert str(two) in first["high"]
    assert str(one) in second["high"]


@pytest.mark.parametrize("swapped", ["cert.pem", "identity_ca.cert.pem"])
def test_an_identity_that_changes_behind_the_comparison_is_no_pass(
    swapped: str, fleet: Fleet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever writes into a keystore while the run goes on: what was compared is not what is audited."""
    one, two = fleet.robot(tmp_path / "one", "/talker"), fleet.robot(tmp_path / "two", "/other")
    content = (one / "enclaves/talker/cert.pem").read_bytes() if swapped == "cert.pem" else Fleet().identity.pem

    def audited() -> tuple[int, list[str]]:
        code, out = answer("audit", one, two, "--engine", "native", "-f", "json", "--at", INSTANT)
        reports = json.loads(out)["reports"]
        return code, [f["message"] for each in reports for f in each["findings"] if f["code"] == "KA666"]

    assert audited() == (0, [])
    behind_the_comparison(monkeypatch, lambda: (two / "enclaves/other" / swapped).write_bytes(content))
    code, (message,) = audited()
    assert (code, "have changed since" in message) == (4, True)


def test_identities_that_could_not_be_read_once_are_no_pass(
    fleet: Fleet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where there were too many open files for a moment."""
    from keystore_audit.fleet import task

    one, two = fleet.robot(tmp_path / "one"), fleet.robot(tmp_path / "two", "/other")
    asked = ("audit", one, two, "--engine", "native", "--at", INSTANT)
    assert answer(*asked)[0] == 0

    def fails(_path: str) -> None:
        raise OSError(24, "Too many open files")

    monkeypatch.setattr(task, "read_identities", fails)
    assert answer(*asked)[0] == 4


def test_one_subject_counts_under_one_authority_alone(fleet: Fleet, tmp_path: Path) -> None:
    one, two = fleet.robot(tmp_path / "one"), fleet.robot(tmp_path / "two")
    stranger = Fleet().robot(tmp_path / "stranger")
    assert [list(each) for each in shared(one, two, stranger)] == [["medium"], ["medium"], []]


@pytest.mark.parametrize(
    ("subject", "severities"),
    [
        ("CN=/talker", ["medium"]),
        ("CN=/Talker", ["medium"]),
        ("CN=/ talker", []),
        ("CN=/talker,O=x", []),
    ],
)
def test_one_subject_in_other_letters_or_another_string_type_is_one(
    fleet: Fleet, tmp_path: Path, subject: str, severities: list[str]
) -> None:
    """Implementations compare the text; no two of these have the same DER."""
    one, two = fleet.robot(tmp_path / "one", "/talker"), fleet.robot(tmp_path / "two", "/talker")
    attributes = x509.Name.from_rfc4514_string(subject).rdns
    printable = [
        x509.RelativeDistinguishedName([x509.NameAttribute(each.oid, each.value, _ASN1Type.PrintableString)])
        for rdn in attributes
        for each in rdn
    ]
    (two / "enclaves/talker/cert.pem").write_bytes(certificate(x509.Name(printable), fleet.identity).pem)
    assert [list(each) for each in shared(one, two)] == [severities, severities]


@pytest.mark.parametrize("name", ["backup/key.pem", "notes.txt"])
def test_the_key_of_another_robot_in_a_file_of_no_enclave_is_told_in_both(
    name: str, fleet: Fleet, tmp_path: Path
) -> None:
    """No certificate lies beside it, so that no rule about one keystore alone speaks of it."""
    one, two = fleet.robot(tmp_path / "one"), fleet.robot(tmp_path / "two", "/arm", "/leg")
    (one / name).parent.mkdir(exist_ok=True)
    (one / name).write_bytes(certificate("/arm", fleet.identity).key_pem)
    assert shared(one, two) == [{}, {}]
    (one / name).write_bytes((two / "enclaves/arm/key.pem").read_bytes())
    first, second = shared(one, two)
    assert first["high"].startswith(f"'{name}' holds the identity key of /arm in '{two}':")
    assert second["high"].startswith(f"The identity key of /arm lies in '{one}', too, in '{name}':")


def test_the_keys_of_a_keystore_in_a_keystore_are_its_own(fleet: Fleet, tmp_path: Path) -> None:
    outer = fleet.robot(tmp_path / "one")
    inner = fleet.robot(outer / "spare", "/arm")
    assert shared(outer, inner) == [{}, {}]
    for name in ("early.pem", "unused.pem"):  # before and behind its own, by name
        shutil.copy(inner / "enclaves/arm/key.pem", outer / name)
        assert [list(each) for each in shared(outer, inner)] == [["high"], ["high"]]
        (outer / name).unlink()


def test_a_key_that_comes_to_lie_there_behind_the_comparison_is_no_pass(
    fleet: Fleet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, two = fleet.robot(tmp_path / "one"), fleet.robot(tmp_path / "two", "/arm")
    behind_the_comparison(monkeypatch, lambda: shutil.copy(two / "enclaves/arm/key.pem", one / "spare.pem"))
    assert answer("audit", one, two, "--engine", "native", "--at", INSTANT)[0] == 4


def test_an_identity_that_goes_behind_the_comparison_is_no_fault(
    fleet: Fleet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its key was found with another robot, and is nobody's here any more."""
    one, two = fleet.robot(tmp_path / "one"), fleet.robot(tmp_path / "two", "/arm", "/leg")
    shutil.copy(two / "enclaves/arm/key.pem", one / "spare.pem")
    behind_the_comparison(monkeypatch, lambda: shutil.rmtree(two / "enclaves/arm", ignore_errors=True))
    assert ["have changed since" in each.get("high", "") for each in shared(one, two)] == [False, True]


def test_a_keystore_named_twice_shares_nothing_with_itself(fleet: Fleet, tmp_path: Path) -> None:
    one = fleet.robot(tmp_path / "one")
    assert shared(one, one / ".", one) == [{}, {}, {}]


def test_a_fault_with_one_keystore_hides_no_other(
    fleet: Fleet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import keystore_audit.pipeline

    one, two = fleet.robot(tmp_path / "one"), fleet.robot(tmp_path / "two")
    really = keystore_audit.pipeline.read_keystore

    def fails(path: str, **more: object) -> object:
        if path == str(one):
            raise RuntimeError("-----BEGIN PRIVATE KEY-----")
        return really(path, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(keystore_audit.pipeline, "read_keystore", fails)
    code, out = answer("audit", one, two, "--engine", "native", "-f", "json", "--at", INSTANT)
    assert (code, [each["keystore"]["path"] for each in json.loads(out)["reports"]]) == (4, [str(two)])
    said = capsys.readouterr().err
    assert str(one) in said
    assert "A fault in keystore-audit itself" in said
    assert "PRIVATE" not in said


def test_a_year_is_not_too_long(fleet: Fleet, tmp_path: Path) -> None:
    root = fleet.robot(tmp_path / "robot", "/talker")
    own = certificate("/talker", fleet.identity, start=AT - timedelta(days=1), end=AT + timedelta(days=364))
    (root / "enclaves/talker/cert.pem").write_bytes(own.pem)
    (root / "enclaves/talker/key.pem").write_bytes(own.key_pem)
    assert "two years: 1 grant, the longest" in found(root, deployed=True)["KA665"].message
    (root / "enclaves/talker/permissions.p7s").write_bytes(
        fleet.document("/talker", "rt/chatter", start="2026", end="2027")
    )
    assert "KA665" not in found(root, deployed=True)


def test_what_nobody_can_start_hides_nothing_below_it(fleet: Fleet, tmp_path: Path) -> None:
    root = fleet.robot(tmp_path / "robot")
    moved("/gripper", "backup")(fleet, root)
    moved("/arm", "backup/old/arm")(fleet, root)
    assert (inside(root), report(root).exit_code) == (["backup"], 4)
    (root / "backup/key.pem").unlink()
    assert (inside(root), report(root).exit_code) == (["backup", "backup/old/arm"], 4)
