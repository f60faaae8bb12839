"""Who starts is told of DDS; what keeps ROS 2 from making a node is named beside it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from keystore_audit.findings import Severity
from tests.cli.keystores import AT, answer, keystore, rule
from tests.keystore.builder import GOVERNANCE

ROOT = Path(__file__).resolve().parents[2]
DISCOVERY = rule(publish=("ros_discovery_info",), subscribe=("ros_discovery_info",))
RT_ONLY = GOVERNANCE.replace(b"<topic_expression>*<", b"<topic_expression>rt/*<")
USUAL = rule(publish=("rt/rosout", "rt/parameter_events", "rr/*"), subscribe=("rt/parameter_events",))
BESIDE = "This is about DDS participants."


@pytest.mark.parametrize(
    ("path", "rules", "governance", "code"),
    [
        ("/c", (rule(publish=("rt/a",)), USUAL, DISCOVERY), GOVERNANCE, None),
        ("/c", (rule(publish=("rt/a",)),), GOVERNANCE, "KA636"),
        ("/c", (rule(publish=("rt/a",)), DISCOVERY), GOVERNANCE, "KA636"),
        ("/c", (rule(publish=("Square",)),), GOVERNANCE, None),  # plain DDS
        ("/c", (rule(publish=("rt/a",)), USUAL, DISCOVERY), RT_ONLY, "KA418"),
        ("/c-d", (rule(publish=("rt/a",)), USUAL, DISCOVERY), GOVERNANCE, "KA113"),
    ],
)
def test_a_participant_of_which_ros_2_makes_no_node(
    path: str, rules: tuple[str, ...], governance: bytes, code: str | None, tmp_path: Path
) -> None:
    store = keystore(tmp_path / "k", {path: rules}, governance=governance)
    _code, text = answer("audit", "--engine", "native", "--at", AT, "-v", store)
    _code, page = answer("audit", "--engine", "native", "--at", AT, "-f", "html", store)
    assert f"{path}: a DDS participant starts under all profiles." in text
    assert (BESIDE in text, BESIDE in page) == ((code is not None),) * 2
    assert code is None or f"see {code}." in " ".join(text.split())


def test_severities_are_defined_in_one_place() -> None:
    """Two definitions were two, and one of them untrue of what every implementation refuses."""
    text = (ROOT / "docs/reading-the-report.md").read_text("utf-8")
    rows = re.findall(r"^\| (\w+) \| ", text.partition("| severity | meaning |")[2].partition("\n\n")[0], re.MULTILINE)
    assert rows == [severity.value for severity in sorted(Severity, key=lambda each: each.rank)]
    for page in sorted((ROOT / "docs").glob("*.md")):
        assert page.name == "reading-the-report.md" or "*critical*," not in page.read_text("utf-8"), page.name
