"""What the configuration of a process says, and why it would be refused: the file alone, whoever it is of.

Sources: commons/zenoh-config of eclipse-zenoh/zenoh for the meaning of fields, and `fields.json` (asked of the
releases) for which exist. Defaults are those of `Config::default` and of the session's `open`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from enum import Enum
from functools import cache
from ipaddress import IPv4Address, IPv6Address, ip_address
from pathlib import Path
from typing import Final

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.intent.source import Value, shown
from keystore_audit.keystore.defect import Malformed
from keystore_audit.model.matching import key_expressions
from keystore_audit.zenoh.access_control import AccessControl, Rule, read_access_control
from keystore_audit.zenoh.json5 import Unclear, find, items, parse_json5

PROTOCOLS: Final = ("tcp", "udp", "tls", "quic", "ws")
"""Links whose ends are hosts and ports; of others (serial, unixsock-stream, vsock, shared memory) nothing is known."""
SECURED: Final = ("tls", "quic")
"""Those that authenticate by certificates."""
_ENDPOINT: Final = re.compile(r"([^/?#]+)/([^?#]+)(?:\?[^#]*)?(?:#(.*))?", re.DOTALL)
_ZID: Final = re.compile(r"(?=.*[1-9a-f])[0-9a-f]{1,32}")
_SECRETS: Final = re.compile(r"private_key_(?:base64|pem|raw)|password")
_BASE64: Final = re.compile(r"certificate_(?:base64|raw)")


class Mode(str, Enum):
    """What a process is in the network."""

    ROUTER = "router"
    PEER = "peer"
    CLIENT = "client"


class Refusal(Struct, frozen=True, kw_only=True):
    """Why a process with the configuration does not start. `reason`: a sentence without its end. `releases`: those of
    `fields.json` that refuse it; none: all.
    """

    line: int | None
    reason: str
    releases: tuple[str, ...] = ()


class Endpoint(Struct, frozen=True, kw_only=True):
    """Where a process listens or connects to. `options`: what its fragment says in place of the section tls."""

    line: int
    text: str
    protocol: str
    host: str
    port: str
    options: Mapping[str, str]

    @property
    def multicast(self) -> bool:
        """Whether all that hear it are linked (no access control is applied there: measured)."""
        address = _address(self.host)
        return self.protocol == "udp" and address is not None and address.is_multicast

    @property
    def loopback(self) -> bool:
        """Whether only processes of the same host reach it."""
        address = _address(self.host)
        return self.host == "localhost" or (address is not None and address.is_loopback)

    @property
    def anywhere(self) -> bool:
        """Whether it is every address of the host."""
        address = _address(self.host)
        return address is not None and address.is_unspecified


def _address(host: str) -> IPv4Address | IPv6Address | None:
    try:
        return ip_address(host)
    except ValueError:
        return None


class Configuration(Struct, frozen=True, kw_only=True):
    """What a file says. `whole`: its values; of a file that was not read, None, and why is a refusal or unclear."""

    whole: Value | None = None
    mode: Mode = Mode.PEER
    listens: tuple[Endpoint, ...] = ()
    connects: tuple[Endpoint, ...] = ()
    gossip: bool = True
    multicast: bool = True
    brokering: bool = False
    plain: bool = True
    """Whether links without TLS may come about: transport/link/protocols leaves some."""
    access: AccessControl | None = None
    """None: whoever has a link may do anything."""
    undecided: bool = False
    """Whether what passes its links is not known."""
    secrets: tuple[int, ...] = ()
    """Lines with a password or a private key."""
    refusals: tuple[Refusal, ...] = ()
    unclear: tuple[tuple[int | None, str], ...] = ()
    """What cannot be told: line and reason."""

    @property
    def seeks(self) -> bool:
        """Whether it connects to announced processes: peers do, by gossip and by multicast."""
        return self.mode is Mode.PEER and (self.multicast or (self.gossip and bool(self.connects)))

    @property
    def starts(self) -> bool:
        """Whether some release starts with it."""
        return not any(not each.releases for each in self.refusals)

    @property
    def rules(self) -> tuple[Rule, ...]:
        """Those of its access control, where it has one."""
        return self.access.rules if self.access is not None else ()

    def find(self, *path: str) -> Value | None:
        """The value there; None where there is none, or null."""
        return find(self.whole, *path)

    def tls(self, endpoint: Endpoint | None, name: str) -> tuple[str | bool | None, int | None]:
        """What holds of a link of the section tls, and its line: the endpoint's fragment wins (measured)."""
        option = name if name.startswith(("enable", "verify", "close")) else f"{name}_file"
        if endpoint is not None and option in endpoint.options:
            said = endpoint.options[option]
            return {"true": True, "false": False}.get(said, said), endpoint.line
        value = self.find("transport", "link", "tls", name)
        content = value.content if value is not None else None
        return (content if isinstance(content, (str, bool)) else None), value.line if value is not None else None

    def mutual(self, endpoint: Endpoint) -> bool:
        """Whether the link's two ends know each other's certificates."""
        return endpoint.protocol in SECURED and self.tls(endpoint, "enable_mtls")[0] is True


class _Fields(Struct, frozen=True):
    """`fields.json`, which says itself what is in it."""

    versions: tuple[str, ...]
    fields: dict[str, str]
    needed: dict[str, tuple[str, ...]]
    words: dict[str, tuple[str, ...]]
    lacking: dict[str, tuple[str, ...]]


@cache
def _fields() -> _Fields:
    return msgspec.json.decode(Path(__file__).with_name("fields.json").read_bytes(), type=_Fields)


def read_configuration(text: str) -> Configuration:
    """Read the text of a file in JSON5. Never raises: what is wrong with it is in the result."""
    try:
        whole = parse_json5(text)
    except Malformed as error:
        return Configuration(refusals=(Refusal(line=error.line, reason=error.detail),))
    except Unclear as error:
        return Configuration(undecided=True, unclear=((None, f"{error}"),))
    refusals = tuple(_refused(whole, ""))
    secrets = tuple(dict.fromkeys(_secrets(whole, "")))
    if refusals and any(not each.releases for each in refusals):
        return Configuration(whole=whole, refusals=refusals, secrets=secrets)
    return _meant(whole, refusals, secrets)


_KINDS: Final = ((bool, "b"), ((int, float), "n"), (str, "s"), (tuple, "lL"), (Mapping, "o"), (type(None), "z"))
_CALLED: Final = {"b": "a boolean", "n": "a number", "s": "a text", "l": "a list", "L": "a list", "o": "an object"}


def _refused(value: Value, path: str) -> Iterator[Refusal]:
    """Why a value and what is in it would be refused."""
    fields = _fields()
    kinds = fields.fields[path] if path else "o"
    content = value.content
    letters = next(letters for kind, letters in _KINDS if isinstance(content, kind))
    named = path.replace("/[]", "") or "the file"
    if not {*letters} & {*kinds}:
        wanted = " or ".join(dict.fromkeys(_CALLED[each] for each in kinds if each in _CALLED))
        yield Refusal(line=value.line, reason=f"{named} is {_CALLED.get(letters[0], 'null')}, expected {wanted}")
    elif isinstance(content, str) and content not in fields.words.get(path, (content,)):
        yield Refusal(line=value.line, reason=f"{named} is {shown(content)}, which it cannot be")
    elif isinstance(content, tuple) and not content and "L" in kinds:
        yield Refusal(line=value.line, reason=f"{named} is an empty list")
    elif "*" not in kinds and isinstance(content, tuple):
        for each in content:
            yield from _refused(each, f"{path}/[]")
    elif "*" not in kinds and isinstance(content, Mapping):
        yield from _refused_object(value, content, path)


def _refused_object(value: Value, content: Mapping[str, Value], path: str) -> Iterator[Refusal]:
    fields = _fields()
    named = path.replace("/[]", "") or "the file"
    for key in value.repeated:
        yield Refusal(line=key.line, reason=f"{named} has {shown(str(key.content))} twice")
    for name in fields.needed.get(path, ()):
        if name not in content:
            yield Refusal(line=value.line, reason=f"{named} has no {name}")
    for name, each in content.items():
        below = f"{path}/{name}" if path else name
        if below not in fields.fields or name == "[]":
            yield Refusal(line=each.line, reason=f"{named} knows no field {shown(name)}")
        else:
            if below in fields.lacking and each.content is not None:
                yield Refusal(line=each.line, reason=f"{named} knows no {name} yet", releases=fields.lacking[below])
            yield from _refused(each, below)


def _secrets(value: Value, name: str) -> Iterator[int]:
    """The lines of what should stand in no configuration."""
    if isinstance(value.content, Mapping):
        for key, each in value.content.items():
            yield from _secrets(each, key)
    elif isinstance(value.content, tuple):
        for each in value.content:
            yield from _secrets(each, name)
    elif isinstance(value.content, str) and value.content:
        text = value.content
        held = _SECRETS.search(name) or "PRIVATE KEY-----" in text or (name == "endpoints" and _SECRETS.search(text))
        if held:
            yield value.line


def _meant(whole: Value, refusals: tuple[Refusal, ...], secrets: tuple[int, ...]) -> Configuration:
    """What a file says that is well formed."""
    unclear = [*_unclear(whole)]
    undecided = bool(unclear)
    unclear += _added(whole)
    refused = [*refusals]
    said = find(whole, "mode")
    mode = Mode(said.content) if said is not None else Mode.PEER
    access = None
    try:
        access = read_access_control(find(whole, "access_control"))
    except Malformed as error:
        refused.append(Refusal(line=error.line, reason=error.detail))
    except Unclear as error:
        unclear.append((None, f"{error}"))
        undecided = True
    refused += [
        Refusal(line=value.line, reason=f"{shown(f'{value.content}')} is no key expression: {wrong}")
        for each in items(find(whole, "access_control", "rules"))
        for value in items(find(each, "key_exprs"))
        if (wrong := key_expressions.wrong_with(f"{value.content}"))
    ]
    refused += [
        Refusal(line=value.line, reason=f"{shown(f'{value.content}')} is no id of a session")
        for value in (*_said(whole, "id"), *_zids(whole))
        if not _ZID.fullmatch(f"{value.content}")
    ]
    listens = _endpoints(whole, "listen", mode, refused, unclear)
    connects = _endpoints(whole, "connect", mode, refused, unclear)
    limited = find(whole, "transport", "link", "protocols")
    protocols = {each.content for each in items(limited)} if limited is not None else None
    refused += [
        Refusal(line=each.line, reason=f"the endpoint {shown(each.text)} is of no protocol of transport/link")
        for each in (*listens, *connects)
        if protocols is not None and each.protocol not in protocols
    ]
    made = Configuration(
        whole=whole,
        mode=mode,
        listens=listens if mode is not Mode.CLIENT else (),
        connects=connects,
        gossip=_flag(find(whole, "scouting", "gossip", "enabled"), default=True),
        multicast=_flag(find(whole, "scouting", "multicast", "enabled"), default=True),
        brokering=_flag(find(whole, "routing", "router", "peers_failover_brokering"), default=False),
        plain=protocols is None or not protocols <= {*SECURED},
        access=access,
        undecided=undecided,
        secrets=secrets,
        refusals=tuple(refused),
        unclear=tuple(unclear),
    )
    rootless = [end for end in made.listens if made.mutual(end) and made.tls(end, "root_ca_certificate")[0] is None]
    lacking = (Refusal(line=end.line, reason=f"{shown(end.text)} has no root_ca_certificate") for end in rootless)
    return replace(made, refusals=(*made.refusals, *lacking)) if rootless else made


def _flag(value: Value | None, *, default: bool) -> bool:
    return default if value is None else value.content is True


def _zids(whole: Value) -> Iterator[Value]:
    for each in items(find(whole, "access_control", "subjects")):
        yield from items(find(each, "zids"))


def _said(whole: Value, name: str) -> tuple[Value, ...]:
    value = find(whole, name)
    return () if value is None else (value,)


def _unclear(whole: Value) -> Iterator[tuple[int | None, str]]:
    """What says that it is not known what passes: more than its access control says, or less."""
    for path, what in (
        (("namespace",), "every key of the process has a namespace in front"),
        (("gateway",), "a gateway between regions"),
        (("region_name",), "regions of the network"),
        (("transport", "auth", "pubkey", "private_key_file"), "links are authenticated by bare public keys"),
        (("transport", "auth", "usrpwd", "dictionary_file"), "links are authenticated by names and passwords"),
        (("transport", "auth", "usrpwd", "user"), "links are authenticated by names and passwords"),
    ):
        value = find(whole, *path)
        if value is not None and value.content != {}:
            yield value.line, what


def _added(whole: Value) -> Iterator[tuple[int | None, str]]:
    """What says that more than is known here takes part."""
    plugins = find(whole, "plugins")
    if plugins is not None and plugins.content != {}:
        yield plugins.line, "plugins take part in what the process does"
    loading = find(whole, "plugins_loading", "enabled")
    if loading is not None and loading.content is True:
        yield loading.line, "plugins are loaded"
    tls = find(whole, "transport", "link", "tls")
    if tls is not None and isinstance(tls.content, Mapping):
        for name, value in tls.content.items():
            if _BASE64.search(name) and value.content:
                yield value.line, "a certificate stands in the file itself, which is not read"


def _endpoints(
    whole: Value, which: str, mode: Mode, refused: list[Refusal], unclear: list[tuple[int | None, str]]
) -> tuple[Endpoint, ...]:
    """The endpoints that count in this mode, those of the implementation where none are said."""
    value = find(whole, which, "endpoints")
    if value is None and which == "listen":
        port = {Mode.ROUTER: "7447", Mode.PEER: "0"}.get(mode)
        plain = f"tcp/[::]:{port}"
        return (Endpoint(line=1, text=plain, protocol="tcp", host="::", port=port, options={}),) if port else ()
    if value is not None and isinstance(value.content, Mapping):
        own = value.content.get(mode.value)
        if own is None and which == "listen" and mode is not Mode.CLIENT:
            unclear.append((value.line, f"where it listens as a {mode.value} is left out"))
        value = own
    found = []
    for each in items(value):
        text = each.content
        match = _ENDPOINT.fullmatch(text) if isinstance(text, str) else None
        if not isinstance(text, str):
            unclear.append((each.line, "an endpoint of several addresses"))
        elif match is None:
            refused.append(Refusal(line=each.line, reason=f"{shown(text)} is no endpoint"))
        else:
            found.append(_endpoint(each.line, text, match))
            if found[-1].protocol not in PROTOCOLS:
                unclear.append((each.line, f"a link of the protocol {shown(found[-1].protocol)}"))
            elif any(_BASE64.search(name) for name in found[-1].options):
                unclear.append((each.line, "a certificate stands in the endpoint, which is not read"))
    return tuple(found)


def _endpoint(line: int, text: str, match: re.Match[str]) -> Endpoint:
    protocol, address, fragment = match.groups()
    host, _colon, port = address.rpartition(":")
    pairs = (each.partition("=") for each in (fragment or "").split(";") if each)
    return Endpoint(
        line=line,
        text=text,
        protocol=protocol,
        host=host.removeprefix("[").removesuffix("]"),
        port=port,
        options={name: value for name, _sign, value in pairs},
    )
