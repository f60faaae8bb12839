"""What was measured on real sessions and routers; the names are those of the project's tables of facts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.oracles.zenoh.case import Case, K
from tests.oracles.zenoh.deployment import Configuration, access, allow, deny, session, tls, tool
from tests.oracles.zenoh.meshes import meshes


def cases(root: Path, port: int) -> Iterator[Case]:
    """All of them; `port`: the first of a hundred that are free for each. `root`: the keystore."""
    for number, make in enumerate(
        (
            *_links(root),
            *_names(root),
            *_users(root),
            *_namespaced(),
            *_routers(),
            *_admin(),
            *_tools(),
            *meshes(root),
        )
    ):
        yield make(f"127.0.0.1:{port + 3 * number}", f"127.0.0.1:{port + 3 * number + 1}")


def _links(root: Path) -> Iterator[Any]:
    """Who has a link at all: a session connects to a peer that takes everything."""

    def link(
        name: str, measured: str, who: str | None, listener: Configuration | None = None,
        own: Configuration | None = None, protocol: str = "tls", fragment: str = "", connecting: str = "", **more: Any,
    ) -> Any:  # fmt: skip
        def make(a: str, _b: str) -> Case:
            end = f"{protocol}/{a.replace('127.0.0.1', more.get('host', '127.0.0.1'))}"
            secured = tls(root, "listener") if listener is None else listener
            ends = [f"{end}{fragment}", *more.get("besides", ())]
            theirs = session("peer", listen=ends, **secured, **more.get("limits", {}))
            there = own if own is not None else tls(root, who)
            files = ("whom", "who") if more.get("honest") else ("whom",)
            mine = session(connect=[f"{end}{connecting}"], **there)
            return Case(name, measured, {"whom": theirs, "who": mine}, files, "who", "whom", as_if=who)

        return make

    yield link("A01", "yes", "random")
    yield link("A02", "no", None)
    yield link("A03", "yes", None, tls(root, "listener", enable_mtls=False))
    yield link("A04", "yes", "foreign", tls(root, "listener", enable_mtls=False))
    yield link("A05", "no", "foreign")
    other_root = tls(root, "random", root_ca_certificate=f"{root / 'enclaves/foreign/cert.pem'}")
    yield link("A06", "no", "random", own=other_root, honest=True)
    other_key = f"{root / 'enclaves/talker/key.pem'}"
    yield link("A18", "error", "random", tls(root, "listener", listen_private_key=other_key))
    for name, measured, who in (
        ("A07", "no", "expired"), ("A08", "no", "future"), ("A20", "no", "server"), ("A21", "yes", "client"),
        ("A31", "no", "ca"), ("A32", "yes", "rsa"), ("A34", "yes", "p384"), ("A35", "no", "p521"),
    ):  # fmt: skip
        yield link(name, measured, who)
    checking = tls(root, "random", verify_name_on_connect=True)
    yield link("A10", "no", "random", own=checking, honest=True)
    yield link("A11", "yes", "random", tls(root, "named"), checking, honest=True)
    yield link("A12", "yes", "random", tls(root, "dns"), checking, honest=True, host="localhost")
    yield link("A14", "no", "random", tls(root, "localhost"), checking, honest=True, host="localhost")
    yield link("A39", "yes", "random", own=checking, honest=True, connecting="#verify_name_on_connect=false")
    yield link("A16", "no", "random", own=tls(root, "random", root_ca_certificate=None), honest=True)
    yield link("A17", "error", "random", tls(root, "listener", root_ca_certificate=None))
    yield link("A22", "error", "random", tls(root, "listener", crl="/crl.pem"))
    yield link("A25", "yes", None, tls(root, "listener"), {}, protocol="tcp")
    limited = tls(root, "listener")
    limited["transport"]["link"]["protocols"] = ["tls"]
    yield link("A26", "error", None, limited, {}, protocol="tcp")
    yield link("A38", "yes", None, fragment="#enable_mtls=false")
    for name, root_of in (("A29", "aged"), ("A30", "flagless")):
        other_root = {"root_ca_certificate": f"{root / 'enclaves' / root_of / 'identity_ca.cert.pem'}"}
        yield link(name, "yes", "random", tls(root, "listener", **other_root), tls(root, "random", **other_root))


def _names(root: Path) -> Iterator[Any]:
    """Which subject somebody is: sessions connect to a peer with rules."""

    def named(name: str, measured: str, section: Configuration, who: str | None = "random", **more: Any) -> Any:
        def make(a: str, _b: str) -> Case:
            end = f"tls/{a}" if who is not None or more.get("open") else f"tcp/{a}"
            secured = tls(root, "listener", enable_mtls=not more.get("open")) if end.startswith("tls") else {}
            mine = session(connect=[end], **(tls(root, who) if end.startswith("tls") else {}), **more.get("own", {}))
            theirs = session("peer", listen=[end], **secured, **section)
            rest = {key: more[key] for key in ("key", "at", "does", "ours") if key in more}
            return Case(name, measured, {"whom": theirs, "who": mine}, ("whom",), "who", "whom", as_if=who, **rest)

        return make

    def one(names: list[str] | None, **more: Any) -> Configuration:
        return access(({**({} if names is None else {"cert_common_names": names}), **more}, [allow("0/**")]))

    yield named("B01", "yes", one(["/random"]))
    yield named("B03", "no", one(["/*"]))
    yield named("B04", "no", one(["/Random"]))
    yield named("B05", "no", one(["/random"]), who="nameless")
    yield named("B06", "yes", one(None), who="nameless", ours="unknown")  # older releases take none such
    yield named("B09", "yes", one(["/random"]), who="twin")
    yield named("B10", "no", one(["/random"], usernames=["alice"]), ours="unknown")
    yield named("B11", "yes", one(["/talker", "/random"]))
    yield named("B12", "yes", one(None, interfaces=["lo"]), ours="unknown")
    yield named("B13", "no", one(None, interfaces=["eth9"]), ours="unknown")
    yield named("B14", "yes", one(None, link_protocols=["tls"]))
    yield named("B15", "no", one(None, link_protocols=["quic"]))
    denied = ({"cert_common_names": ["/random"]}, [deny(K, "put")])
    other = ({}, [allow("0/other/**")])
    yield named("B16", "yes", access(denied, other, default="allow"))
    yield named("B17", "yes", access(denied, default="allow"), open=True)
    yield named("B18", "no", access(denied, default="allow"))
    yield named("B19", "error", one([]))
    yield named("B20", "error", one([""]))
    yield named("B21", "yes", one(None, zids=["ab"]), who=None, own={"id": "ab"})
    yield named("B22", "no", one(None, zids=["ab"]), who=None, own={"id": "cd"}, ours="yes")  # who attacks chooses it
    yield named("B23", "no", one(["/random "]))
    yield named("C19", "yes", access(denied, default="allow"), key="**")
    yield named("C20", "yes", access(denied, ({}, []), default="allow"))
    yield named("C21", "no", access(denied, default="allow"))


def _users(root: Path) -> Iterator[Any]:
    """Names and passwords at a router, of which nothing is known to us: `users` in the keystore has them."""
    put = [allow(K, "put"), allow("0/**", "declare_subscriber")]
    alice = access(({"usernames": ["alice"]}, put), ({"usernames": ["reader"]}, put))
    for name, measured, user, section in (
        ("B24", "yes", ("alice", "1"), {}), ("B25", "no", ("alice", "2"), {}), ("B26", "no", None, {}),
        ("B27", "yes", ("alice", "1"), alice), ("B28", "no", ("bob", "2"), alice),
    ):  # fmt: skip

        def make(a: str, _b: str, name: str = name, said: str = measured, user: Any = user, own: Any = section) -> Case:
            asking = {"transport": {"auth": {"usrpwd": {"dictionary_file": f"{root / 'users'}"}}}}
            router = session("router", listen=[f"tcp/{a}"], **asking, **own)
            theirs = session(connect=[f"tcp/{a}"], **_known("reader", "3"))
            mine = session(connect=[f"tcp/{a}"], **(_known(*user) if user is not None else {}))
            there = {"router": router, "whom": theirs, "who": mine}
            return Case(name, said, there, ("router", "whom"), "who", "whom", ours="unknown")

        yield make


def _namespaced() -> Iterator[Any]:
    """Sessions whose keys have a namespace in front, which rules see; to us what passes them is not known."""
    for name, measured, written in (("E25", "no", "0/chatter/**"), ("E26", "yes", "robot1/0/chatter/**")):

        def make(a: str, _b: str, name: str = name, said: str = measured, keys: str = written) -> Case:
            router = session("router", listen=[f"tcp/{a}"], **access(({}, [allow(keys)])))
            own = session(connect=[f"tcp/{a}"], namespace="robot1")
            there = {"router": router, "whom": own, "who": own}
            return Case(name, said, there, (*there,), "who", "whom", ours="unknown")

        yield make


def _known(user: str, password: str) -> Configuration:
    return {"transport": {"auth": {"usrpwd": {"user": user, "password": password}}}}


def _routers() -> Iterator[Any]:
    """Rules of a router between two clients without certificates."""

    def routed(name: str, measured: str, section: Configuration, does: str = "put", key: str = K, at: str = K) -> Any:
        def make(a: str, _b: str) -> Case:
            router = session("router", listen=[f"tcp/{a}"], **section)
            there = {"router": router, "whom": session(connect=[f"tcp/{a}"]), "who": session(connect=[f"tcp/{a}"])}
            return Case(name, measured, there, ("router", "whom"), "who", "whom", does, key, at)

        return make

    def everybody(*rules: Any, default: str = "deny") -> Configuration:
        return access(({}, rules), default=default)

    tcp = {"link_protocols": ["tcp"]}
    put, rest = allow(K, "put"), allow("0/**", "declare_subscriber", "query", "reply", "declare_queryable")
    yield routed("C01", "no", everybody(allow("0/other/**")))
    yield routed("C02", "yes", everybody(deny("0/other/**"), default="allow"))
    yield routed("C03", "no", everybody(allow(K, "put", flows=["ingress"]), rest))
    yield routed("C04", "no", everybody(put, rest, deny(K, "put")))
    yield routed("C05", "no", everybody(deny(K, "put"), put, rest))
    yield routed("C06", "no", everybody(deny(K, "put"), put, rest, default="allow"))
    yield routed("C07", "no", everybody(deny("0/**", "put"), put, rest))
    yield routed("C09", "yes", access((tcp, [deny(K, "put")]), ({}, [put, rest])))
    yield routed("C10", "yes", access((tcp, [deny(K, "put")]), ({}, [allow("0/other/**")]), default="allow"))
    yield routed("C11", "no", access((tcp, [deny(K, "put")]), (tcp, [put, rest])))
    yield routed("C12", "yes", everybody(deny(K, "put"), default="allow"), key="0/*/T/H")
    subscribing = everybody(deny(K, "declare_subscriber", flows=["ingress"]), default="allow")
    yield routed("C13", "yes", subscribing, "read", "0/**")
    yield routed("C14", "no", subscribing, "read")
    yield routed("C15", "no", everybody(allow("0/chatter/**")), "read", "0/**")
    querying = everybody(deny(K, "query"), default="allow")
    yield routed("C16", "yes", querying, "get", "0/**")
    yield routed("C17", "no", querying, "get")
    yield routed("C18", "no", everybody(deny("0/chatter/**", "put", flows=["egress"]), default="allow"))
    yield routed("D01", "no", everybody(deny(K, "put"), default="allow"))
    yield routed("E01", "no", everybody(put, rest), "delete")
    yield routed("E02", "yes", everybody(deny(K, "put"), default="allow"), "delete")
    yield routed("E22", "yes", everybody(deny(K, "put", flows=["egress"]), default="allow"), "delete")
    yield routed("E11", "no", everybody(put, allow("0/**", "query")))
    yield routed("E20", "yes", everybody(deny(K, "put"), rest), "answer")
    yield routed("E04", "no", everybody(allow("0/**", "query", "reply")), "answer")
    yield routed("E23", "no", everybody(allow("0/chatter/**", "put", "declare_subscriber")), "answer", "0/chatter/**")
    token = "@ros2_lv/0/z/0"
    yield routed("E07", "no", everybody(("allow", [*_TOKENS], None, ["**"])), "token", token, token)
    yield routed("E13", "yes", everybody(("allow", [*_TOKENS], None, ["@ros2_lv/0/**"])), "token", token, token)
    yield routed("G09", "no", everybody(deny(K, "put"), default="allow"))
    unsaid = everybody(allow("0/other/**"), allow("0/**", "declare_subscriber"))
    del unsaid["access_control"]["default_permission"]
    yield routed("G22", "no", unsaid)
    unnamed = everybody(allow("0/other/**"), deny(K, "put"), default="allow")
    unnamed["access_control"]["policies"][0]["rules"].pop()
    yield routed("G23", "yes", unnamed)
    yield routed("G21", "yes", access(({}, [deny("0/**")]), enabled=False))
    yield routed("G24", "yes", access(({}, [deny("0/**")]), default="allow", policies=[]))
    yield routed("G25", "no", access(({}, [allow("0/**")]), policies=[]))


def _admin() -> Iterator[Any]:
    """Whether somebody reads what a router says of itself. We tell who may ask it, not whether it says anything."""
    open_space = {"adminspace": {"enabled": True}}
    for name, measured, section in (
        ("E12", "yes", open_space), ("E14", "yes", {**open_space, **access(({}, [deny("**")]), default="allow")}),
        ("E17", "no", {}), ("E18", "no", {"adminspace": {"enabled": False}}),
    ):  # fmt: skip

        def make(a: str, _b: str, name: str = name, said: str = measured, section: Configuration = section) -> Case:
            there = {"whom": session("router", listen=[f"tcp/{a}"], **section), "who": session(connect=[f"tcp/{a}"])}
            return Case(name, said, there, ("whom",), "who", "whom", "ask", "@/**", "@/**", ours="yes")

        yield make


_TOKENS = ("liveliness_token", "liveliness_query", "declare_liveliness_subscriber")


def _tools() -> Iterator[Any]:
    """Files as zenoh_security_tools makes them, between two peers or through its router."""

    def made(
        name: str, measured: str, whom: Configuration, who: Configuration | None, does: str = "put", key: str = K,
        at: str = K, *, router: bool = False,
    ) -> Any:  # fmt: skip
        def make(a: str, _b: str) -> Case:
            listens = {"listen": [f"tcp/{a}"]}
            there = {"router": session("router", **listens)} if router else {}
            theirs = session("client", connect=[f"tcp/{a}"], **whom) if router else session("peer", **listens, **whom)
            mine = session("client" if router else "peer", connect=[f"tcp/{a}"], **(who or {}))
            files = (*there, "whom", *(("who",) if who is not None else ()))
            return Case(name, measured, {**there, "whom": theirs, "who": mine}, files, "who", "whom", does, key, at)

        return make

    talker, listener = tool(publish="chatter"), tool(subscribe="chatter")
    yield made("D09", "yes", listener, talker)
    yield made("D10", "no", listener, tool(publish="other"))
    yield made("D11", "yes", listener, None)
    yield made("D12", "yes", talker, None, "read")
    yield made("D13", "no", listener, None, key="0/other/T/H", at="0/other/T/H")
    yield made("D15", "yes", listener, talker, router=True)
    yield made("D17", "yes", tool(reply="chatter"), None, "get")
    yield made("D18", "yes", tool(request="chatter"), None, "answer")
    yield made("D27", "no", listener, None, key="0/**")
    yield made("D28", "no", talker, None, "read", "**")
    longer = "0/chatter/secret/T/H"
    yield made("D30", "yes", tool(subscribe="chatter", tail="/**"), None, key=longer, at=longer)
    yield made("D31", "no", listener, None, key=longer, at=longer)
    deep, deeper = "0/a/b/T/H", "0/a/b/c/T/H"
    yield made("D33", "yes", tool(subscribe="*", tail="/**"), None, key=deeper, at=deeper)
    yield made("D34", "no", tool(subscribe="*"), None, key=deep, at=deep)
    cached = f"{K}/@adv/pub/1/2/3"
    yield made("E16", "no", tool(publish="chatter", tail="/**"), None, "get", cached, cached)
    yield made("E19", "no", talker, None, "get", cached, cached)
    yield made("D45", "yes", listener, None, router=True)
    yield made("D46", "no", listener, tool(publish="other"), router=True)
    yield made("E24", "yes", listener, None, "token", "@ros2_lv/0/z/0", "@ros2_lv/0/z/0")
    yield made("E09", "yes", talker, None, "see", "@ros2_lv/0/**", "@ros2_lv/0/z/0")
