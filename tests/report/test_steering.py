"""What steers a terminal or the runner of a pipeline is in no format, wherever in a line it would stand."""

from __future__ import annotations

import io
import json
import re
import sys
from html import escape
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from keystore_audit.cli.program import run
from keystore_audit.formats import FORMATS
from keystore_audit.report.json import encoded
from tests.cli.keystores import document_of, grant_of, rule
from tests.keystore.builder import GOVERNANCE, authority, certificate, write_enclave

STEERING = re.compile(r"##[A-Za-z]*\[|::[A-Za-z]|[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]|\r(?!\n)")
"""Commands of Azure, TeamCity and GitHub, and what terminals obey."""

MARKERS = (
    "##vso[task.complete result=Succeeded]",
    "##[error]",
    "::error::",
    ":",
    "#",
    "::set-output name=x::",
    "\x1b[2J",
)
HOSTILE = (
    st.lists(st.sampled_from(MARKERS) | st.text("ab:#[] ", max_size=4), min_size=1, max_size=4)
    .map("".join)
    .filter(bool)
)

COMMANDS = (
    *(("audit", "KEYSTORE", "--engine", "native", "-v", "-f", kind) for kind in FORMATS),
    ("audit", "KEYSTORE", "--engine", "native", "-q"),
    *(("explain", code, "--for", "KEYSTORE") for code in ("KA119", "KA411", "KA706", "KA724")),
    *(("access", "KEYSTORE", "-f", kind) for kind in ("text", "json", "csv")),
    *(("diff", "KEYSTORE", "OTHER", "-f", kind) for kind in ("text", "json", "markdown")),
    *(("flow", "KEYSTORE", "ENCLAVE", "/b", "-f", kind) for kind in ("text", "json")),
    *(("can", "KEYSTORE", "ENCLAVE", "publish", "TOPIC", "--kind", "dds", "-f", kind) for kind in ("text", "json")),
)


def keystore(root: Path, name: str, topic: str) -> Path:
    """One whose enclave, subject, authority and topics are called so."""
    printable = "".join(each for each in name if each.isprintable())
    identity, permissions = authority(name[:60]), authority(f"{name[:50]}p")
    for path in (f"/{printable[:40]}", "/b"):
        document = document_of(grant_of(escape(path), rule((topic,), (topic,))))
        directory = root / "enclaves" / path.strip("/")
        write_enclave(directory, certificate(path, identity), document, identity, permissions, GOVERNANCE)
    (root / "enclaves" / f"{name[:40].replace('/', '')}.pem").write_text("no key")
    return root


def written(words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> str:
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2))
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", out)
        patch.setattr(sys, "stderr", err)
        run([*words])
        for stream in (out, err):
            stream.flush()
    return b"".join(stream.buffer.getvalue() for stream in (out, err)).decode()  # type: ignore[attr-defined]


@settings(max_examples=3, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@example(name="##vso[task.complete result=Succeeded]", topic="a::error::b")
@example(name="::error::x", topic="##[error]x##teamcity[x]")
@example(name=":::a###[b\x1b]0;x\x07", topic=":")
@given(name=HOSTILE, topic=HOSTILE)
def test_no_format_has_any(
    name: str, topic: str, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path_factory.mktemp("steering")
    plain = "".join(each for each in topic if each.isprintable()).strip() or "x"
    root, other = keystore(folder / "k", name, plain), keystore(folder / "o", "a", "rt/other")
    enclave = f"/{''.join(each for each in name if each.isprintable())[:40]}"
    given_words = {"KEYSTORE": str(root), "OTHER": str(other), "ENCLAVE": enclave, "TOPIC": plain}
    for command in COMMANDS:
        said = written(tuple(given_words.get(word, word) for word in command), monkeypatch)
        said = re.sub("<style>.*?</style>", "", said, flags=re.DOTALL)  # our own, `::before` in it
        found = STEERING.search(said)
        assert found is None, (command, said[max(0, found.start() - 80) : found.end() + 40])


@given(st.recursive(HOSTILE | st.text(), lambda inner: st.lists(inner) | st.dictionaries(HOSTILE, inner), max_leaves=5))
def test_json_says_the_same_without_them(value: object) -> None:
    text = encoded(value)
    assert "##" not in text
    assert "::" not in text
    if not re.search("[\ud800-\udfff]", json.dumps(value, ensure_ascii=False)):
        assert json.loads(text) == value
