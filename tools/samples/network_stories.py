"""Pairs for KA8: a keystore, and the files that its sessions and routers start with (`sample_keystores/networks/`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from msgspec.structs import replace

from keystore_audit.keystore.layout import Role
from keystore_audit.zenoh.suggested import Configuration, process, secured
from keystore_audit.zenoh.suggested import written as as_file

from .base import IDENTITY_CA, LISTENER, LISTENER_CERTIFICATE, TALKER, TALKER_CERTIFICATE, TWO
from .certificates import Certificate
from .documents import DISCOVERY, Grant, Permissions, Rule
from .identity_stories import STOLEN, revocation_list
from .keys import Key
from .store import Enclave, Store
from .story import Case, Story, pair

Network = Mapping[str, Configuration]

HOST = "localhost"
"""For which the certificates are: without a name nobody can check whom he reached (KA811)."""

KEYSTORE = "/etc/keystore"
"""Where it is on the robot."""


def _third(path: str, *rules: Rule) -> Enclave:
    own = Certificate(key=Key(label=f"rules {path}"), subject=path, issuer=IDENTITY_CA, host=HOST)
    grant = Grant(path=path, rules=(*rules, DISCOVERY))
    return Enclave(path=path, certificate=own, permissions=Permissions(grants=(grant,)))


PAIR = replace(
    TWO,
    enclaves=(
        replace(TALKER, certificate=replace(TALKER_CERTIFICATE, host=HOST)),
        replace(LISTENER, certificate=replace(LISTENER_CERTIFICATE, host=HOST)),
    ),
)
"""/talker and /listener, whose certificates name the host."""

NEXT_CA = Certificate(key=Key(label="rules next identity CA"), subject="identityCA", ca=True, path_length=1)
"""That all identities may be made by anew."""

WITH_RANDOM = replace(PAIR, enclaves=(*PAIR.enclaves, _third("/random", Rule(publish=("rt/random",)))))
WITH_ROUTER = replace(PAIR, enclaves=(*PAIR.enclaves, _third("/zenohd", Rule(publish=("rt/zenohd",)))))

CHATTER = "0/chatter/*/*"
OPENS = "tls/localhost:7449"


def files_of(name: str) -> Mapping[Role, str]:
    """Where those of an enclave are on the robot."""
    return {role: f"{KEYSTORE}/enclaves/{name}/{role.value}.pem" for role in Role}


def tls(name: str, **changed: Any) -> Configuration:
    """The section of an enclave."""
    made = secured(files_of(name))
    made["link"]["tls"] |= changed
    return made


def rule(name: str, messages: Sequence[str], flow: str, key: str = CHATTER, permission: str = "allow") -> Configuration:
    """A rule about one flow."""
    return {"id": name, "permission": permission, "messages": [*messages], "flows": [flow], "key_exprs": [key]}


def access(subject: Configuration, *rules: Configuration, default: str = "deny") -> Configuration:
    """Access control with one subject."""
    return {
        "enabled": True,
        "default_permission": default,
        "rules": [*rules],
        "subjects": [{"id": "others", **subject}],
        "policies": [{"rules": [each["id"] for each in rules], "subjects": ["others"]}],
    }


SENDS = (rule("publications", ["put"], "egress"), rule("subscriptions", ["declare_subscriber"], "ingress"))
TAKES = (rule("publications", ["put"], "ingress"), rule("subscriptions", ["declare_subscriber"], "egress"))


def named(*names: str) -> Configuration:
    """A subject: the enclaves of these names."""
    return {"cert_common_names": [*names]}


def session(name: str, **changed: Any) -> Configuration:
    """A peer that listens nowhere, linked with whoever it connects to."""
    return process(files_of(name), **changed)


def talker(**changed: Any) -> Configuration:
    """It listens, and sends to /listener."""
    return session(
        "talker", **{"listen": {"endpoints": [OPENS]}, "access_control": access(named("/listener"), *SENDS), **changed}
    )


def listener(**changed: Any) -> Configuration:
    """It connects to /talker, and takes from it."""
    return session(
        "listener", **{"connect": {"endpoints": [OPENS]}, "access_control": access(named("/talker"), *TAKES), **changed}
    )


GOOD: Network = {"talker": talker(), "listener": listener()}
"""Two peers that know each other by name: nobody else gets or sends anything."""


def stories() -> Iterator[Story]:
    """All pairs of KA8."""
    both = "Mutual TLS; rules by certificate names."
    for code, text, bad in (
        (
            "KA801",
            "/talker asks connecting processes for no certificate.",
            {"talker": talker(transport=tls("talker", enable_mtls=False))},
        ),
        (
            "KA802",
            "/talker listens without TLS as well.",
            {"talker": talker(listen={"endpoints": [OPENS, "tcp/[::]:7447"]}, transport=_any("talker"))},
        ),
        (
            "KA803",
            "/talker has a multicast endpoint, to which no rule applies.",
            {"talker": talker(listen={"endpoints": [OPENS, "udp/224.0.0.224:7446"]}, transport=_any("talker"))},
        ),
        ("KA804", "/listener lacks access control.", {"listener": session("listener", connect={"endpoints": [OPENS]})}),
        (
            "KA805",
            "/listener allows what no rule is about.",
            {"listener": listener(access_control=access(named("/talker"), *TAKES, default="allow"))},
        ),
        (
            "KA807",
            "/listener accepts /chatter from anybody, like files of zenoh_security_tools.",
            {"listener": listener(access_control=access({}, *TAKES))},
        ),
        (
            "KA811",
            "/listener does not check to whom it connects.",
            {"listener": listener(transport=tls("listener", verify_name_on_connect=False))},
        ),
        (
            "KA813",
            "Links of /talker outlive their certificates.",
            {"talker": talker(transport=tls("talker", close_link_on_expiration=False))},
        ),
        (
            "KA815",
            "/talker trusts the permissions CA to issue identities.",
            {
                "talker": talker(
                    transport=tls("talker", root_ca_certificate=f"{KEYSTORE}/public/permissions_ca.cert.pem")
                )
            },
        ),
        (
            "KA818",
            "/listener accepts /chatter from /talkr, which does not exist.",
            {"listener": listener(access_control=access(named("/talker", "/talkr"), *TAKES))},
        ),
        (
            "KA816",
            "/talker names the key of /listener beside its own certificate.",
            {"talker": talker(transport=tls("talker", listen_private_key=f"{KEYSTORE}/enclaves/listener/key.pem"))},
        ),
        (
            "KA817",
            "/talker names a certificate that is not in the keystore.",
            {"talker": talker(transport=tls("talker", listen_certificate=f"{KEYSTORE}/enclaves/talkr/cert.pem"))},
        ),
        (
            "KA820",
            "A rule of /listener has an invalid expression: it does not start.",
            {
                "listener": listener(
                    access_control=access(named("/talker"), rule("publications", ["put"], "ingress", "0/chat*/**"))
                )
            },
        ),
        ("KA825", "The file of /talker holds a password.", {"talker": talker(metadata={"password": "swordfish"})}),
    ):
        yield from _pair(code, Case(text, PAIR), {**GOOD, **bad}, both, GOOD)
    denying = (*TAKES, rule("nothing_else", ["put"], "ingress", "0/secret/*/*", "deny"))
    yield from _pair(
        "KA806",
        Case("/listener denies /secret and allows all else: a put on ** is neither.", PAIR),
        {**GOOD, "listener": listener(access_control=access(named("/talker"), *denying, default="allow"))},
        "The same rules, with default deny.",
        {**GOOD, "listener": listener(access_control=access(named("/talker"), *denying))},
    )
    unnamed = access(named("/talker"), *TAKES)
    unnamed["rules"].append(rule("forgotten", ["put"], "egress"))
    forgotten = {**GOOD, "listener": listener(access_control=unnamed)}
    yield from _pair("KA821", Case("No policy names a rule of /listener.", PAIR), forgotten, both, GOOD)
    yield from _pair("KA824", Case("/listener has no file.", PAIR), {"talker": talker()}, both, GOOD)
    scouted = {"scouting": {"multicast": {"enabled": True}}}
    yield from _pair(
        "KA810",
        Case("/talker connects by any protocol to whoever announces an address, even to anybody on the network.", PAIR),
        {**GOOD, "talker": talker(**scouted, transport=_any("talker"))},
        "It connects to whoever announces an address, but only with TLS.",
        {**GOOD, "talker": talker(**scouted)},
    )
    yield from _restrained()
    yield from _beyond()
    yield from _longer()
    graph = rule("graph", ["liveliness_token"], "ingress", "@ros2_lv/0/**")
    announced = access(named("/talker"), *TAKES, graph)
    announced["subjects"].append({"id": "anybody"})
    announced["policies"] = [
        {"rules": [each["id"] for each in TAKES], "subjects": ["others"]},
        {"rules": ["graph"], "subjects": ["anybody"]},
    ]
    yield from _pair(
        "KA835",
        Case("/listener lets anybody announce nodes.", PAIR),
        {**GOOD, "listener": listener(access_control=announced)},
        "/listener lets /talker announce nodes.",
        {**GOOD, "listener": listener(access_control=access(named("/talker"), *TAKES, graph))},
    )
    other = [rule(each["id"], each["messages"], each["flows"][0], "42/chatter/*/*") for each in TAKES]
    yield from _pair(
        "KA823",
        Case("The rules of /listener are for domain 42, those of /talker for domain 0.", PAIR),
        {**GOOD, "listener": listener(access_control=access(named("/talker"), *other))},
        both,
        GOOD,
    )
    yield from _routed()
    yaml = {"extra.yaml": b"mode: peer\n"}
    yield from _pair("KA826", Case("One file is YAML, which is not read.", PAIR), GOOD, both, GOOD, more=yaml)
    overridden = "A variable replaces values of every file: access_control/enabled=false."
    yield from _in_one_folder(
        "KA827",
        Case(overridden, PAIR, ("--env", "environments/overridden.env")),
        Case(both, PAIR, ("--env", "environments/right.env")),
    )
    stolen = "/talker has a list that revokes a stolen identity, but every link accepts it."
    anew = "All identities are new, under another CA. Its list is empty."
    yield from _in_one_folder("KA814", Case(stolen, _with_list(PAIR, STOLEN)), Case(anew, _with_list(_anew())))


def _any(name: str) -> Configuration:
    """The section where other protocols are allowed, too."""
    made = tls(name)
    del made["link"]["protocols"]
    return made


def _with_list(store: Store, *revoked: Certificate) -> Store:
    """The talker has a revocation list."""
    talking, listening = store.enclaves
    listed = revocation_list(*revoked, issuer=store.identity_ca)
    return replace(store, enclaves=(replace(talking, changes={"crl.pem": listed}), listening))


def _anew() -> Store:
    """PAIR with other identities, which another CA makes."""
    enclaves = (
        replace(each, certificate=replace(each.certificate, issuer=NEXT_CA, key=Key(label=f"rules next {each.path}")))
        for each in PAIR.enclaves
    )
    return replace(PAIR, identity_ca=NEXT_CA, enclaves=(*enclaves,))


def _restrained() -> Iterator[Story]:
    """/random may publish nothing by its own file."""
    own = rule("publications", ["put"], "egress", "0/random/*/*")
    random = session("random", connect={"endpoints": [OPENS]}, access_control=access(named("/random"), own))
    listens = {"listen": {"endpoints": ["tls/localhost:7450"]}, "connect": {"endpoints": [OPENS]}}
    yield from _pair(
        "KA808",
        Case("/random starts without its file, which denies /chatter, and /listener accepts it.", WITH_RANDOM),
        {**GOOD, "random": random, "listener": listener(**listens, access_control=access({}, *TAKES))},
        "The same files, but /listener accepts /chatter only from /talker.",
        {**GOOD, "random": random, "listener": listener(**listens)},
    )


def _beyond() -> Iterator[Story]:
    """/random is granted /random alone, and settings say that nothing gets from it to /listener."""
    ends = {"connect": {"endpoints": [OPENS, "tls/localhost:7450"]}}
    random = session("random", **ends, access_control=access(named("/listener"), *SENDS))
    listens = {"listen": {"endpoints": ["tls/localhost:7450"]}, "connect": {"endpoints": [OPENS]}}
    wide = access(named("/talker", "/random"), *TAKES)
    beyond = {**GOOD, "random": random, "listener": listener(**listens, access_control=wide)}
    within = {**GOOD, "random": random, "listener": listener(**listens)}
    right = "The same files, but /listener accepts /chatter only from /talker."
    said = "/listener accepts /chatter from /random too, whose signed permissions name only /random."
    yield from _pair("KA822", Case(said, WITH_RANDOM), beyond, right, within)
    said = "/listener accepts /chatter from /random, though settings say that nothing from it gets there."
    bad, good = (
        _case("KA828", side, text, WITH_RANDOM, files)
        for side, text, files in (("bad", said, beyond), ("good", right, within))
    )
    asserted = ("--settings", "settings/random.toml")
    yield from pair(
        "KA828",
        bad=bad._replace(options=(*bad.options, *asserted)),
        good=good._replace(options=(*good.options, *asserted)),
    )


def _longer() -> Iterator[Story]:
    """/listener may read the raw pictures, too."""
    image, raw = "rt/image", "rt/image/raw"
    store = replace(
        TWO, enclaves=(_third("/camera", Rule(publish=(image,))), _third("/viewer", Rule(subscribe=(image, raw))))
    )
    sides = []
    for tail in ("/**", "/*/*"):
        messages = {"put": ("egress", "ingress"), "declare_subscriber": ("ingress", "egress")}
        sends, takes = (
            [rule(kind, [kind], flows[side], f"0/image{tail}") for kind, flows in messages.items()] for side in (0, 1)
        )
        sides.append(
            {
                "camera": session(
                    "camera", listen={"endpoints": [OPENS]}, access_control=access(named("/viewer"), *sends)
                ),
                "viewer": session(
                    "viewer", connect={"endpoints": [OPENS]}, access_control=access(named("/camera"), *takes)
                ),
            }
        )
    yield from _pair(
        "KA812",
        Case("The rules for /image also cover /image/raw, which /camera may not publish.", store),
        sides[0],
        "The rules for /image cover only /image.",
        sides[1],
    )


def _routed() -> Iterator[Story]:
    """A router with rules by name: its clients cannot go round it, peers do."""
    kinds, flows = ("put", "declare_subscriber"), ("ingress", "egress")
    rules = (rule(f"{kind} {flow}", [kind], flow) for kind in kinds for flow in flows)
    section = access(named("/talker", "/listener"), *rules)
    listens, joined = ({each: {"endpoints": ["tls/localhost:7447"]}} for each in ("listen", "connect"))
    gossip = {"scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": True}}}
    router = session("zenohd", mode="router", access_control=section, **listens, **gossip)
    yield from _pair(
        "KA809",
        Case("The sessions are peers that find each other, and send past the router's rules.", WITH_ROUTER),
        {
            "zenohd": router,
            "talker": talker(listen={"endpoints": ["tls/localhost:0"]}, **joined, **gossip),
            "listener": listener(listen={"endpoints": ["tls/localhost:0"]}, **joined, **gossip),
        },
        "The sessions are clients of the router, and have no other link.",
        {"zenohd": router, **_clients(joined, named("/zenohd"), named("/zenohd"))},
    )
    yield from _pair(
        "KA836",
        Case("The sessions' rules name each other, but they see only the router between them.", WITH_ROUTER),
        {"zenohd": router, **_clients(joined, named("/listener"), named("/talker"))},
        "They name the router.",
        {"zenohd": router, **_clients(joined, named("/zenohd"), named("/zenohd"))},
    )


def _clients(joined: Configuration, hearing: Configuration, sending: Configuration) -> Network:
    """/talker, which sends to a subject, and /listener, which takes from one."""
    client: Configuration = {"mode": "client", **joined, "listen": {"endpoints": []}}
    return {
        "talker": talker(**client, access_control=access(hearing, *SENDS)),
        "listener": listener(**client, access_control=access(sending, *TAKES)),
    }


def _in_one_folder(code: str, *sides: Case) -> Iterator[Story]:
    """Bad and good, with the same files, that differ elsewhere."""
    folder = f"networks/{code}"
    files = {f"{folder}/{name}.json5": written(each) for name, each in GOOD.items()}
    bad, good = (each._replace(options=("--zenoh", folder, *each.options), beside=files) for each in sides)
    yield from pair(code, bad=bad, good=good)


def _pair(
    code: str, bad: Case, network: Network, right: str, better: Network, more: Mapping[str, bytes] | None = None
) -> Iterator[Story]:
    """`bad`: what to say of it, and the keystore of both."""
    store = bad.keystore
    assert isinstance(store, Store)
    wrong = _case(code, "bad", bad.text, store, network)
    named_too = {f"networks/{code}/bad/{name}": content for name, content in (more or {}).items()}
    return pair(
        code,
        bad=wrong._replace(beside={**wrong.beside, **named_too}),
        good=_case(code, "good", right, store, better),
    )


def _case(code: str, side: str, text: str, store: Store, network: Network) -> Case:
    folder = f"networks/{code}/{side}"
    files = {f"{folder}/{name}.json5": written(each) for name, each in network.items()}
    return Case(text, store, ("--zenoh", folder), files)


def written(configuration: Configuration) -> bytes:
    """A file."""
    return as_file(configuration).encode()
