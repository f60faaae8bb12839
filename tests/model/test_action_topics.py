"""`model.ros.action_topics`: what takes in topics of actions, against the classes of all names; and what it costs."""

from __future__ import annotations

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from keystore_audit.keystore.typed import Operation
from keystore_audit.model.matching.coverage import TOPICS, covers
from keystore_audit.model.matching.expression import parse
from keystore_audit.model.ros.action_topics import STATUS, action_patterns, taken_in
from keystore_audit.model.ros.classes import Affix, classify_ros_names
from keystore_audit.profiles import Matcher
from tests.amount import tried
from tests.rules.evidence import allow, enclave, grant, permissions

EXAMPLES = settings(max_examples=tried(300), deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
FEEDBACK = Affix("rt", "/_action/feedback")

_PARTS = ("rt", "r", "/", "a", "_", "?", "??", "*", "[a-m]", "[!a]", "/_action/", "status", "feedback", "s", "k", "tus")


@EXAMPLES
@given(st.lists(st.sampled_from(_PARTS), min_size=1, max_size=8).map("".join))
def test_an_action_is_found_where_there_is_one(expression: str) -> None:
    pattern = parse(expression, Matcher.POSIX)
    exists = any(any(each.members) for each in classify_ros_names([pattern], (FEEDBACK, STATUS)))
    name = taken_in(expression)
    assert (name is not None) is exists
    if name is not None:
        assert pattern.matches(FEEDBACK.topic(name)) or pattern.matches(STATUS.topic(name))


def _found(*texts: str, others: tuple[str, ...] = ()) -> list[tuple[str, int, str, str | None]]:
    """Of an enclave that may publish on `texts`, where another one publishes on `others`."""
    own = permissions("enclaves/talker/permissions.p7s", grant("/talker", allow(texts)))
    server = permissions("enclaves/server/permissions.p7s", grant("/server", allow(others)))
    both = (enclave("/talker", permissions=own), enclave("/server", permissions=server))
    patterns = [each for each in action_patterns(both) if each.enclave == "/talker"]
    assert all(each.operation is Operation.PUBLISH for each in patterns)
    return [(each.expression, each.count, each.action, each.owner) for each in patterns]


def test_what_costs_too_much_is_left_out_and_known_actions_are_not() -> None:
    """Thousands of patterns that no quick look decides; the one for an action that there is comes last."""
    hard = [f"rt/[!{chr(0x4E00 + n)}]*b*[!c]*/_action/*[d-k]*s" for n in range(3_000)]
    several = [text.replace("/_action/", "/") for text in hard]
    assert _found(*several, "rt/arm/*", others=("rt/arm/move/_action/status",))[0][2:] == ("/arm/move", "/server")


def test_few_questions_about_everything_are_asked() -> None:
    covers.cache_clear()
    assert len(_found(*(f"*[!{chr(0x4E00 + n)}]*" for n in range(5_000)))) == 1
    assert covers.cache_info().misses < 200


def test_what_a_quick_look_rules_out_covers_nothing() -> None:
    for text in ("?" * 300, "rt/?*?", "rt/[!b]*", "*a*"):
        assert not covers(text, TOPICS)
    assert covers("rt/?*", TOPICS)
