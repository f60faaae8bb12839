"""Files for sessions that know each other, or one router, by certificates: the two forms of docs/zenoh.md."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

from msgspec import Struct

from keystore_audit.grouped import gathered
from keystore_audit.keystore.layout import Role
from keystore_audit.zenoh.access_control import Flow, Kind
from keystore_audit.zenoh.answers import PASSING
from keystore_audit.zenoh.configuration import Mode
from keystore_audit.zenoh.names import OTHER_SIDE

Configuration = dict[str, Any]

_GRAPH_KINDS: Final = (Kind.TOKEN, Kind.TOKEN_QUERY, Kind.TOKEN_SUBSCRIBE)


class Party(Struct, frozen=True, kw_only=True):
    """A participant.

    `name`: the first common name of its certificate. `files`: where certificate, key and identity CA are on the robot.
    `rights`: operations with the keys that they are about (`answers.channels`, `answers.plain`). `address`: host and
    port where it listens, empty: nowhere. `verified`: whether its certificate is for that host.
    """

    name: str
    files: Mapping[Role, str]
    rights: frozenset[tuple[str, str]] = frozenset()
    address: str = ""
    verified: bool = False

    @property
    def listening(self) -> Configuration:
        """The section `listen`."""
        return {"endpoints": [f"tls/{self.address}"] if self.address else []}

    @property
    def reached(self) -> str:
        """The endpoint that others connect to. Rules go by its name, whether or not its host can be checked."""
        return f"tls/{self.address}{'' if self.verified else '#verify_name_on_connect=false'}"


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
    """A peer that listens nowhere, and is linked with those it connects to."""
    made: Configuration = {
        "mode": Mode.PEER.value,
        "listen": {"endpoints": []},
        "connect": {"endpoints": []},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": secured(files),
    }
    return made | changed


def router_and_clients(
    router: Party, clients: Sequence[Party], domain: int
) -> tuple[Configuration, list[Configuration]]:
    """What the router starts with, and what each client does.

    The router lets each do what it has a right to; a client takes from the router alone, and whatever that hands on.
    """
    ends = {"endpoints": [router.reached]}
    tokens = f"@ros2_lv/{domain}/**"
    graph = _rule("graph", _GRAPH_KINDS, Flow, tokens)
    known = _access_control({each.name: [graph, *_rules(each.name, each.rights, Flow.INGRESS)] for each in clients})
    made = []
    for each in clients:
        passing = (kind for operation, _key in sorted(each.rights) for kind, _away in PASSING[operation])
        kinds = sorted({*passing, *_GRAPH_KINDS})
        trusted = _rule("of_the_router", kinds, Flow, f"{domain}/**", tokens)
        own = _access_control({router.name: [trusted]})
        made.append(process(each.files, mode=Mode.CLIENT.value, connect=ends, access_control=own))
    return process(router.files, mode=Mode.ROUTER.value, listen=router.listening, access_control=known), made


def peers(parties: Sequence[Party], domain: int) -> tuple[list[Configuration], list[tuple[str, str]]]:
    """What each starts with, linked only with those who have the other side of some right of its own. Also, by name,
    the pairs that have no link, since neither listens.

    Each file lets out and in what its owner and the other both have a right to.
    """
    graph = _rule("graph", _GRAPH_KINDS, Flow, f"@ros2_lv/{domain}/**")
    made, apart = [], []
    for own in parties:
        known, ends = {}, []
        for other in parties:
            shared = {(does, key) for does, key in own.rights if (OTHER_SIDE[does], key) in other.rights}
            if other is own or not shared:
                continue
            known[other.name] = [graph, *_rules(other.name, shared, Flow.EGRESS)]
            if other.address and (own.name < other.name or not own.address):
                ends.append(other.reached)
            elif own.name < other.name and not own.address:
                apart.append((own.name, other.name))
        made.append(
            process(
                own.files,
                listen=own.listening,
                connect={"endpoints": ends},
                access_control=_access_control(known),
            )
        )
    return made, apart


def _rules(name: str, rights: Collection[tuple[str, str]], away: Flow) -> Iterator[Configuration]:
    """Rules about the holder of the name: what passes, `away` from the holder of the rights or back."""
    for operation, keys in gathered(sorted(rights)).items():
        for flow in Flow:
            kinds = [kind for kind, is_away in PASSING[operation] if is_away is (flow is away)]
            yield _rule(f"{operation} {name} {flow.value}", kinds, (flow,), *keys)


def _rule(name: str, kinds: Iterable[Kind], flows: Iterable[Flow], *keys: str) -> Configuration:
    return {
        "id": name,
        "messages": [each.value for each in kinds],
        "flows": [each.value for each in flows],
        "permission": "allow",
        "key_exprs": [*keys],
    }


def _access_control(given: Mapping[str, Sequence[Configuration]]) -> Configuration:
    """Rules by common name, about its holder."""
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
