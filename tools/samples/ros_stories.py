"""Pairs for KA63: services and actions as ROS 2 nodes use them, and whose they are."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from .base import LISTENER_GRANT, TALKER_GRANT, TWO, listener, talker
from .documents import DISCOVERY, Permissions, Rule
from .policy import ACTION_SERVICES, ACTION_TOPICS, PARAMETER_SERVICES
from .store import Store
from .story import Case, Story, pair

CHATTER = "rt/chatter"
GOALS = tuple(f"rq/dock/_action/{part}Request" for part in ACTION_SERVICES)
RESULTS = tuple(f"rr/dock/_action/{part}Reply" for part in ACTION_SERVICES)
TOPICS = tuple(f"rt/dock/_action/{part}" for part in ACTION_TOPICS)


def _two(talking: Rule, listening: Rule | None = None) -> Store:
    """The talker and the listener with these rules beside what they talk about."""
    other = listening or Rule(subscribe=(CHATTER,))
    talker_grant = replace(TALKER_GRANT, rules=(talking, DISCOVERY))
    listener_grant = replace(LISTENER_GRANT, rules=(other, DISCOVERY))
    return replace(
        TWO,
        enclaves=(
            talker(permissions=Permissions(grants=(talker_grant,))),
            listener(permissions=Permissions(grants=(listener_grant,))),
        ),
    )


def _client(*services: str, publish: tuple[str, ...] = (CHATTER,)) -> Rule:
    return Rule(
        publish=(*publish, *(f"rq{name}Request" for name in services)),
        subscribe=tuple(f"rr{name}Reply" for name in services),
    )


def _server(*services: str, subscribe: tuple[str, ...] = (CHATTER,)) -> Rule:
    return Rule(
        publish=tuple(f"rr{name}Reply" for name in services),
        subscribe=(*subscribe, *(f"rq{name}Request" for name in services)),
    )


def stories() -> Iterator[Story]:
    """All pairs of KA63."""
    yield from _halves()
    yield from _reach()
    yield from _topics()


def _halves() -> Iterator[Story]:
    yield from pair(
        "KA630",
        bad=Case(
            "The talker may send requests to /reset but not read the answers: under Enforce its node fails.",
            _two(Rule(publish=(CHATTER, "rq/resetRequest")), _server("/reset")),
        ),
        good=Case("It may read the answers too.", _two(_client("/reset"), _server("/reset"))),
    )
    serving = Rule(publish=(*RESULTS, *TOPICS), subscribe=(CHATTER, *GOALS))
    yield from pair(
        "KA631",
        bad=Case(
            "The talker may use the services of the action /dock and read its status, but not its feedback: the "
            "action client is not created.",
            _two(Rule(publish=(CHATTER, *GOALS), subscribe=(*RESULTS, TOPICS[1])), serving),
        ),
        good=Case(
            "It may read the feedback too.",
            _two(Rule(publish=(CHATTER, *GOALS), subscribe=(*RESULTS, *TOPICS)), serving),
        ),
    )


def _reach() -> Iterator[Story]:
    parameters = ("/listener/set_parameters",)
    yield from pair(
        "KA632",
        bad=Case(
            "The talker may set parameters of the node /listener in another enclave.",
            _two(_client(*parameters), _server(*parameters)),
        ),
        good=Case(
            "It may set only those of its own node.", _two(_client("/talker/set_parameters"), _server(*parameters))
        ),
    )
    state = ("/listener/change_state",)
    yield from pair(
        "KA633",
        bad=Case(
            "The talker may start and stop the managed node /listener in another enclave.",
            _two(_client(*state), _server(*state)),
        ),
        good=Case("Only the listener's own enclave may.", _two(Rule(publish=(CHATTER,)), _server(*state))),
    )
    yield from pair(
        "KA634",
        bad=Case(
            "Both enclaves may answer /reset: a client cannot tell whose answer it gets.",
            _two(replace(_server("/reset"), publish=("rr/resetReply", CHATTER)), _server("/reset")),
        ),
        good=Case("Only the listener's may.", _two(_client("/reset"), _server("/reset"))),
    )


def _topics() -> Iterator[Story]:
    serving = Rule(publish=(*RESULTS, *TOPICS), subscribe=(CHATTER, *GOALS))
    yield from pair(
        "KA635",
        bad=Case(
            "The talker may publish everything below /dock, and so the feedback and status of the action /dock, "
            "which the listener serves.",
            _two(Rule(publish=(CHATTER, "rt/dock/*")), serving),
        ),
        good=Case("It may publish only /dock/light.", _two(Rule(publish=(CHATTER, "rt/dock/light")), serving)),
    )
    usual = ("rt/rosout", "rt/parameter_events")
    described = (*PARAMETER_SERVICES, "~/get_type_description")
    own, other = (
        _server(*(name.replace("~", node) for name in described), subscribe=()) for node in ("/talker", "/listener")
    )
    listening = Rule(publish=(*usual, *other.publish), subscribe=(CHATTER, *usual[1:], *other.subscribe))
    yield from pair(
        "KA636",
        bad=Case(
            "The talker may log and announce parameter changes, but not read those of others: its nodes fail unless "
            "they are told to do without.",
            _two(replace(own, publish=(CHATTER, *usual, *own.publish)), listening),
        ),
        good=Case(
            "It may read them too.",
            _two(Rule(publish=(CHATTER, *usual, *own.publish), subscribe=(*usual[1:], *own.subscribe)), listening),
        ),
    )
