"""KA8: each rule beside what is right, by one change; severities that hang on more than the rule."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from keystore_audit import api
from tests.oracles.zenoh.deployment import Configuration, access, allow, deny, keystore, session, tls, written

CHATTER = "0/chatter/*/*"
SENDS = [allow(CHATTER, "put", flows=["egress"]), allow(CHATTER, "declare_subscriber", flows=["ingress"])]
TAKES = [allow(CHATTER, "put", flows=["ingress"]), allow(CHATTER, "declare_subscriber", flows=["egress"])]
GRAPH = [allow("@ros2_lv/0/**", "liveliness_token")]
SEEN = [allow("@ros2_lv/0/**", "liveliness_token", flows=["egress"])]
UNCHECKED = {"verify_name_on_connect": False}
Files = dict[str, Configuration | str]
Change = Callable[[Path], Mapping[str, Configuration | str | None]]


def right(root: Path) -> Files:
    """/named listens and sends; /listener checks its name, connects and takes."""
    named = tls(root, "named", verify_name_on_connect=True)
    secured = tls(root, "listener", verify_name_on_connect=True)
    ends = ["tls/127.0.0.1:7449"]
    return {
        "named": session("peer", listen=ends, **named, **access(({"cert_common_names": ["/listener"]}, SENDS))),
        "listener": session("peer", connect=ends, **secured, **by_name()),
    }


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return keystore(tmp_path_factory.mktemp("keystore"))


def by_name() -> Configuration:
    """Rules that let /named alone send."""
    return access(({"cert_common_names": ["/named"]}, TAKES))


def found(root: Path, folder: Path, change: Mapping[str, Configuration | str | None], **more: Any) -> set[str]:
    """The findings of KA8 with their severities, but for enclaves without files."""
    folder.mkdir()
    for name, each in {**right(root), **change}.items():
        if each is not None:
            (folder / f"{name}.json5").write_text(each if isinstance(each, str) else written(each), "utf-8")
    report = api.audit(root, network=folder, engine="native", **more)
    told = {(f.code, f.severity.value) for f in report.findings if f.code.startswith("KA8")}
    return {f"{code} {severity}" for code, severity in told - {("KA824", "medium")}}


def changed(root: Path, name: str, **sections: Any) -> Configuration:
    """The right file with other sections; those of `tls` in it."""
    made = right(root)[name]
    assert isinstance(made, dict)
    of_tls = sections.pop("tls", {})
    own = tls(root, name, **{"verify_name_on_connect": True, **of_tls})
    return {**made, **own, **sections}


def test_nothing_is_found_where_all_is_right(root: Path, tmp_path: Path) -> None:
    assert found(root, tmp_path / "network", {}) == set()


# Without mutual TLS /named does not know /listener and lets nothing out, and sends all the same by dropping its file.
WRONG: Mapping[str, tuple[Change, set[str]]] = {
    "mutual": (
        lambda root: {"named": changed(root, "named", tls={"enable_mtls": False})},
        {"KA801 critical", "KA808 high"},
    ),
    "fragment": (
        lambda root: {
            "named": changed(root, "named", listen={"endpoints": ["tls/127.0.0.1:7449#enable_mtls=false"]})
        },
        {"KA801 critical", "KA808 high"},
    ),
    "plain": (
        lambda root: {
            "named": changed(root, "named", listen={"endpoints": ["tls/127.0.0.1:7449", "tcp/0.0.0.0:7450"]})
        },
        {"KA802 critical"},
    ),
    "plain on loopback": (
        lambda root: {
            "named": changed(root, "named", listen={"endpoints": ["tls/127.0.0.1:7449", "tcp/localhost:7450"]})
        },
        {"KA802 high"},
    ),
    "plain by default": (
        lambda root: {"talker": {**tls(root, "talker"), **by_name()}},
        {"KA802 critical"},
    ),
    "multicast": (
        lambda root: {
            "named": changed(root, "named", listen={"endpoints": ["tls/127.0.0.1:7449", "udp/224.0.0.224:7446"]})
        },
        {"KA803 critical"},
    ),
    "not enabled": (
        lambda root: {"listener": changed(root, "listener", **access(({}, TAKES), enabled=False))},
        {"KA804 high"},
    ),
    "passwords alone": (
        lambda _root: {"more": {**session(), "transport": {"auth": {"usrpwd": {"user": "a", "password": "b"}}}}},
        {"KA804 high", "KA825 critical", "KA826 high", "KA824 high"},
    ),
    "allows": (
        lambda root: {
            "listener": changed(root, "listener", **access(({"cert_common_names": ["/named"]}, TAKES), default="allow"))
        },
        {"KA805 high"},
    ),
    "void deny": (
        lambda root: {
            "listener": changed(
                root,
                "listener",
                **access(({"cert_common_names": ["/named"]}, TAKES), ({"link_protocols": ["tls"]}, [deny(CHATTER)])),
            )
        },
        {"KA806 medium"},
    ),
    "by id": (
        lambda root: {"listener": changed(root, "listener", **access(({"zids": ["ab"]}, TAKES)))},
        {"KA807 high"},
    ),
    "graph": (
        lambda root: {
            "listener": changed(root, "listener", **access(({"cert_common_names": ["/named"]}, TAKES), ({}, GRAPH)))
        },
        {"KA835 low"},
    ),
    "graph by name": (
        lambda root: {
            "listener": changed(root, "listener", **access(({"cert_common_names": ["/named"]}, [*TAKES, *GRAPH])))
        },
        set(),
    ),
    "graph seen": (
        lambda root: {
            "listener": changed(root, "listener", **access(({"cert_common_names": ["/named"]}, TAKES), ({}, SEEN)))
        },
        set(),
    ),
    "unchecked": (
        lambda root: {"listener": changed(root, "listener", tls=UNCHECKED)},
        {"KA811 low"},
    ),
    "unchecked, what is denied to names": (
        lambda root: {
            "listener": changed(
                root, "listener", tls=UNCHECKED, **access(({"cert_common_names": ["/named"]}, TAKES), default="allow")
            )
        },
        {"KA805 high", "KA811 high"},
    ),
    "unchecked, by name and by link": (
        lambda root: {
            "listener": changed(
                root,
                "listener",
                tls=UNCHECKED,
                **access(({"cert_common_names": ["/named"]}, TAKES), ({"link_protocols": ["tls"]}, SEEN)),
            )
        },
        {"KA811 high"},
    ),
    "nameless": (
        lambda root: {
            "talker": session("peer", listen=["tls/127.0.0.1:7451"], **tls(root, "talker"), **by_name()),
            "listener": changed(root, "listener", connect={"endpoints": ["tls/127.0.0.1:7449", "tls/127.0.0.1:7451"]}),
        },
        {"KA811 medium"},
    ),
    "other key": (
        lambda root: {
            "named": changed(root, "named", tls={"listen_private_key": f"{root}/enclaves/talker/key.pem"})
        },
        {"KA816 high", "KA820 high"},
    ),
    "useless": (
        lambda root: {"p521": session("peer", **tls(root, "p521"), **by_name())},
        {"KA817 high"},
    ),
    "refused": (lambda _root: {"more": '{"mode": "peer", "mode": "peer"}'}, {"KA820 high"}),
    "nobody's": (
        lambda _root: {"more": session("peer", **by_name())},
        {"KA824 high"},
    ),
    "secret": (lambda root: {"named": changed(root, "named", metadata={"password": "x"})}, {"KA825 critical"}),
    "unseen": (
        lambda root: {
            "listener": changed(root, "listener", connect={"endpoints": ["tls/127.0.0.1:7449", "tls/10.0.0.9:1"]})
        },
        {"KA826 high"},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_one_change_is_found(name: str, root: Path, tmp_path: Path) -> None:
    change, expected = WRONG[name]
    assert found(root, tmp_path / "network", change(root)) == expected


def test_a_field_that_only_some_releases_know(root: Path, tmp_path: Path) -> None:
    """It is refused where one of the judged ones does not know it."""
    section = access(({"cert_common_names": ["/named"], "zids": ["ab"]}, TAKES))
    change = {"listener": changed(root, "listener", **section)}
    assert found(root, tmp_path / "old", change, profiles=["zenoh-1.4"]) == {"KA820 high"}
    assert found(root, tmp_path / "new", change, profiles=["zenoh-1.6"]) == set()


def test_the_key_of_an_authority_is_worst(root: Path, tmp_path: Path) -> None:
    authority = root / "private" / "identity_ca.key.pem"
    authority.parent.mkdir(exist_ok=True)
    authority.write_bytes((root / "enclaves" / "talker" / "key.pem").read_bytes())
    change = {"named": changed(root, "named", tls={"connect_private_key": f"{authority}"})}
    assert found(root, tmp_path / "network", change) == {"KA816 critical"}


@pytest.mark.parametrize(("rights", "expected"), [(100, set()), (600, {"KA808 high"})])
def test_more_rights_than_are_asked_about_leave_it_open(
    rights: int, expected: set[str], root: Path, tmp_path: Path
) -> None:
    """Nobody can do more than its own file lets it; of more than 500 rights that is not known."""
    keys = " ".join(f"0/topic{number}/*/*" for number in range(rights))
    sends = [allow(keys, "put", flows=["egress"]), allow(keys, "declare_subscriber", flows=["ingress"])]
    takes = [allow(keys, "put", flows=["ingress"]), allow(keys, "declare_subscriber", flows=["egress"])]
    change = {
        "named": changed(root, "named", **access(({"cert_common_names": ["/listener"]}, sends))),
        "listener": changed(root, "listener", **access(({"cert_common_names": ["/named"]}, takes))),
    }
    assert found(root, tmp_path / "network", change) == expected
