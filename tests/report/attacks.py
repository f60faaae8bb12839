"""A keystore whose enclaves, topics and authorities are called like attacks on whatever shows them."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from pathlib import Path

from tests.cli.keystores import document_of, grant_of, rule
from tests.keystore.builder import GOVERNANCE, authority, certificate, write_enclave

PAYLOADS = (
    "<script>document.title='executed'</script>",
    "<img src=x onerror=document.title='executed'>",
    "\"><svg onload=document.title='executed'>",
    "' onmouseover='document.title=1' autofocus onfocus='document.title=1",
    "</style><style>*{display:none}</style>",
    "</title></head><body onload=document.title='executed'>",
    "]]><script>document.title='executed'</script>",
    "<!-- --!><script>document.title='executed'</script>",
    "javascript:document.title='executed'",
    "<a href=javascript:document.title='executed'>x</a>",
    "<base href=http://example.invalid/><link rel=stylesheet href=s.css>",
    "<meta http-equiv=refresh content='0;url=http://example.invalid/'>",
    "<iframe srcdoc=\"<script>parent.document.title='executed'</script>\"></iframe>",
    "</code></svg></table><math><mtext><script>document.title='executed'</script>",
    "url(http://example.invalid/x);}*{background:url(http://example.invalid/y)}",
    "{{constructor.constructor('document.title=1')()}}",
    "&lt;script&gt;&#60;script&#62;",
    "\u202egnp.exe\u2066",
    "\x00\x1b]0;owned\x07",
    "\udcff\udc80",
)

MAX_SUBJECT = 60
"""Bytes of an enclave's name: a common name has 64 characters at most."""


def attacks(root: Path) -> Path:
    """An enclave for each payload that XML and a file system can hold; it publishes that, and hears all the others."""
    printable = [payload for payload in PAYLOADS if payload.isprintable()]
    topics = tuple(f"rt/{payload}" for payload in printable)
    made = {}
    for number, payload in enumerate(printable):
        name = payload.replace("/", "\u2215").encode()[:MAX_SUBJECT].decode("utf-8", "ignore")  # a slash is a directory
        made[f"/{number % 10}{name}"] = (rule((topics[number],), topics),)
    return _keystore(root, made)


def _keystore(root: Path, enclaves: Mapping[str, tuple[str, ...]]) -> Path:
    """Subjects stand in documents as text, and in certificates as they are."""
    identity, permissions = authority("<b onclick=x>identity</b>"), authority("</code>permissions")
    for path, rules in enclaves.items():
        document = document_of(grant_of(escape(path), *rules))
        directory = root / "enclaves" / path.strip("/")
        write_enclave(directory, certificate(path, identity), document, identity, permissions, GOVERNANCE)
    return root
