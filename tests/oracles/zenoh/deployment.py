"""Files of sessions and routers for tests, and whose certificates they name: each function takes what differs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from functools import cache
from ipaddress import ip_address
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec

from tests.keystore import builder

Configuration = dict[str, Any]
ALL = ["put", "delete", "declare_subscriber", "query", "reply", "declare_queryable"]
NOW = datetime.now(timezone.utc).replace(microsecond=0)
_PAST, _FUTURE = datetime(2024, 6, 1, tzinfo=timezone.utc), datetime(2033, 1, 1, tzinfo=timezone.utc)


def _usage(*purposes: x509.ObjectIdentifier) -> builder.Extension:
    return x509.ExtendedKeyUsage(purposes), False


_USES = x509.ExtendedKeyUsageOID
ODD: Mapping[str, Mapping[str, Any]] = {
    "expired": {"end": _PAST},
    "future": {"start": _FUTURE},
    "p384": {"key": ec.generate_private_key(ec.SECP384R1())},
    "p521": {"key": ec.generate_private_key(ec.SECP521R1())},
    "rsa": {"key": builder.rsa_key(2048)},
    "ca": {"ca": True},
    "client": {"extensions": [_usage(_USES.CLIENT_AUTH)]},
    "server": {"extensions": [_usage(_USES.SERVER_AUTH)]},
    "named": {"extensions": [(x509.SubjectAlternativeName([x509.IPAddress(ip_address("127.0.0.1"))]), False)]},
}
"""Enclaves whose certificates are not as sros2 makes them."""

MISNAMED: Mapping[str, Mapping[str, Any]] = {
    "nameless": {"subject": x509.Name([x509.NameAttribute(x509.NameOID.ORGANIZATION_NAME, "robots")])},
    "twin": {"subject": "/random"},
    "localhost": {"subject": "localhost"},
    "dns": {"extensions": [(x509.SubjectAlternativeName([x509.DNSName("localhost")]), False)]},
}
"""And those whose names are odd, which no permissions grant anything."""


ROOTS: Mapping[str, Mapping[str, Any]] = {
    "aged": {"identity_ca": {"end": _PAST}},
    "flagless": {"identity_ca": {"ca": None}},
}
"""And those whose copy of the identity CA is one of its key, and otherwise odd."""


_GRANTED = "<publish><topics><topic>rt/chatter</topic></topics></publish>"
_ALL_TOPICS = "".join(f"<{each}><topics><topic>rt/*</topic></topics></{each}>" for each in ("publish", "subscribe"))


def keystore(root: Path, odd: Mapping[str, Mapping[str, Any]] = ODD, **authority: Any) -> Path:
    """Enclaves /talker, /listener, /random, one of a foreign CA, and the odd ones."""
    identity = builder.authority(**authority)
    foreign = builder.authority("foreign")
    for name in ("talker", "listener", "random", "zenohd", "foreign", *odd):
        made = {"subject": f"/{name}", **odd.get(name, {})}
        root_ca = identity
        if (changed := made.pop("identity_ca", None)) is not None:
            root_ca = builder.certificate(identity.certificate.subject, key=identity.key, **{"ca": True, **changed})
        own = builder.certificate(issuer=foreign if name == "foreign" else identity, **made)
        document = builder.PERMISSIONS.format(name=f"/{name}").replace(_GRANTED, _ALL_TOPICS).encode()
        builder.write_enclave(root / "enclaves" / name, own, document, root_ca, identity, builder.GOVERNANCE)
    return root


def tls(root: Path, name: str | None, **changed: Any) -> Configuration:
    """The section of an enclave; None: one without a certificate."""
    folder = root / "enclaves" / (name or "talker")
    section: Configuration = {
        "enable_mtls": name is not None,
        "verify_name_on_connect": False,
        "close_link_on_expiration": True,
        "root_ca_certificate": f"{root / 'enclaves' / 'talker' / 'identity_ca.cert.pem'}",
    }
    for side in ("connect", "listen") if name is not None else ():
        section |= {f"{side}_certificate": f"{folder / 'cert.pem'}", f"{side}_private_key": f"{folder / 'key.pem'}"}
    section |= changed
    return {"transport": {"link": {"tls": {name: value for name, value in section.items() if value is not None}}}}


def session(mode: str = "client", **changed: Any) -> Configuration:
    """A process that listens nowhere and connects to nobody, and hears of none."""
    made: Configuration = {
        "mode": mode,
        "listen": {"endpoints": changed.pop("listen", [])},
        "connect": {"endpoints": changed.pop("connect", [])},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": changed.pop("gossip", False)}},
    }
    return made | changed


Rule = tuple[str, Sequence[str], Sequence[str] | None, Sequence[str]]


def allow(keys: str, *messages: str, flows: Sequence[str] | None = None) -> Rule:
    """A rule; no messages: all about data."""
    return "allow", messages or ALL, flows, keys.split()


def deny(keys: str, *messages: str, flows: Sequence[str] | None = None) -> Rule:
    """The same, denying."""
    return "deny", messages or ALL, flows, keys.split()


def access(*given: tuple[Mapping[str, Any], Sequence[Rule]], default: str = "deny", **changed: Any) -> Configuration:
    """Access control with these subjects, and the rules of each."""
    rules: list[Configuration] = []
    subjects, policies = [], []
    for number, (properties, own) in enumerate(given):
        subjects.append({"id": f"s{number}", **properties})
        names = []
        for permission, messages, flows, keys in own:
            names.append(f"r{len(rules)}")
            flow = {} if flows is None else {"flows": list(flows)}
            made = {"id": names[-1], "permission": permission, "messages": list(messages), "key_exprs": list(keys)}
            rules.append(made | flow)
        if names:
            policies.append({"rules": names, "subjects": [f"s{number}"]})
    section = {"enabled": True, "default_permission": default, "rules": rules, "subjects": subjects}
    return {"access_control": section | {"policies": policies} | changed}


def tool(
    publish: str = "", subscribe: str = "", reply: str = "", request: str = "", tail: str = "/*/*"
) -> Configuration:
    """The access control that zenoh_security_tools writes (ros2/rmw_zenoh, config_generator.cpp)."""
    rules: list[Rule] = []
    for names, out, back in (
        (publish, ["put"], ["declare_subscriber"]),
        (subscribe, ["declare_subscriber"], ["put"]),
        (request, ["query"], ["declare_queryable", "reply"]),
        (reply, ["declare_queryable", "reply"], ["query"]),
    ):
        keys = [f"0/{name}{tail}" for name in names.split()]
        rules += [("allow", out, ["egress"], keys), ("allow", back, ["ingress"], keys)] if keys else []
    tokens = ["liveliness_token", "liveliness_query", "declare_liveliness_subscriber"]
    rules.append(("allow", tokens, ["ingress", "egress"], ["@ros2_lv/0/**"]))
    return access(({}, rules))


@cache
def text(value: str) -> str:
    """As a tool writes it, lines and all."""
    return json.dumps(json.loads(value), indent=2)


def written(configuration: Configuration) -> str:
    """The text of a file."""
    return text(json.dumps(configuration))
