"""Where we say that a document has one meaning, the vendors' own plugins give it that meaning, or a named reason.

Cyclone DDS 0.10 decides by the letter of DDS-Security 1.1, 9.4.1.2 and 9.4.1.3; Fast DDS 2.9 in its own way, which
`decisions.by_fastdds` says. Both are started with real keys and signatures and asked what /talker may do.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from hypothesis import given, settings
from hypothesis import strategies as st

from keystore_audit.keystore import grammar
from keystore_audit.keystore.typed import Governance, Permissions
from tests.amount import tried
from tests.keystore.builder import Signed, signed_document, sros2
from tests.oracles.xml import ours, policy
from tests.oracles.xml.corpus import DOCUMENTS, kind_of
from tests.oracles.xml.decisions import by_fastdds, by_the_letter, holds, joins
from tests.oracles.xml.measure import DECIDED, MEASURED, TOPICS, decided
from tests.oracles.xml.mutation import documents
from tests.oracles.xml.plugins import Plugin
from tools.samples.expectation import audit_directory

pytestmark = pytest.mark.xdist_group("xml-oracle")

LARGEST_DOMAIN = 230
"""Of Cyclone DDS 0.10: a larger one and the file is refused."""


@pytest.mark.parametrize("vendor", ["cyclone", "fastdds"])
def test_the_plugins_answer_as_measured(plugins: dict[str, Plugin], vendor: str) -> None:
    table: dict[str, dict[str, str]] = json.loads(DECIDED.read_text())
    expected = {title: answers[vendor] for title, answers in table.items()}
    assert {title: decided(plugins[vendor], document) for title, document in DOCUMENTS.items()} == expected


@pytest.mark.parametrize("family", ["healthy", "stock"])
def test_sound_samples_start_on_cyclone(plugins: dict[str, Plugin], repository: Path, family: str) -> None:
    enclaves = [path.parent for path in (repository / "sample_keystores" / family).rglob("permissions.p7s")]
    refused = {enclave: plugins["cyclone"].ask_enclave(enclave).refused for enclave in enclaves}
    assert len(enclaves) >= 10
    assert {enclave: why for enclave, why in refused.items() if why is not None} == {}


@pytest.mark.parametrize("rule", ["empty-topic-expression", "rule-without-domains"])
def test_what_the_samples_say_crashes_cyclone_does(plugins: dict[str, Plugin], repository: Path, rule: str) -> None:
    (keystore,) = (repository / "sample_keystores" / "rules").glob(f"KA*-{rule}")
    refused = [plugins["cyclone"].ask_enclave(path.parent).refused for path in keystore.rglob("permissions.p7s")]
    assert "crash" in refused, "the bad one"
    assert None in refused, "the good one"


REFUSED = {
    ("range without minimum", "cyclone"): "KA515 critical",  # crashes
    ("range without maximum", "cyclone"): "KA515 medium",  # its minimum alone, which is not domain 0
    ("range without minimum in the governance", "cyclone"): "KA419 medium",
    ("domain 231", "cyclone"): "KA420 high",
    ("domain 231 in the governance", "cyclone"): "KA420 high",
    ("hour 24", "cyclone"): "KA612 high",  # counts as expired
    ("hour 24", "fastdds"): "KA612 high",  # malformed
    ("time zone far east", "cyclone"): "KA612 high",  # offsets beyond 12 hours count as expired
    ("year beyond 64 bits of nanoseconds", "cyclone"): "KA612 high",  # counts as expired
    ("year of five digits", "cyclone"): "KA502 high",
    ("year of five digits", "fastdds"): "KA502 high",
    ("year before 1", "fastdds"): "KA502 high",
}
"""Documents whose form has one meaning and that an implementation does not take all the same, with what an audit says
(None: nothing was said when this was written)."""

_ANOTHER_SUBJECT = ("146: Subject name is invalid", "permissions: Not found the identity subject name")
_ALTERED_BY_THE_SIGNER = ("127: Failed to parse PKCS7", "permissions: Failed verification")  # a lone carriage return


def test_what_has_one_meaning_is_refused_for_named_reasons_alone() -> None:
    meaning = {title for title, reading in json.loads(MEASURED.read_text()).items() if reading["ours"] == "one meaning"}
    table: dict[str, dict[str, str]] = json.loads(DECIDED.read_text())
    taken = ("rt/chatter ", *_ANOTHER_SUBJECT, *_ALTERED_BY_THE_SIGNER)
    answers = {(title, vendor): answer for title in meaning for vendor, answer in table[title].items()}
    assert {case for case, answer in answers.items() if not answer.startswith(taken)} == set(REFUSED)


@pytest.mark.parametrize(("title", "said"), sorted({(title, said) for (title, _), said in REFUSED.items() if said}))
def test_what_is_refused_is_a_finding(title: str, said: str, tmp_path: Path) -> None:
    root = sros2(tmp_path / "keystore", ("/talker",))
    key = load_pem_private_key((root / "private/ca.key.pem").read_bytes(), None)
    assert isinstance(key, ec.EllipticCurvePrivateKey)
    authority = Signed(key, x509.load_pem_x509_certificate((root / "public/ca.cert.pem").read_bytes()))
    document = DOCUMENTS[title]
    where = "governance" if kind_of(document) is ours.DocumentKind.GOVERNANCE else "talker/permissions"
    (root / f"enclaves/{where}.p7s").write_bytes(signed_document(document, authority))
    findings = audit_directory(root, at="2026-01-01T00:00:00Z")["findings"]
    assert said in {finding.rsplit(" ", 2)[0] for finding in findings}, findings


def set_aside(typed: Governance | Permissions) -> bool:
    """What either is known to refuse or to read in its own way (facts, dds-semantics 1.3 to 1.6)."""
    if isinstance(typed, Permissions):
        grant = typed.grants[0]
        domains = [entry for rule in grant.rules for entry in rule.domains]
        expressions = [text.text for rule in grant.rules for criterion in rule.criteria for text in criterion.topics]
        dates = (grant.not_before.text[:4], grant.not_after.text[:4])
        named = len(typed.grants) == 1 and grant.subject_name.text == "CN=/talker"
        usual = named and "2000" <= dates[0] <= "2026" and "2027" <= dates[1] <= "2261"
        zone = any(len(text) > len("2024-01-01T00:00:00") for text in (grant.not_before.text, grant.not_after.text))
        if not usual or zone or "T24" in grant.not_before.text + grant.not_after.text:
            return True
    else:
        domains = [entry for rule in typed.domain_rules for entry in rule.domains]
        expressions = [rule.expression.text for each in typed.domain_rules for rule in each.topic_rules]
        if not any(holds(rule.domains, 0) for rule in typed.domain_rules):
            return True
    beyond = any(max(entry.low or 0, entry.high or 0) > LARGEST_DOMAIN for entry in domains)
    half_open = any(entry.low is None or entry.high is None for entry in domains)
    own_matching = any(sign in text for text in expressions for sign in "[\\") or not all(map(str.isascii, expressions))
    return beyond or half_open or own_matching


def assert_decided_as_written(plugins: dict[str, Plugin], document: bytes) -> bool:
    """Whether it was asked of them: only with one meaning, and none of the reasons to set a document aside."""
    if document.count(b"\r") != document.count(b"\r\n"):
        return False  # what signs here for us alters it: the signature is of another text
    reading = ours.read(document, kind_of(document))
    if reading is None or reading.typed is None or reading.kinds or set_aside(reading.typed):
        return False
    cyclone = plugins["cyclone"]
    answer = cyclone.ask(cyclone.sign(document), kind_of(document), *TOPICS)
    if isinstance(reading.typed, Permissions) and not joins(reading.typed.grants[0]):
        assert answer.refused == "145: participant denied by default rule"
    else:
        assert answer.refused is None
        assert answer.topics == {topic: by_the_letter(reading.typed, topic) for topic in TOPICS}
    fastdds = plugins["fastdds"]
    answer = fastdds.ask(fastdds.sign(document), kind_of(document), *TOPICS)
    if isinstance(reading.typed, Permissions) and not any(rule.allow for rule in reading.typed.grants[0].rules):
        assert answer.refused == "participant: Not found a rule allowing to use the domain_id"
        return True
    assert answer.refused is None
    assert answer.topics == {topic: by_fastdds(reading.typed, topic) for topic in TOPICS}
    return True


@settings(max_examples=tried(700))
@given(document=st.one_of(policy.permissions(), policy.governance()))
def test_competing_rules_are_decided_as_written(plugins: dict[str, Plugin], document: bytes) -> None:
    if not assert_decided_as_written(plugins, document):
        assert b"<domain_rule>" in document, "only a governance without domain 0 is set aside"


def test_no_change_makes_a_plugin_decide_otherwise(plugins: dict[str, Plugin]) -> None:
    asked: list[bool] = []

    @settings(max_examples=tried(900))
    @given(document=documents())
    def search(document: bytes) -> None:
        asked.append(assert_decided_as_written(plugins, document))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(grammar, "MAX_EXPLAINED_BYTES", 0)  # whether a document is valid, not why
        search()
    assert sum(asked) >= tried(30)
