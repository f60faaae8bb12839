"""Files for sessions that are clients of one router, which knows each by its certificate: form (a) of docs/zenoh.md."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

from msgspec import Struct

from keystore_audit.grouped import gathered
from keystore_audit.keystore.layout import Role
from keystore_audit.zenoh.access_control import Flow, Kind
from keystore_audit.zenoh.answers import PASSING
from keystore_audit.zenoh.configuration import Mode

Configuration = dict[str, Any]

_GRAPH_KINDS: Final = (Kind.TOKEN, Kind.TOKEN_QUERY, Kind.TOKEN_SUBSCRIBE)


class Party(Struct, frozen=True, kw_only=True):
    """Whoever takes part.

    `name`: the first common name of its certificate. `files`: where certificate, key and identity CA are on the robot.
    `rights`: operations with the keys that they are about (`answers.channels`, `answers.plain`).
    """

    name: str
    files: Mapping[Role, str]
    rights: frozenset[tuple[str, str]] = frozenset()


def secured(files: Mapping[Role, str]) -> Configuration:
    """The section `transport`: TLS alone, with certificates on both sides, which end links when they end."""
    own = {
        f"{side}_{what}": files[role]
        for side in ("connect", "listen")
        for what, role in (("certificate", Role.CERTIFICATE), ("private_key", Role.KEY))
    }
    root = files[Role.IDENTITY_CA]
    section = {"enable_mtls": True, "close_link_on_expiration": True, "root_ca_certificate": root, **own}
    return {"link": {"protocols": ["tls"], "tls": section}}


def process(files: Mapping[Role, str], **changed: Any) -> Configuration:
    """A peer that listens nowhere, linked with whoever it connects to."""
    made: Configuration = {
        "mode": Mode.PEER.value,
        "listen": {"endpoints": []},
        "connect": {"endpoints": []},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": secured(files),
    }
    return made | changed


def router_and_clients(
    router: Party, clients: Sequence[Party], endpoint: str, domain: int
) -> tuple[Configuration, list[Configuration]]:
    """What the router starts with, which listens at the endpoint, and what each client does.

    The router lets each do what it has a right to; a client takes from the router alone, and whatever that hands on.
    """
    ends = {"endpoints": [endpoint]}
    tokens = f"@ros2_lv/{domain}/**"
    graph = _rule("graph", _GRAPH_KINDS, Flow, tokens)
    known = _access_control({each.name: [graph, *_rules(each)] for each in clients})
    made = []
    for each in clients:
        passing = (kind for operation, _key in sorted(each.rights) for kind, _away in PASSING[operation])
        kinds = sorted({*passing, *_GRAPH_KINDS})
        trusted = _rule("of_the_router", kinds, Flow, f"{domain}/**", tokens)
        own = _access_control({router.name: [trusted]})
        made.append(process(each.files, mode=Mode.CLIENT.value, connect=ends, access_control=own))
    return process(router.files, mode=Mode.ROUTER.value, listen=ends, access_control=known), made


def _rules(party: Party) -> Iterator[Configuration]:
    """What the router takes from it, and what it hands to it."""
    for operation, keys in gathered(sorted(party.rights)).items():
        for flow in Flow:
            kinds = [kind for kind, away in PASSING[operation] if away is (flow is Flow.INGRESS)]
            yield _rule(f"{operation} {party.name} {flow.value}", kinds, (flow,), *keys)


def _rule(name: str, kinds: Iterable[Kind], flows: Iterable[Flow], *keys: str) -> Configuration:
    return {
        "id": name,
        "messages": [each.value for each in kinds],
        "flows": [each.value for each in flows],
        "permission": "allow",
        "key_exprs": [*keys],
    }


def _access_control(given: Mapping[str, Sequence[Configuration]]) -> Configuration:
    """By common name, the rules about whoever has it."""
    rules = {each["id"]: each for own in given.values() for each in own}
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [*rules.values()],
        "subjects": [{"id": name, "cert_common_names": [name]} for name in given],
        "policies": [{"rules": [each["id"] for each in own], "subjects": [name]} for name, own in given.items()],
    }


def written(configuration: Configuration) -> str:
    """A file as people write it: JSON with lines."""
    return f"{json.dumps(configuration, indent=2)}\n"
