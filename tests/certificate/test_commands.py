"""`prove` and `check` on the command line."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from keystore_audit import pipeline
from keystore_audit.cli.program import run
from keystore_audit.pipeline import audit
from keystore_audit.report.content import Report
from tests.certificate.test_checker import IDENTITY, by_hand, store
from tests.certificate.test_checker import RIGHTS as RIGHTS_CA
from tests.keystore.builder import certificate, write
from tests.keystore.documents import allow, domain_rule, governance, grant, sub, topic_rule
from tests.schemas import schema

AT = ("--at", "2026-11-21T12:00:00Z")
HOLDS = ("no-flow", "/a", "/b")

Runs = Callable[..., tuple[int, str]]


@pytest.fixture
def runs(capsys: pytest.CaptureFixture[str]) -> Runs:
    """Exit code and what is printed, on both streams."""

    def runs(*words: str | Path) -> tuple[int, str]:
        code = run([*map(str, words), *AT])
        written = capsys.readouterr()
        assert "Traceback" not in written.err
        return code, written.out + written.err

    return runs


def test_what_prove_writes_check_accepts(tmp_path: Path, runs: Runs) -> None:
    root, file = store(tmp_path / "store"), tmp_path / "proof.json"
    assert runs("prove", root, *HOLDS, "-o", file) == (0, f"proved: {file}\n")
    content = file.read_bytes()
    schema("certificate").validate(json.loads(content))
    assert runs("prove", root, *HOLDS, "-o", file)[0] == 0
    assert file.read_bytes() == content
    assert runs("check", file, root, *HOLDS) == (0, "accepted\n")
    code, said = runs("check", file, root, "no-flow", "/c", "/b")
    assert (code, said) == (1, "refused: the certificate is about another property\n")
    code, said = runs("check", file, root, *HOLDS, "--profile", "spec")
    assert code == 1
    assert "implementation" in said
    (root / "enclaves" / "notes.txt").write_text("x")
    code, said = runs("check", file, root, *HOLDS)
    assert code == 4
    assert said == "cannot tell: enclaves/notes.txt is no file that the checker knows\n"


def test_a_certificate_of_another_store_is_refused(tmp_path: Path, runs: Runs) -> None:
    file = tmp_path / "proof.json"
    assert runs("prove", store(tmp_path / "one"), *HOLDS, "-o", file)[0] == 0
    code, said = runs("check", file, store(tmp_path / "other", b=grant("/b", allow(sub("rt/x")))), *HOLDS)
    assert code == 1
    assert said.startswith("refused: ")


def test_where_there_is_a_flow_it_is_shown_and_nothing_written(tmp_path: Path, runs: Runs) -> None:
    root, file = store(tmp_path / "store"), tmp_path / "proof.json"
    code, said = runs("prove", root, "no-flow", "/a", "/c", "-o", file)
    assert code == 1
    assert "/a -> /x (domain 0) -> /c" in said
    assert not file.exists()


def test_where_the_checker_cannot_follow_nothing_is_written(tmp_path: Path, runs: Runs) -> None:
    root, file = store(tmp_path / "store", c=grant("/c", allow(sub("rt/[x]")))), tmp_path / "proof.json"
    code, said = runs("prove", root, *HOLDS, "-o", file)
    assert code == 4
    assert "The checker cannot follow" in said
    assert not file.exists()


def test_authorities_are_those_of_the_command_line(tmp_path: Path, runs: Runs) -> None:
    root, file, pem = store(tmp_path / "store"), tmp_path / "proof.json", tmp_path / "ca.pem"
    pem.write_bytes(IDENTITY.pem)
    trusted = f"sha256:{hashlib.sha256(RIGHTS_CA.der).hexdigest()}"
    expected = ("--expect-identity-ca", pem, "--expect-permissions-ca", trusted)
    assert runs("prove", root, *HOLDS, "-o", file, *expected)[0] == 0
    assert runs("check", file, root, *HOLDS, *expected)[0] == 0
    assert runs("check", file, root, *HOLDS, "--expect-identity-ca", trusted)[0] == 1


RIGHTS = [
    (("only-publish", "/x", "/a"), ("only-publish", "/x", "/c"), "/a may publish /x (topic) in domain 0 too"),
    (
        ("only-publish", "dds:rt/x", "/a*", "/b"),
        ("only-publish", "/x", "/b", "/c"),
        "/a may publish /x (topic) in domain 0 too",
    ),
    (
        ("encrypted", "/x", "insider"),
        ("encrypted", "/y", "insider"),
        "/a can read /y (topic) in domain 0, but has no right to",
    ),
    (("encrypted", "/x", "outsider"), ("encrypted", "/y", "outsider"), "Anybody on the network can read /y (topic)"),
]
"""What holds, what does not, and how."""


@pytest.mark.parametrize(("holds", "violated", "how"), RIGHTS)
def test_rights_are_proved_and_checked(
    tmp_path: Path, runs: Runs, holds: tuple[str, ...], violated: tuple[str, ...], how: str
) -> None:
    clear = topic_rule("rt/y", read=False, metadata="NONE", data="NONE")
    root, file = store(tmp_path / "store", governance(domain_rule(clear, topic_rule("*")))), tmp_path / "proof.json"
    assert runs("prove", root, *violated, "-o", file)[0] == 1
    assert not file.exists()
    assert how in " ".join(runs("prove", root, *violated, "-o", file)[1].split())
    assert runs("prove", root, *holds, "-o", file)[0] == 0
    schema("certificate").validate(json.loads(file.read_bytes()))
    assert runs("check", file, root, *holds) == (0, "accepted\n")
    assert runs("check", file, root, *violated)[0] == 1
    code, said = runs("check", file, root, *holds, "--attacker", "honest")
    assert code == 2
    assert f"--attacker says nothing about {holds[0]}" in said


WRONG = [
    ("no-flow", "/a"),
    ("flow", "/a", "/b"),
    ("no-flow", "/a", "/b", "/c"),
    ("only-publish", "/x"),
    ("only-publish", "/x", "outsider"),
    ("only-publish", "/x", "/a", "topic:/x"),
    ("encrypted", "/x", "relays"),
    ("encrypted", "/x"),
]


@pytest.mark.parametrize("words", WRONG)
def test_other_properties_are_wrong_usage(tmp_path: Path, runs: Runs, words: tuple[str, ...]) -> None:
    code, said = runs("prove", store(tmp_path / "store"), *words, "-o", tmp_path / "proof.json")
    assert code == 2
    assert "no-flow FROM TO" in said


@pytest.mark.parametrize("words", [("only-publish", "x", "/a"), ("no-flow", "a", "/b"), ("only-publish", "/x", "a")])
def test_what_is_no_place_is_wrong_usage(tmp_path: Path, runs: Runs, words: tuple[str, ...]) -> None:
    code, said = runs("check", tmp_path, store(tmp_path / "store"), *words)
    assert code == 2
    assert "expected" in said


def test_a_certificate_written_by_hand_fits_the_schema(tmp_path: Path) -> None:
    schema("certificate").validate(by_hand(store(tmp_path)))


def test_a_statement_names_the_certificates_that_the_checker_accepts(tmp_path: Path, runs: Runs) -> None:
    root, proof, said = store(tmp_path / "store"), tmp_path / "proof.json", tmp_path / "statement.json"
    property_ = ("only-publish", "/x", "/a")
    assert runs("prove", root, *property_, "-o", proof)[0] == 0
    native = ("--engine", "native", "-q", "-o", f"statement={said}")
    assert runs("audit", root, *native, "--certificate", proof, " ".join(property_))[0] == 0
    predicate = json.loads(said.read_bytes())["predicate"]
    digest = hashlib.sha256(proof.read_bytes()).hexdigest()
    assert predicate["configuration"] == [{"name": str(proof), "digest": {"sha256": digest}}]
    assert predicate["keystoreAudit"]["stated"] == [f"{proof} (SHA-256 {digest}) proves only-publish /x /a."]


def test_a_certificate_of_files_that_were_changed_after_the_audit_is_an_error(
    tmp_path: Path, runs: Runs, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, proof = store(tmp_path / "store"), tmp_path / "proof.json"
    assert runs("prove", root, "only-publish", "/x", "/a", "-o", proof)[0] == 0
    words = ("audit", root, "--engine", "native", "-q", "--certificate", proof, "only-publish /x /a")
    assert runs(*words)[0] == 0

    def then_changed(*asked: Any, **given: Any) -> Report:
        report = audit(*asked, **given)
        renewed = certificate("/b", IDENTITY)
        write(root / "enclaves" / "b", {"cert.pem": renewed.pem, "key.pem": renewed.key_pem})
        return report

    monkeypatch.setattr(pipeline, "audit", then_changed)
    code, told = runs(*words)
    assert code == 2
    assert "changed meanwhile" in told


UNPROVED = [
    ("another property", ("only-publish /x /b",), "about another property"),
    ("another scope", ("only-publish /x /a", "--profile", "spec"), "one compartment for each implementation"),
    ("another authority", ("only-publish /x /a", "--expect-identity-ca", f"sha256:{'0' * 64}"), "not the authority"),
    ("no property", ("only-publish /x",), "Expected the property as"),
    ("a mixed fleet", ("only-publish /x /a", "--settings", "fleet.toml"), "of a mixed fleet"),
    ("several keystores", ("only-publish /x /a", "--recursive"), "name one KEYSTORE"),
]


@pytest.mark.parametrize(("words", "why"), [each[1:] for each in UNPROVED], ids=[each[0] for each in UNPROVED])
def test_a_certificate_that_does_not_prove_it_is_an_error(
    tmp_path: Path, runs: Runs, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], why: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("fleet.toml").write_text('[enclaves."/a"]\nrmw = "cyclonedds"\n')
    root, proof, said = store(tmp_path / "store"), tmp_path / "proof.json", tmp_path / "statement.json"
    assert runs("prove", root, "only-publish", "/x", "/a", "-o", proof)[0] == 0
    code, told = runs("audit", root, "--engine", "native", "-o", f"statement={said}", "--certificate", proof, *words)
    assert code == 2
    assert why in told
    assert not said.exists()
