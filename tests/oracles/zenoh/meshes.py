"""What was measured where several processes pass on, meet by themselves, or take somebody for their router."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.oracles.zenoh.case import Case, K
from tests.oracles.zenoh.deployment import ALL, Configuration, access, allow, deny, session, tls, tool


def meshes(root: Path) -> Iterator[Any]:
    """Functions of two addresses, each of which gives a case."""
    for some in (_meshes(root), _modes(), _announced(root), _impostors(root), _led(root), iter([_multicast])):
        yield from some


def _meshes(root: Path) -> Iterator[Any]:
    """Certificates, a router and peers."""

    def meshed(
        name: str, measured: str, who: str, *, router: Configuration | None = None, whom: Configuration | None = None,
        mode: str = "client", gossip: bool = False, does: str = "put", key: str = K, honest: bool = False,
        of: str = "listener",
    ) -> Any:  # fmt: skip
        def make(a: str, b: str) -> Case:
            shared: dict[str, Any] = {"connect": [f"tls/{a}"], "gossip": gossip}
            listens = {"listen": [f"tls/{b}"]} if mode == "peer" else {}
            there = {
                "router": session(
                    "router", listen=[f"tls/{a}"], gossip=gossip, **tls(root, "zenohd"), **(router or {})
                ),
                "whom": session(mode, **shared, **listens, **tls(root, of), **(whom or {})),
                "who": session(mode, **shared, **({"listen": ["tls/127.0.0.1:0"]} if mode == "peer" else {}),
                               **tls(root, who)),
            }  # fmt: skip
            files = ("router", "whom", "who") if honest else ("router", "whom")
            return Case(name, measured, there, files, "who", "whom", does, key, as_if=who)

        return make

    talker, listener = {"cert_common_names": ["/talker"]}, {"cert_common_names": ["/listener"]}
    sends = [allow(K, "put", flows=["ingress"]), allow(K, "declare_subscriber", flows=["egress"])]
    takes = [allow(K, "put", flows=["egress"]), allow(K, "declare_subscriber", flows=["ingress"])]
    star = access((talker, sends), (listener, takes))
    everything = access(({}, [deny("0/**")]))
    yield meshed("D04", "no", "random", router=everything, honest=True)
    yield meshed("D02", "yes", "random", router=everything, mode="peer", gossip=True, honest=True)
    yield meshed("D05", "no", "random", mode="peer", honest=True)
    yield meshed("D35", "no", "random", router=star)
    yield meshed("D36", "yes", "talker", router=star)
    yield meshed("D37", "no", "random", router=star, does="read", of="talker")
    yield meshed("D37-listener", "yes", "listener", router=star, does="read", of="talker")
    yield meshed("D38", "no", "random", router=star, does="read", key="**", of="talker")
    yield meshed("D40", "yes", "random", router=star, whom=tool(subscribe="chatter"), mode="peer", gossip=True)
    yield meshed("D39", "yes", "random", router=star, mode="peer", gossip=True)
    yield meshed("D21", "no", "talker", whom=access((talker, [allow("0/**")])))
    through = access(({"cert_common_names": ["/zenohd"]}, [allow("0/**")]))
    yield meshed("D22", "yes", "random", whom=through)
    yield meshed("D42", "no", "random", whom=access((talker, [allow("0/**")])), mode="peer", gossip=True)
    yield meshed("D43", "yes", "talker", whom=access((talker, [allow("0/**")])), mode="peer", gossip=True)


def _modes() -> Iterator[Any]:
    """Who passes on: three sessions in a row, the second of which listens; and what a receiver has to say."""
    for first, second, third, measured in (
        ("client", "peer", "peer", "yes"), ("client", "peer", "client", "yes"), ("peer", "peer", "peer", "no"),
        ("peer", "peer", "client", "yes"), ("client", "router", "peer", "yes"), ("peer", "router", "client", "yes"),
        ("peer", "router", "peer", "no"), ("router", "router", "peer", "yes"), ("router", "peer", "peer", "no"),
    ):  # fmt: skip

        def make(a: str, _b: str, modes: tuple[str, str, str] = (first, second, third), said: str = measured) -> Case:
            ends = [{} if mode == "client" else {"listen": ["tcp/127.0.0.1:0"]} for mode in modes]
            there = {
                "between": session(modes[1], listen=[f"tcp/{a}"]),
                "whom": session(modes[2], connect=[f"tcp/{a}"], **ends[2]),
                "who": session(modes[0], connect=[f"tcp/{a}"], **ends[0]),
            }
            return Case(f"P-{'-'.join(modes)}", said, there, tuple(there), "who", "whom")

        yield make
    for mode, measured in (("client", "yes"), ("peer", "no")):

        def silent(a: str, _b: str, mode: str = mode, said: str = measured) -> Case:
            section = access(({}, [deny(K, "declare_subscriber", flows=["egress"])]), default="allow")
            theirs = session("peer", listen=[f"tcp/{a}"], **section)
            mine = session(mode, connect=[f"tcp/{a}"])
            return Case(f"S-{mode}", said, {"whom": theirs, "who": mine}, ("whom", "who"), "who", "whom")

        yield silent
    for mode, measured in (("client", "no"), ("peer", "no"), ("router", "yes")):

        def listening(a: str, _b: str, mode: str = mode, said: str = measured) -> Case:
            """A peer hears of no reader: it sends to a router all the same."""
            theirs = session("peer", listen=[f"tcp/{a}"], **access(({}, [allow(K, "put", flows=["egress"])])))
            ends = {} if mode == "client" else {"listen": ["tcp/127.0.0.1:0"]}
            mine = session(mode, connect=[f"tcp/{a}"], **ends)
            return Case(f"R-{mode}", said, {"whom": theirs, "who": mine}, ("whom",), "who", "whom", "read")

        yield listening


def _announced(root: Path) -> Iterator[Any]:
    """A peer with TLS hears of a plain address: by gossip of the router, or by multicast of anybody."""
    anybody = access(({"link_protocols": ["tcp"]}, [allow("0/**")]))
    for name, limited, scouted, measured in (
        ("N1", False, False, "yes"),
        ("N2", True, False, "no"),
        ("N3", False, True, "yes"),
        ("N4", True, True, "no"),
    ):

        def make(
            a: str, b: str, name: str = name, limited: bool = limited, scouted: bool = scouted, said: str = measured
        ) -> Case:
            secured = tls(root, "listener")
            secured["transport"]["link"] |= {"protocols": ["tls"]} if limited else {}
            scouting = {"scouting": {"multicast": {"enabled": scouted}, "gossip": {"enabled": True}}}
            ends = {} if scouted else {"connect": [f"tls/{a}"]}
            theirs = session("peer", listen=["tls/127.0.0.1:0"], **ends, **secured, **anybody)
            mine = session("peer", listen=[f"tcp/{b}"], **ends, **({} if scouted else tls(root, "random")))
            there = {"whom": theirs | scouting, "who": mine | scouting}
            there |= (
                {}
                if scouted
                else {"router": session("router", listen=[f"tls/{a}"], gossip=True, **tls(root, "zenohd"))}
            )
            files = tuple(each for each in there if each != "who")
            return Case(name, said, there, files, "who", "whom", as_if=None if scouted else "random")

        yield make


def _impostors(root: Path) -> Iterator[Any]:
    """Somebody waits where a session takes him for its router, unchecked: its rules go by the name that he shows."""
    rules = [allow("0/**", *ALL)]
    for name, mode, who, does, measured in (
        ("I1", "client", "named", "put", "yes"), ("I2", "client", "random", "put", "no"),
        ("I3", "client", "named", "read", "yes"), ("I4", "client", "random", "read", "no"),
        ("I5", "peer", "random", "put", "no"), ("I6", "peer", "random", "read", "no"),
        ("I7", "client", "random", "answer", "no"), ("I8", "client", "random", "get", "no"),
    ):  # fmt: skip

        def make(
            a: str, _b: str, name: str = name, mode: str = mode, who: str = who, does: str = does, said: str = measured
        ) -> Case:
            own = access(({"cert_common_names": ["/named"]}, rules))
            theirs = session(mode, connect=[f"tls/{a}"], **tls(root, "listener"), **own)
            mine = session("router", listen=[f"tls/{a}"], **tls(root, who))
            return Case(name, said, {"whom": theirs, "who": mine}, ("whom", "who"), "who", "whom", does)

        yield make


def _led(root: Path) -> Iterator[Any]:
    """A session connects to where somebody else than meant listens, who is a peer, or takes him for its router."""
    to_talker = access(({"cert_common_names": ["/talker"]}, [allow("0/**", *ALL)]))
    for name, mode, who, section, measured in (
        ("A15", "router", "random", {}, "yes"),
        ("D24", "peer", "talker", to_talker, "yes"), ("D25", "peer", "random", to_talker, "no"),
    ):  # fmt: skip

        def make(
            a: str,
            _b: str,
            name: str = name,
            mode: str = mode,
            who: str = who,
            own: Any = section,
            said: str = measured,
        ) -> Case:
            theirs = session("peer", connect=[f"tls/{a}"], **tls(root, "listener"), **own)
            mine = session(mode, listen=[f"tls/{a}"], **tls(root, who))
            return Case(name, said, {"whom": theirs, "who": mine}, ("whom", "who"), "who", "whom")

        yield make


def _multicast(a: str, _b: str) -> Case:
    """Whoever hears a group is linked by it, and no rule counts there."""
    ends = {"listen": [f"udp/224.0.0.225:{a.rpartition(':')[2]}#iface=lo"]}
    theirs = session("peer", **ends, **access(({}, [deny("0/**")])))
    return Case("D44", "yes", {"whom": theirs, "who": session("peer", **ends)}, ("whom",), "who", "whom")
