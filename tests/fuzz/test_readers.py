"""Every reader on generated input, and whole keystores: nothing raises, nothing vanishes, the same answer each time."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime, timezone
from pathlib import Path
from urllib.parse import unquote_to_bytes

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from keystore_audit.errors import NothingToAudit
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.grammar import Grammar
from keystore_audit.keystore.keystore import Keystore, read_keystore
from keystore_audit.keystore.layout import LayoutKind, Role
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.report import json as json_report
from tests.amount import tried
from tests.fuzz.targets import MAX_STEPS, READERS
from tests.steps import steps
from tests.strategies.credentials import pem_files
from tests.strategies.documents import documents
from tests.strategies.messages import messages, structures
from tests.strategies.mutations import edited, seeds
from tests.strategies.trees import RUN_TIME, Entry, make, trees

AT = datetime(2025, 6, 1, tzinfo=timezone.utc)


def _documents(grammar: Grammar) -> st.SearchStrategy[bytes]:
    made = documents(grammar).map(lambda tree: tree.xml())
    return st.one_of(made, edited(made), edited(seeds(grammar.value)), edited(seeds("xml")))


INPUTS: Mapping[str, tuple[st.SearchStrategy[bytes], int]] = {
    "certificate": (pem_files("certificate"), 300),
    "crl": (pem_files("crl"), 150),
    "private_key": (pem_files("private_key"), 150),
    "pem": (st.one_of(pem_files("pem"), st.binary()), 300),
    "mime": (messages(), 300),
    "cms": (structures(), 400),
    "smime": (messages(), 300),
    "xml": (_documents(Grammar.PERMISSIONS), 150),
    "governance": (_documents(Grammar.GOVERNANCE), 150),
    "permissions": (_documents(Grammar.PERMISSIONS), 150),
}
"""Strategy and number of examples for each target."""


@pytest.mark.parametrize("target", READERS)
def test_reader(target: str) -> None:
    strategy, count = INPUTS[target]

    @settings(max_examples=count, suppress_health_check=list(HealthCheck))
    @given(strategy)
    def check(data: bytes) -> None:
        steps(lambda: READERS[target](data), most=MAX_STEPS)

    check()


@contextmanager
def _directory() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder).resolve() / "keystore"
        path.mkdir()
        yield path


def _keystore(path: Path) -> Keystore | None:
    try:
        return read_keystore(path)
    except NothingToAudit:
        return None


@settings(max_examples=tried(200), suppress_health_check=list(HealthCheck))
@given(trees())
def test_tree(tree: Mapping[bytes, Entry]) -> None:
    with _directory() as root:
        make(tree, root)
        keystore, again = _keystore(root), _keystore(root)
        if keystore is None or again is None:
            assert keystore is again
            return
        assert (keystore.digest, repr(keystore.layout)) == (again.digest, repr(again.layout))
        for enclave in keystore.enclaves:
            assert set(enclave.files.files) == set(Role)
            _complete(root, enclave.files.files.values())
        if keystore.layout.kind is LayoutKind.SROS2:
            found = {enclave.files.directory for enclave in keystore.enclaves}
            assert found >= set(_expected(root))
        places = [each.file.place for each in keystore.authorities] + [
            each.file.place for each in keystore.authority_keys
        ]
        assert not [place for place in places if place.startswith(("/", "../"))]


def _complete(root: Path, files: Iterable[File]) -> None:
    """Every file under a name that means something is read, or something says why not."""
    for file in files:
        path = os.fsencode(root) + b"/" + unquote_to_bytes(file.path)
        if file.status is Status.PRESENT:
            with open(path, "rb") as stream:
                assert file.sha256 == hashlib.sha256(stream.read()).hexdigest()
            assert os.path.realpath(path).startswith(os.fsencode(root) + b"/")
        else:
            assert file.detail
            assert not (os.path.isfile(path) and not os.path.islink(path)), file


def _expected(root: Path) -> Iterator[str]:
    """The directories below enclaves/ that hold a file of the run time's, by the standard library."""
    names = {os.fsdecode(name) for name in RUN_TIME}
    for directory, _, files in os.walk(root / "enclaves"):
        here = os.path.relpath(directory, root)
        if here != "enclaves" and names & set(files) and here.isascii() and here.isprintable() and "%" not in here:
            yield here


SAMPLE = Path(__file__).parents[2] / "sample_keystores/healthy/talker_listener"
CHANGED = ("cert.pem", "key.pem", "permissions.p7s", "governance.p7s", "identity_ca.cert.pem", "crl.pem")
KINDS: Mapping[str, Callable[[], st.SearchStrategy[bytes]]] = {
    "cert.pem": lambda: pem_files("certificate"),
    "identity_ca.cert.pem": lambda: pem_files("certificate"),
    "key.pem": lambda: pem_files("private_key"),
    "crl.pem": lambda: pem_files("crl"),
    "permissions.p7s": messages,
    "governance.p7s": messages,
}


@st.composite
def _changes(draw: st.DrawFn) -> tuple[str, bytes]:
    name = draw(st.sampled_from(CHANGED))
    own = (SAMPLE / "enclaves/talker" / name).read_bytes() if name != "crl.pem" else b""
    return name, draw(st.one_of(edited(st.just(own)), KINDS[name]()))


@settings(max_examples=tried(60), suppress_health_check=list(HealthCheck))
@given(_changes())
def test_audit(change: tuple[str, bytes]) -> None:
    """One file of a healthy keystore changed: the audit ends with a report, and no rule of it crashes."""
    name, data = change
    with _directory() as root:
        shutil.copytree(SAMPLE, root, symlinks=True, dirs_exist_ok=True)
        (root / "enclaves/talker" / name).unlink(missing_ok=True)
        (root / "enclaves/talker" / name).write_bytes(data)
        options = Options(at=AT, at_given=True, engine="native")
        report = audit(root, options)
        shown = json_report.render(report)
        assert shown == json_report.render(audit(root, options))
    assert report.exit_code in (0, 1, 4)
    codes = {finding.code for finding in report.findings}
    assert "KA905" not in codes, "a rule crashed"
    assert json.loads(shown)["exit_code"] == report.exit_code
    assert {entry.path for entry in report.enclaves} == {"/talker", "/listener"}
    listener = {each for each in report.outcomes if each.subject == "/listener" and each.rule.startswith("KA1")}
    assert len(listener) > 5
