"""TurtleSim over sessions and a router: as the generator of ROS 2 makes its files, and in a form that holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from msgspec.structs import replace

from .healthy import TURTLESIM, healthy
from .network_stories import HOST, Configuration, named, session, tls, written
from .policy import Node
from .store import Store
from .story import Story

ROUTER = "/zenohd"
ENDS = {"endpoints": [f"tls/{HOST}:7447"]}
TOKENS = ("liveliness_token", "liveliness_query", "declare_liveliness_subscriber")
GRAPH = "@ros2_lv/0/**"


def stories() -> Iterator[Story]:
    """Both."""
    yield _story(
        "turtlesim_generated",
        "TurtleSim with files as zenoh_security_tools makes them: TLS on both sides, and access control whose subjects "
        "are anybody, so that each file restrains its owner alone. /random writes /high_priority, and moves the turtle "
        "itself, by starting without its file; the router has no rules at all.",
        {each.strip("/"): _generated(each, node) for each, node in TURTLESIM.items()}
        | {"zenohd": _router_without_rules()},
    )
    yield _story(
        "turtlesim_clients",
        "The same system in a form that holds: every session is a client of one router, listens nowhere, checks the "
        "router's name and takes data from the router alone; the router knows each by its certificate.",
        {each.strip("/"): _client(each) for each in TURTLESIM} | {"zenohd": _router()},
    )


def _story(name: str, text: str, files: Mapping[str, Configuration]) -> Story:
    folder = f"networks/{name}"
    return Story(
        directory=f"zenoh/{name}",
        text=text,
        tree=_keystore().tree(),
        options=("--zenoh", folder),
        beside={f"{folder}/{each}.json5": written(content) for each, content in files.items()},
    )


def _keystore() -> Store:
    """That of TurtleSim, with an identity for the router, all of them for the host."""
    store = healthy("turtlesim", {**TURTLESIM, ROUTER: Node(name="zenohd")})
    enclaves = tuple(replace(each, certificate=replace(each.certificate, host=HOST)) for each in store.enclaves)
    return replace(store, enclaves=enclaves)


def _unchecked(name: str) -> Configuration:
    """As the generator writes it."""
    made = tls(name, verify_name_on_connect=False)
    del made["link"]["tls"]["close_link_on_expiration"]
    return made


def _rule(name: str, messages: tuple[str, ...], flows: tuple[str, ...], *keys: str) -> Configuration:
    return {"id": name, "messages": [*messages], "flows": [*flows], "permission": "allow", "key_exprs": [*keys]}


def _keys(topics: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"0/{topic}/*/*" for topic in topics)


def _generated(path: str, node: Node) -> Configuration:
    """As config_generator.cpp of ros2/rmw_zenoh writes it, for the topics of the node alone."""
    rules = []
    if node.publish:
        rules.append(_rule("outgoing_publications", ("put",), ("egress",), *_keys(node.publish)))
        rules.append(_rule("incoming_subscriptions", ("declare_subscriber",), ("ingress",), *_keys(node.publish)))
    if node.subscribe:
        rules.append(_rule("outgoing_subscriptions", ("declare_subscriber",), ("egress",), *_keys(node.subscribe)))
        rules.append(_rule("incoming_publications", ("put",), ("ingress",), *_keys(node.subscribe)))
    rules.append(_rule("liveliness_tokens", TOKENS, ("ingress", "egress"), GRAPH))
    section = {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": "router"}, {"id": node.name}],
        "policies": [
            {"rules": ["liveliness_tokens"], "subjects": ["router"]},
            {"rules": [each["id"] for each in rules], "subjects": [node.name]},
        ],
    }
    return session(
        path.strip("/"),
        connect=ENDS,
        listen={"endpoints": [f"tls/{HOST}:0"]},
        scouting={"multicast": {"enabled": False}, "gossip": {"enabled": True}},
        access_control=section,
        transport=_unchecked(path.strip("/")),
    )


def _router_without_rules() -> Configuration:
    gossip = {"multicast": {"enabled": False}, "gossip": {"enabled": True}}
    listens = {"endpoints": ["tls/[::]:7447"]}
    return session("zenohd", mode="router", listen=listens, scouting=gossip, transport=_unchecked("zenohd"))


def _client(path: str) -> Configuration:
    """It takes whatever the router hands on, and from nobody else."""
    rule = _rule("of_the_router", ("put", "declare_subscriber", *TOKENS), ("ingress", "egress"), "0/**", GRAPH)
    section = {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule],
        "subjects": [{"id": "router", **named(ROUTER)}],
        "policies": [{"rules": ["of_the_router"], "subjects": ["router"]}],
    }
    return session(path.strip("/"), mode="client", connect=ENDS, access_control=section)


def _router() -> Configuration:
    """For each enclave what it may send and ask for, and what it is sent."""
    rules, policies = [_rule("graph", TOKENS, ("ingress", "egress"), GRAPH)], []
    for path, node in TURTLESIM.items():
        own = ["graph"]
        if node.publish:
            own.append(f"from_{node.name}")
            rules.append(_rule(own[-1], ("put",), ("ingress",), *_keys(node.publish)))
            own.append(f"asked_of_{node.name}")
            rules.append(_rule(own[-1], ("declare_subscriber",), ("egress",), *_keys(node.publish)))
        if node.subscribe:
            own.append(f"to_{node.name}")
            rules.append(_rule(own[-1], ("put",), ("egress",), *_keys(node.subscribe)))
            own.append(f"asked_by_{node.name}")
            rules.append(_rule(own[-1], ("declare_subscriber",), ("ingress",), *_keys(node.subscribe)))
        policies.append({"rules": own, "subjects": [path]})
    section = {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": path, **named(path)} for path in TURTLESIM],
        "policies": policies,
    }
    return session("zenohd", mode="router", listen=ENDS, access_control=section)
