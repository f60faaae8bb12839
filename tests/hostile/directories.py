"""Facts 4.4: what can stand in a directory under the name of a file, and where links can lead."""

from __future__ import annotations

import os
import shutil
import socket
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Final

import pytest

from tests.hostile.server import NOBODY
from tests.hostile.store import CERT, KEY, P7S, Store, case

VICTIM: Final = "enclaves/victim"
GOVERNANCE: Final = f"{VICTIM}/governance.p7s"
MEDIUM: Final = ("--fail-on", "medium")
LOW: Final = ("--fail-on", "low")


def linked(name: str, target: str) -> Callable[[Store], None]:
    """The victim's file is a link; `{outside}` is the folder beside the keystore, `{root}` the keystore."""
    return lambda store: store.link(name, target.format(outside=store.outside, root=store.root))


def links(*pairs: tuple[str, str]) -> Callable[[Store], None]:
    def spoil(store: Store) -> None:
        for name, target in pairs:
            store.link(name, target)

    return spoil


def replaced(name: str, make: Callable[[Path], object]) -> Callable[[Store], None]:
    def spoil(store: Store) -> None:
        path = store.victim / name
        path.unlink()
        make(path)

    return spoil


def _socket(path: Path) -> None:
    here = Path.cwd()
    os.chdir(path.parent)  # a socket's path has at most 107 characters
    try:
        with socket.socket(socket.AF_UNIX) as server:
            server.bind(path.name)
    finally:
        os.chdir(here)


def _sparse(path: Path) -> None:
    with path.open("wb") as stream:
        stream.truncate(10 << 30)


def _beginnings(path: Path) -> None:
    """What may begin a structure in base64, as often as it fits."""
    path.write_bytes(b"MI " * (6 << 20))


def _device(path: Path) -> None:
    try:
        os.mknod(path, 0o666 | stat.S_IFCHR, os.makedev(1, 5))
    except PermissionError:
        pytest.skip("only root makes device files, and not in every container")


def _chain(store: Store) -> None:
    """More links in a row than the kernel follows."""
    store.link("cert.pem", "link0")
    for number in range(60):
        os.symlink(f"link{number + 1}", store.victim / f"link{number}")
    os.symlink("../bystander/cert.pem", store.victim / "link60")


def _tower(store: Store) -> None:
    """Links that lead over many names that lead over many names."""
    store.link("cert.pem", "/".join(["level0"] * 200))
    for number in range(30):
        os.symlink("/".join([f"level{number + 1}"] * 200), store.victim / f"level{number}")
    os.symlink(".", store.victim / "level30")


def _deep(store: Store) -> None:
    directory = os.open(store.root / "enclaves", os.O_RDONLY)
    for _ in range(400):
        os.mkdir("d", dir_fd=directory)
        below = os.open("d", os.O_RDONLY, dir_fd=directory)
        os.close(directory)
        directory = below
    descriptor = os.open("cert.pem", os.O_CREAT | os.O_WRONLY, dir_fd=directory)
    os.close(descriptor)
    os.close(directory)


def _wide(store: Store) -> None:
    for number in range(3_000):
        (store.victim / f"{number}.txt").touch()


def _enclave_called(name: bytes) -> Callable[[Store], None]:
    return lambda store: os.rename(store.victim, os.fsencode(store.root / "enclaves") + b"/" + name)


def _below(target: str) -> Callable[[Store], None]:
    """A link in enclaves/ that leads to a directory."""
    return lambda store: os.symlink(target.format(outside=store.outside), store.root / "enclaves/linked")


def _locked(path: str, mode: int = 0) -> Callable[[Store], None]:
    """Everything belongs to whoever audits, and one entry may not even be read by its owner."""

    def spoil(store: Store) -> None:
        if os.geteuid() == 0:
            for entry in (store.root, *store.root.rglob("*")):
                os.chown(entry, NOBODY, NOBODY, follow_symlinks=False)
        (store.root / path).chmod(mode)

    return spoil


def _notes(mode: int, name: str = "notes") -> Callable[[Store], None]:
    """A file that no run time reads."""

    def spoil(store: Store) -> None:
        (store.root / name).parent.mkdir(exist_ok=True)
        (store.root / name).write_text("nothing\n")
        _locked(name, mode)(store)

    return spoil


def _closed(store: Store) -> None:
    """A folder of others, as an administrator's private/, of which not even the names are known."""
    (store.root / "closed").mkdir()
    _locked("closed")(store)


CLOSED: Final = case("a folder of others", _closed, "KA107", "closed", nobody=True)


def _copy_called(name: str) -> Callable[[Store], None]:
    def spoil(store: Store) -> None:
        shutil.copytree(store.victim, store.root / "enclaves" / name, symlinks=True)

    return spoil


def _pipe_behind_a_link(store: Store) -> None:
    os.mkfifo(store.victim / "pipe")
    store.link("cert.pem", "pipe")


def _hard_links(store: Store) -> None:
    """As sros2 makes them where there are no symbolic ones."""
    for name in ("identity_ca.cert.pem", "permissions_ca.cert.pem"):
        (store.victim / name).unlink()
        os.link((store.root / "public" / name).resolve(), store.victim / name)


def _missing(path: str) -> Callable[[Store], None]:
    return lambda store: (store.root / path).unlink()


def _directory_missing(store: Store) -> None:
    shutil.rmtree(store.root / "public")


LINKS: Final = (
    case("a link to a file outside", linked("permissions.p7s", "../../../outside/secret"), "KA103"),
    case("an absolute link to a file outside", linked("permissions.p7s", "{outside}/secret"), "KA103"),
    case("a link to /dev/zero", linked("permissions.p7s", "/dev/zero"), "KA103"),
    case("a link to /dev/stdin", linked("key.pem", "/dev/stdin"), "KA103", KEY),
    case("a link to /proc/self/environ", linked("cert.pem", "/proc/self/environ"), "KA103", CERT),
    case("a link to /proc/self/root", linked("cert.pem", "/proc/self/root/etc/passwd"), "KA103", CERT),
    case("a link to what is not outside", linked("permissions.p7s", "../../../outside/none"), "KA103"),
    case(
        "a link over a link that leaves",
        links(("out", "../../../outside"), ("cert.pem", "out/secret")),
        "KA103",
        CERT,
    ),
    case("a link to itself", linked("permissions.p7s", "permissions.p7s"), "KA102", exit=1),
    case(
        "two links to one another",
        links(("cert.pem", "key.pem"), ("key.pem", "cert.pem")),
        "KA102",
        CERT,
        exit=1,
    ),
    case("a chain of 60 links", _chain, "KA102", CERT, exit=1),
    case("a tower of links", _tower, "KA102", CERT, exit=1),
    case("a link to nothing", linked("governance.p7s", "../none"), "KA102", GOVERNANCE, exit=1),
    case("a link of 4,000 characters", linked("cert.pem", "x/" * 2_000), "KA102", CERT, exit=1),
    case("a link to a directory", linked("cert.pem", "../bystander"), "KA101", CERT, exit=1, bystander_changes=True),
    case("an enclave that is a link to a directory outside", _below("../../outside/below"), "KA104", "enclaves/linked"),
    case(
        "an enclave that is a link to another",
        _below("bystander"),
        "KA219",
        "enclaves/bystander/cert.pem",
        line=1,
        exit=1,
        bystander_changes=True,
    ),
    case("an enclave that is a link to /", _below("/"), "KA104", "enclaves/linked"),
    case("an enclave that is a link to its parent", _below("."), "KA121", "enclaves/linked", exit=0),
    case("a link with escape sequences in it", linked("permissions.p7s", "\x1b]0;x\x07/\u202e"), "KA102", exit=1),
    case("hard links", _hard_links, exit=0),
)

KINDS: Final = (
    case("a named pipe", replaced("permissions.p7s", os.mkfifo), "KA105"),
    case("a named pipe for a key", replaced("key.pem", os.mkfifo), "KA105", KEY),
    case("a socket", replaced("permissions.p7s", _socket), "KA105"),
    case("a device", replaced("permissions.p7s", _device), "KA105"),
    case(
        "a link to a named pipe",
        _pipe_behind_a_link,
        "KA105",
        CERT,
    ),
    case("a directory", replaced("permissions.p7s", os.mkdir), "KA101", exit=1),
    case("a file of 10 GB", replaced("permissions.p7s", _sparse), "KA106"),
    case("a key of 10 GB", replaced("key.pem", _sparse), "KA106", KEY),
    case("a file of beginnings in base64", replaced("permissions.p7s", _beginnings), "KA106"),  # took a minute
    case("a governance.xml that is a named pipe", lambda store: os.mkfifo(store.victim / "governance.xml"), exit=0),
    case("a file that nobody may read", _locked(P7S), "KA107", nobody=True),
    case("notes that nobody may read", _notes(0), "KA121", "notes", exit=0, nobody=True),
    case(
        "notes that nobody may read on a robot",
        _notes(0),
        "KA121",
        "notes",
        exit=1,
        nobody=True,
        options=("--deployed",),
    ),
    case("an authority's key that nobody may read", _notes(0, "private/old_ca.key.pem"), exit=0, nobody=True),
    case("notes that their owner may read", _notes(0o400), exit=0, nobody=True),
    case("a key that nobody may read", _locked(KEY), "KA107", KEY, nobody=True),
    case("a directory that nobody may list", _locked(VICTIM, 0o311), "KA107", VICTIM, nobody=True),
    case("a directory that nobody may enter", _locked(VICTIM, 0o444), "KA107", VICTIM, nobody=True),
    case("a missing file", _missing(P7S), "KA101", exit=1),
    case(
        "a missing public/",
        _directory_missing,
        "KA102",
        f"{VICTIM}/identity_ca.cert.pem",
        exit=1,
        bystander_changes=True,
    ),
    case("a directory 400 deep", _deep, "KA107", "/".join(["enclaves"] + ["d"] * 128)),
    case("3,000 files that mean nothing", _wide, exit=0),
)

NAMES: Final = (
    *(
        case(f"a name {what}", _enclave_called(name), "KA113", f"enclaves/{path}", exit=1, options=MEDIUM)
        for what, name, path in (
            ("that is no UTF-8", b"caf\xe9", "caf%E9"),
            ("with escape sequences", b"\x1b]0;x\x07\x1b[2J", "%1B]0;x%07%1B[2J"),
            ("with a line end", b"a\nPASS", "a%0APASS"),
            ("that turns the line around", "a\u202eb".encode(), "a%E2%80%AEb"),
            ("of blanks", b"  ", "  "),
            ("of percent signs", b"%2e%2e", "%252e%252e"),
            ("that is an option", b"--help", "--help"),
        )
    ),
    case("a name of 255 characters", _enclave_called(b"x" * 255), exit=0),
    case("two names that differ in case", _copy_called("VICTIM"), "KA114", "enclaves/VICTIM", exit=1, options=LOW),
)

CASES: Final = LINKS + KINDS + NAMES
