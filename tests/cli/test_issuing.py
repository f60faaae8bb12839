"""An enclave whose key is that of an identity CA issues itself the identity of whomever a grant names."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.keystores import AT, answer, document_of, grant_of, properties, rule
from tests.keystore.builder import GOVERNANCE, authority, certificate, write_enclave

ENCLAVES = {"/a": rule(("rt/x",)), "/b": rule((), ("rt/y",)), "/c": rule(("rt/y",))}
SETTINGS = """[[property]]
name = "only"
only_publish = { topic = "/y", enclaves = "/c" }
[[property]]
name = "secret"
encrypted = { topic = "/y", against = "insider" }
"""
FIRST_ALONE = {"cyclonedds-0.10", "cyclonedds-11"}
"""They take the first certificate of a CA file alone."""


def written(root: Path, holder: str) -> Path:
    """Each CA file also holds an authority with the key of `holder`, or one of its own."""
    ca, permissions = authority("identityCA"), authority("permissionsCA")
    own = {path: certificate(path, ca) for path in ENCLAVES}
    key = own[holder].key if holder else None
    both = ca.pem + certificate("otherCA", ca, key=key, ca=True).pem
    for path, rules in ENCLAVES.items():
        document = document_of(grant_of(path, rules))
        directory = root / "enclaves" / path.strip("/")
        write_enclave(directory, own[path], document, ca, permissions, GOVERNANCE)
        (directory / "identity_ca.cert.pem").write_bytes(both)
    return root


@pytest.mark.parametrize("engine", ["native", "both"])
@pytest.mark.parametrize(("holder", "code"), [("", 0), ("/c", 0), ("/a", 1)])
def test_it_sends_where_another_may(tmp_path: Path, holder: str, code: int, engine: str) -> None:
    root = written(tmp_path / "keys", holder)
    found, text = answer("flow", root, "/a", "/b", "--at", AT, "--engine", engine, "--profile", "spec")
    assert found == code
    assert ("it can issue itself any identity that a grant names" in " ".join(text.split())) == (code == 1)


def test_it_publishes_and_reads_what_is_granted_to_others(tmp_path: Path) -> None:
    apart, one = (properties(written(tmp_path / f"of{holder}", holder), SETTINGS) for holder in ("", "/a"))
    for name in ("only", "secret"):
        told = one[name]["profiles"]
        assert apart[name]["status"] == "holds"
        assert {profile for profile, each in told.items() if each["status"] == "violated"} == told.keys() - FIRST_ALONE
