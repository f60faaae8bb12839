"""Systems over sessions and a router: as the generator of ROS 2 makes files, in a form that holds, and nearly so."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from msgspec.structs import replace

from keystore_audit.zenoh.answers import channels, plain
from keystore_audit.zenoh.suggested import Configuration, Party, router_and_clients

from .healthy import TURTLESIM, VEHICLE, healthy
from .network_stories import HOST, files_of, session, tls, written
from .policy import Node
from .store import Store
from .story import Story

ROUTER = "/zenohd"
ENDS = {"endpoints": [f"tls/{HOST}:7447"]}
TOKENS = ("liveliness_token", "liveliness_query", "declare_liveliness_subscriber")
GRAPH = "@ros2_lv/0/**"


def stories() -> Iterator[Story]:
    """All of them."""
    yield _story(
        "turtlesim_generated",
        "TurtleSim with files from zenoh_security_tools: TLS on both sides, but each file restrains only its owner, "
        "since its subjects are anybody. By starting without its file, /random writes /high_priority and moves the "
        "turtle itself. The router has no rules.",
        TURTLESIM,
        {each.strip("/"): _generated(each, node) for each, node in TURTLESIM.items()}
        | {"zenohd": _router_without_rules()},
    )
    yield _story(
        "turtlesim_clients",
        "The same system in a form that holds. Every session is a client of one router, listens nowhere, checks the "
        "router's name and accepts data only from it. The router knows each by its certificate.",
        TURTLESIM,
        _clients(TURTLESIM),
    )
    vehicle = _clients(VEHICLE)
    (brake,) = (each for each in vehicle["zenohd"]["access_control"]["subjects"] if each["id"] == "/brake")
    brake["cert_common_names"].append("/infotainment")
    yield _story(
        "vehicle_router",
        "A vehicle in the form that holds, except for one name: after a test, somebody left /infotainment in the "
        "router's subject for the brake. It limits the motor as the brake may; its signed permissions do not allow "
        "that.",
        VEHICLE,
        vehicle,
    )


def _story(name: str, text: str, nodes: Mapping[str, Node], files: Mapping[str, Configuration]) -> Story:
    folder = f"networks/{name}"
    return Story(
        directory=f"zenoh/{name}",
        text=text,
        tree=_keystore(name.partition("_")[0], nodes).tree(),
        options=("--zenoh", folder),
        beside={f"{folder}/{each}.json5": written(content) for each, content in files.items()},
    )


def _keystore(system: str, nodes: Mapping[str, Node]) -> Store:
    """That of a system, with an identity for the router, all of them for the host."""
    store = healthy(system, {**nodes, ROUTER: Node(name="zenohd")})
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


def _clients(nodes: Mapping[str, Node]) -> Mapping[str, Configuration]:
    """As `suggest` writes it from the policy without what every node has, for the topics alone."""
    parties = [
        Party(
            name=path,
            files=files_of(path.strip("/")),
            rights=frozenset(
                (operation, plain(key))
                for operation, topics in (("publish", node.publish), ("subscribe", node.subscribe))
                for topic in topics
                for _operation, key in channels(operation, f"/{topic}", 0)
            ),
        )
        for path, node in sorted(nodes.items())
    ]
    center = Party(name=ROUTER, files=files_of("zenohd"), address=f"{HOST}:7447", verified=True)
    router, clients = router_and_clients(center, parties, 0)
    return {"zenohd": router, **{each.name.strip("/"): own for each, own in zip(parties, clients, strict=True)}}
