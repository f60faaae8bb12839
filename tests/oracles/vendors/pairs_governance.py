"""Pairs of enclaves whose governance is the same, differs, or stands against a peer without security."""

from __future__ import annotations

from typing import Any

from msgspec.structs import replace

from tests.keystore.documents import ids, topic_rule
from tests.oracles.vendors.enclave import publish, subscribe
from tests.oracles.vendors.pairs_case import CAS, Case, plain
from tests.oracles.vendors.pairs_material import governance

_SIGN_ORIGIN = "SIGN_WITH_ORIGIN_AUTHENTICATION"
_ENCRYPT_ORIGIN = "ENCRYPT_WITH_ORIGIN_AUTHENTICATION"


def _pair(title: str, first: bytes, second: bytes | None = None, **others: Any) -> Case:
    here = CAS.sign(first)
    there = CAS.sign(second) if second is not None else here
    return Case(
        title=title,
        first=replace(plain("first"), governance=here),
        second=replace(plain("second"), governance=there),
        **others,
    )


def _domain_kinds_differ() -> list[Case]:
    differences = (("NONE", "SIGN"), ("ENCRYPT", "NONE"), ("SIGN", "ENCRYPT"))
    with_origin = (("SIGN", _SIGN_ORIGIN), (_ENCRYPT_ORIGIN, "ENCRYPT"))

    def stated(kind: str, value: str) -> bytes:
        named: dict[str, Any] = {kind: value}
        return governance(**named)

    return [
        _pair(f"{kind} {one} against {other}", stated(kind, one), stated(kind, other))
        for kind in ("discovery", "liveliness", "rtps")
        for one, other in (*differences, *with_origin)
    ]


def _domain_kinds_agree() -> list[Case]:
    return [
        _pair(f"all kinds {kind}", governance(topic_rule(metadata=kind), discovery=kind, liveliness=kind, rtps=kind))
        for kind in ("NONE", "SIGN", "ENCRYPT", _SIGN_ORIGIN, _ENCRYPT_ORIGIN)
    ]


_TOPIC_DIFFERENCES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "same": ({}, {}),
    "discovery": ({"discovery": True}, {"discovery": False}),
    "liveliness": ({"liveliness": False}, {"liveliness": True}),
    "read": ({"read": True}, {"read": False}),
    "read_here": ({"read": False}, {"read": True}),
    "write": ({"write": True}, {"write": False}),
    "write_here": ({"write": False}, {"write": True}),
    "metadata": ({"metadata": "NONE"}, {"metadata": "SIGN"}),
    "metadata_kind": ({"metadata": "ENCRYPT"}, {"metadata": "SIGN"}),
    "metadata_origin": ({"metadata": "ENCRYPT"}, {"metadata": _ENCRYPT_ORIGIN}),
    "data": ({"data": "NONE"}, {"data": "SIGN"}),
    "data_kind": ({"data": "ENCRYPT"}, {"data": "SIGN"}),
}


def _topic_kinds_differ() -> Case:
    sides = [
        governance(*(topic_rule(topic, **both[side]) for topic, both in _TOPIC_DIFFERENCES.items())) for side in (0, 1)
    ]
    endpoints = tuple(kind(topic) for topic in _TOPIC_DIFFERENCES for kind in (publish, subscribe))
    return _pair("each flag and kind of a topic rule differs", *sides, endpoints=endpoints)


def _topic_kinds_agree() -> Case:
    rules = {
        f"{metadata}_{data}": topic_rule(f"{metadata}_{data}", metadata=metadata, data=data)
        for metadata in ("NONE", "SIGN", "ENCRYPT", _SIGN_ORIGIN, _ENCRYPT_ORIGIN)
        for data in ("NONE", "SIGN", "ENCRYPT")
    }
    endpoints = tuple(kind(topic) for topic in rules for kind in (publish, subscribe))
    return _pair("each protection of a topic, the same on both sides", governance(*rules.values()), endpoints=endpoints)


def _may_differ() -> list[Case]:
    a, b = topic_rule("a"), topic_rule("b", data="SIGN")
    return [
        _pair("stock governance", governance()),
        _pair("join control here alone", governance(), governance(join=False)),
        _pair("join control there alone", governance(join=False), governance()),
        _pair("unauthenticated allowed here alone", governance(unauthenticated=True), governance()),
        _pair("unauthenticated allowed there alone", governance(), governance(unauthenticated=True)),
        _pair("the same topic rules in another order", governance(a, b), governance(b, a)),
        _pair(
            "another topic rule after the first that matches",
            governance(a),
            governance(a, topic_rule("*", data="NONE")),
        ),
        _pair("another topic rule before it", governance(a), governance(topic_rule("*", data="NONE"), a)),
        _pair("other domains, this one among them", governance(domains=ids(0)), governance()),
        _pair("the topic is governed here alone", governance(), governance(topic_rule("b"))),
        _pair("the topic is governed there alone", governance(topic_rule("b")), governance()),
        _pair("another domain is governed there", governance(), governance(domains=ids(7))),
        _pair("a domain that no rule governs", governance(domains=ids(7)), domains=(5, 5)),
        _pair("two domains", governance(), domains=(0, 1)),
    ]


_OPEN: dict[str, Any] = {"discovery": "NONE", "liveliness": "NONE", "rtps": "NONE", "unauthenticated": True}
_OPEN_TOPIC: dict[str, Any] = {"discovery": False, "liveliness": False, "metadata": "NONE", "data": "NONE"}


def _against_plain(title: str, topic: dict[str, Any] | None = None, **domain: Any) -> Case:
    rule = topic_rule(**{**_OPEN_TOPIC, "read": False, "write": False, **(topic or {})})
    document = governance(rule, controls=False, **{**_OPEN, "join": False, **domain})
    return Case(
        title=f"plain peer: {title}",
        first=replace(plain("first"), governance=CAS.sign(document)),
        second=None,
    )


def _plain_peers() -> list[Case]:
    access = {"read": True, "write": True}
    stock = replace(plain("first"), governance=CAS.sign(governance(unauthenticated=True)))
    return [
        _against_plain("everything open"),
        _against_plain("everything open but unauthenticated participants", unauthenticated=False),
        _against_plain("access control", access),
        _against_plain("access and join control", access, join=True),
        _against_plain("read access control alone", {"read": True}),
        _against_plain("write access control alone", {"write": True}),
        _against_plain(
            "access and join control, unauthenticated not allowed", access, join=True, unauthenticated=False
        ),
        _against_plain("topic discovery protected", {"discovery": True}),
        _against_plain("topic liveliness protected", {"liveliness": True}),
        *(_against_plain(f"metadata {kind}", {"metadata": kind}) for kind in ("SIGN", "ENCRYPT", _SIGN_ORIGIN)),
        *(_against_plain(f"data {kind}", {"data": kind}) for kind in ("SIGN", "ENCRYPT")),
        *(_against_plain(f"discovery {kind}", discovery=kind) for kind in ("SIGN", "ENCRYPT")),
        *(_against_plain(f"liveliness {kind}", liveliness=kind) for kind in ("SIGN", "ENCRYPT")),
        *(_against_plain(f"rtps {kind}", rtps=kind) for kind in ("SIGN", "ENCRYPT", _SIGN_ORIGIN)),
        Case(title="plain peer: stock kinds, unauthenticated allowed", first=stock, second=None),
    ]


GOVERNANCE_CASES = (
    *_may_differ(),
    *_domain_kinds_agree(),
    _topic_kinds_agree(),
    _topic_kinds_differ(),
    *_domain_kinds_differ(),
    *_plain_peers(),
)
