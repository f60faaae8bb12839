"""Audits keystores on demand, each in a process of its own that is watched, bounded in memory and killed in time.

Started as `python -m tests.hostile.server`; requests and answers are lines of JSON. The program is imported once and
forked for each audit: what runs is the command line with its real exit code, without half a second of imports.
"""

from __future__ import annotations

import ctypes
import io
import json
import os
import resource
import signal
import sys
import time
import traceback
from importlib import import_module
from typing import Any, Final

SECONDS: Final = 10
"""After so much processor time the kernel kills an audit (issue 4)."""

PATIENCE: Final = 60
"""The same by the clock, for what waits and does nothing; machines that are busy with other tests make audits slow."""

MEMORY: Final = 400 << 20
"""Bytes of address space that an audit may add to what the imported program has; it is meant to stay below half."""

NOBODY: Final = 65534
PR_SET_DUMPABLE: Final = 4

FORBIDDEN: Final = ("subprocess.", "os.exec", "os.fork", "os.posix_spawn", "os.system", "socket.", "urllib.", "ctypes.")
"""Audit events that have no business in an audit: other programs, the network, foreign code."""
CHANGES: Final = frozenset(
    f"os.{call}"
    for call in ("chmod", "chown", "link", "mkdir", "remove", "rename", "rmdir", "symlink", "truncate", "utime")
)


class Watch:
    """What a process opens: by the kernel's name of each descriptor, and by the interpreter's audit events."""

    def __init__(self, allowed: tuple[str, ...], written: str) -> None:
        self._allowed = allowed
        self._written = written
        self._inside = False
        self._open = os.open
        self.strangers: list[str] = []
        self.count = 0

    def begin(self) -> None:
        os.open = self._watched_open
        sys.addaudithook(self._hook)

    def _watched_open(self, *args: Any, **kwargs: Any) -> int:
        self._inside = True
        try:
            descriptor = self._open(*args, **kwargs)
        finally:
            self._inside = False
        self._look(os.readlink(f"/proc/self/fd/{descriptor}"), writes=bool(args[1] & 3))
        return descriptor

    def _hook(self, event: str, args: tuple[Any, ...]) -> None:
        if event == "open" and not self._inside and isinstance(args[0], str | bytes):
            self._look(os.path.realpath(os.fsdecode(args[0])), writes=bool(args[2] & 3))
        elif event in ("os.listdir", "os.scandir") and isinstance(args[0], str | bytes):
            self._look(os.path.realpath(os.fsdecode(args[0])), writes=False)
        elif event.startswith(FORBIDDEN) or (event in CHANGES and not self._own(args)):
            self.strangers.append(f"{event} {args!r}")

    def _own(self, args: tuple[Any, ...]) -> bool:
        """Whether a change is made where the report is written."""
        paths = [os.fsdecode(path) for path in args if isinstance(path, str | bytes | os.PathLike)]
        folders = [os.readlink(f"/proc/self/fd/{each}") for each in args if isinstance(each, int) and each > 2]
        if folders and all("/" not in path for path in paths):  # relative to directories that are open
            return all(f"{folder}/" == self._written for folder in folders)
        return all(path.startswith(self._written) for path in paths)

    def _look(self, path: str, *, writes: bool) -> None:
        self.count += 1
        if path.startswith(self._written) or (f"{path}/" == self._written and not writes):
            return
        if writes or not (path + "/").startswith(self._allowed):
            self.strangers.append(path)


def installation() -> tuple[str, ...]:
    """Where the program itself is read from."""
    import keystore_audit

    package = os.path.dirname(os.path.realpath(keystore_audit.__file__))
    source = [f"{os.path.dirname(package)}/{folder}" for folder in ("keystore_audit", "schemas", "alloy")]
    return tuple(f"{os.path.realpath(folder)}/" for folder in (sys.prefix, sys.base_prefix, *source))


def preload() -> None:
    """Import everything that an audit may need, so that the children need not."""
    for name in ("pipeline", "cli.audit", "cli.output", "report.json", "report.text"):
        import_module(f"keystore_audit.{name}")
    import_module("xmlschema")  # imported by the program only where a schema's words are needed
    import_module("difflib")  # by click, for an option of the default command; nobody may read a Python of root's own


def main() -> None:
    preload()
    for line in sys.stdin:
        request: dict[str, Any] = json.loads(line)
        if request.get("warm"):
            with open(os.devnull, "w", encoding="utf-8") as sys.stdout:  # schemas are compiled once, for all children
                run(request["argv"])
            sys.stdout = sys.__stdout__
        print(json.dumps(audited(request)), flush=True)


def run(argv: list[str]) -> int:
    """The command as it is started, how it collects garbage included; its exit code."""
    from keystore_audit.cli import main as program

    sys.argv = ["keystore-audit", *argv]
    try:
        program()
    except SystemExit as ended:
        return int(ended.code or 0)


def audited(request: dict[str, Any]) -> dict[str, Any]:
    """Run one audit in a child; `strangers` None: it did not end by itself."""
    streams = {name: os.memfd_create(name) for name in ("stdout", "stderr", "watched")}
    started = time.monotonic()
    child = os.fork()
    if child == 0:
        code = 99
        try:
            code = _child(request, streams)
        except Exception:  # noqa: BLE001 - the test shows it
            os.write(streams["stderr"], traceback.format_exc().encode())
        finally:
            os._exit(code)
    _, status, usage = os.wait4(child, 0)
    texts = {}
    for name, descriptor in streams.items():
        os.lseek(descriptor, 0, os.SEEK_SET)
        with os.fdopen(descriptor, "rb") as stream:
            texts[name] = stream.read().decode("latin-1")
    watched = json.loads(texts.pop("watched") or "null")
    return {
        **texts,
        "exit": os.waitstatus_to_exitcode(status),
        "seconds": time.monotonic() - started,
        "cpu": usage.ru_utime + usage.ru_stime,
        "peak": usage.ru_maxrss * 1024,
        "opens": watched["opens"] if watched else 0,
        "strangers": watched["strangers"] if watched else None,
    }


def _child(request: dict[str, Any], streams: dict[str, int]) -> int:
    os.dup2(streams["stdout"], 1)
    os.dup2(streams["stderr"], 2)
    sys.stdout = io.TextIOWrapper(os.fdopen(1, "wb", closefd=False), encoding="utf-8", errors="strict")
    sys.stderr = io.TextIOWrapper(os.fdopen(2, "wb", closefd=False), encoding="utf-8", errors="backslashreplace")
    if request.get("nobody") and os.geteuid() == 0:
        libc = ctypes.CDLL(None)
        os.setgroups([])
        os.setgid(NOBODY)
        os.setuid(NOBODY)
        libc.prctl(PR_SET_DUMPABLE, 1)  # else /proc/self belongs to root
    with open("/proc/self/statm", "rb") as stream:
        pages = int(stream.read().split()[0])
    limit = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    signal.alarm(PATIENCE)
    watch = Watch((*installation(), os.path.realpath(request["root"]) + "/"), request["written"])
    watch.begin()
    code = run(request["argv"])
    sys.stdout.flush()
    sys.stderr.flush()
    os.write(streams["watched"], json.dumps({"opens": watch.count, "strangers": watch.strangers}).encode())
    return code


if __name__ == "__main__":
    main()
