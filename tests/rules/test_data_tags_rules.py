"""KA638: rules that are limited to data tags; one change makes the rule speak."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from keystore_audit.findings import Finding, Severity
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.permissions import Rule
from keystore_audit.rules import BY_CODE
from keystore_audit.rules.judge import judge
from tests.rules.divergent import ruled, talking
from tests.rules.evidence import context


def spoken(store: Keystore) -> tuple[Finding, ...]:
    return judge(context(store), [BY_CODE["KA638"]]).findings


def tagged(rule: Rule) -> Rule:
    return replace(rule, criteria=tuple(replace(each, data_tags=True) for each in rule.criteria))


MAP = ruled(publish=[(["rt/map"], None)])
CASES: dict[str, tuple[Keystore, list[str]]] = {"KA638": (talking(tagged(MAP)), ["KA638"])}


@pytest.mark.parametrize(("allows", "severity"), [(True, Severity.HIGH), (False, Severity.MEDIUM)])
def test_what_is_limited_to_tags(allows: bool, severity: Severity) -> None:
    limited = replace(tagged(MAP), allow=allows)
    (finding,) = spoken(talking(limited, MAP))
    assert (finding.code, finding.severity, finding.locations[0].line) == ("KA638", severity, 42)
    verb = "allows" if allows else "denies"
    assert finding.message.startswith(f"A rule {verb} publish of 'rt/map' to endpoints with certain data tags alone")
    assert spoken(talking(replace(MAP, allow=allows), MAP)) == ()


def test_fingerprints_tell_topics_apart() -> None:
    other = ruled(publish=[(["rt/odom"], None)])
    assert len({finding.fingerprint for finding in spoken(talking(tagged(MAP), tagged(other)))}) == 2
