"""Two processes, mostly of one vendor, that meet on the loopback interface: who matches whom, whose samples arrive?"""

from __future__ import annotations

import itertools
import os
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path

from msgspec import Struct

from keystore_audit.keystore.typed import Operation
from tests.oracles.vendors.enclave import Endpoint, publish, subscribe
from tests.oracles.xml.parsers import compiled

_HERE = Path(__file__).parent

CONTROLS = (publish("control"), subscribe("control"), publish("control_secure"), subscribe("control_secure"))
"""Endpoints that both sides of every pair create last.

Where the documents always allow them, the others are decided once samples of these have arrived: discovery is in order.
Two topics, since endpoints whose discovery is protected are announced by writers of their own.
"""

PATIENCE = 2.0
"""Seconds until a pair whose controls do not meet counts as one that never will; those that do need 0.2 to 0.5.

What is seen is certain; that nothing is seen may be a busy machine: a surprising answer is asked for again (`meet_as`).
"""

QUIET = 0.25
"""Seconds without news, after the controls have met, until what is seen counts as final."""

_PORTS_OF_A_PAIR = 20


class Side(Struct, frozen=True, kw_only=True):
    """A process: `enclave` None is a participant without security.

    `compromised` skips every local check, and presents `presented` to the other side instead of its permissions.p7s.
    `passes_for`: the enclave of a second participant, for whose writer of "owned" its first endpoint passes.
    """

    enclave: Path | None
    endpoints: tuple[Endpoint, ...]
    domain: int = 0
    compromised: bool = False
    presented: Path | None = None
    passes_for: Path | None = None


class Seen(Struct, frozen=True, kw_only=True):
    """What became of an endpoint: with how many of the other side it matched, and which of their numbers it heard."""

    created: bool
    matched: int = 0
    heard: frozenset[int] = frozenset()


class Meeting(Struct, frozen=True, kw_only=True):
    """What became of both sides: None where the participant is not created, else what each endpoint saw.

    `complaints`: what each wrote to its error output.
    """

    sides: tuple[tuple[Seen, ...] | None, tuple[Seen, ...] | None]
    complaints: tuple[str, str]

    @property
    def met(self) -> bool:
        """Whether samples of the controls arrived both ways."""
        return all(seen is not None and _heard_controls(seen) for seen in self.sides)


def _heard_controls(seen: Sequence[Seen]) -> bool:
    return all(control.heard for control in seen[-len(CONTROLS) + 1 :: 2])


class Process:
    """A side that runs."""

    def __init__(self, program: Path, library: Path, side: Side, number: int, first_port: int) -> None:
        self._number = number
        self._created: list[bool] = []
        self._count = len(side.endpoints) + len(CONTROLS)
        attacker = str(library) if side.compromised else ""
        arguments = [str(number), str(first_port), str(side.domain), str(side.enclave or ""), attacker]
        for endpoint in (*side.endpoints, *CONTROLS):
            letter = "P" if endpoint.operation is Operation.PUBLISH else "S"
            arguments += [letter, endpoint.topic, str(len(endpoint.partitions)), *endpoint.partitions]
        told = {"PRESENTED_PERMISSIONS": side.presented, "PASSED_FOR": side.passes_for}
        environment = {**os.environ, **{name: str(path) for name, path in told.items() if path is not None}}
        pipe = subprocess.PIPE
        self._process = subprocess.Popen([program, *arguments], stdin=pipe, stdout=pipe, stderr=pipe, env=environment)
        self._complaints: list[bytes] = []
        self._drain = threading.Thread(target=self._take_complaints, daemon=True)
        self._drain.start()

    def _take_complaints(self) -> None:
        assert self._process.stderr is not None
        self._complaints.extend(self._process.stderr)

    def started(self) -> bool:
        """Whether the participant was created; waits until its endpoints have been tried."""
        if self._lines(1) != ["A"]:
            return False
        self._created = [line == "A" for line in self._lines(self._count)]
        return True

    def look(self) -> tuple[Seen, ...]:
        """What its endpoints saw so far."""
        assert self._process.stdin is not None
        self._process.stdin.write(b"\n")
        self._process.stdin.flush()
        seen = []
        for created, line in zip(self._created, self._lines(self._count), strict=True):
            matched, *senders = (int(word) for word in line.split())
            others = frozenset(sender % 1000 for sender in senders if sender // 1000 != self._number)
            seen.append(Seen(created=created, matched=matched, heard=others))
        return tuple(seen)

    def _lines(self, count: int) -> list[str]:
        assert self._process.stdout is not None
        lines = [self._process.stdout.readline() for _ in range(count)]
        if not all(lines):
            raise AssertionError(f"ended with {self._process.wait(10)}: {self.complaints()[:600]}")
        return [line.decode().strip() for line in lines]

    def complaints(self) -> str:
        """What the vendor wrote to the error output."""
        return b"".join(self._complaints).decode("utf-8", "replace")

    def end(self) -> None:
        """End the process, which needs no kindness."""
        self._process.kill()
        self._drain.join(10)
        for stream in (self._process.stdin, self._process.stdout, self._process.stderr):
            assert stream is not None
            try:
                stream.close()
            except BrokenPipeError:
                continue  # what it was asked last, it did not read
        self._process.wait(10)


class Pairs:
    """One vendor's programs, or two, and ports that no other pair uses. `second`: whose is the second process."""

    _first_ports = itertools.cycle(range(20000, 32000, _PORTS_OF_A_PAIR))
    _guard = threading.Lock()

    def __init__(self, program: Path, library: Path, second: Pairs | None = None) -> None:
        self._program = program
        self._library = library
        self._sides = (self, second or self)

    def beside(self, other: Pairs) -> Pairs:
        """The same with a second process of the other vendor."""
        return Pairs(self._program, self._library, other)

    def meet(self, first: Side, second: Side, patience: float = PATIENCE) -> Meeting:
        """Let them meet, until all is decided."""
        with self._guard:
            port = next(port for port in self._first_ports if _free(port))
        with ExitStack() as stack:
            processes = []
            for number, (of, side) in enumerate(zip(self._sides, (first, second), strict=True)):
                processes.append(Process(of._program, of._library, side, number, port))
                stack.callback(processes[-1].end)
            started = [process.started() for process in processes]
            if all(started):
                seen: Sequence[tuple[Seen, ...] | None] = _watch(processes, patience)
            else:
                seen = [process.look() if there else None for process, there in zip(processes, started, strict=True)]
        return Meeting(sides=(seen[0], seen[1]), complaints=(processes[0].complaints(), processes[1].complaints()))

    def meet_as(self, first: Side, second: Side, expected: Callable[[Meeting], bool]) -> Meeting:
        """Let them meet; where they do other than is expected, which a busy machine may be, again and with patience."""
        return self.meet_all([(first, second)], lambda _number, meeting: expected(meeting))[0]

    def meet_all(self, sides: Sequence[tuple[Side, Side]], expected: Callable[[int, Meeting], bool]) -> list[Meeting]:
        """The same of many pairs, by their numbers; they mostly wait, so several run at a time, but alone if again."""
        with ThreadPoolExecutor(10) as pool:
            meetings = list(pool.map(lambda pair: self.meet(*pair), sides))
        return [
            meeting if expected(number, meeting) else self.meet(*sides[number], 4 * PATIENCE)
            for number, meeting in enumerate(meetings)
        ]


def _free(first_port: int) -> bool:
    """Whether nobody has the ports that a pair takes."""
    with ExitStack() as stack:
        for port in range(first_port, first_port + _PORTS_OF_A_PAIR):
            probe = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                return False
    return True


def _watch(processes: Sequence[Process], patience: float) -> list[tuple[Seen, ...]]:
    begin = news = time.monotonic()
    last: list[tuple[Seen, ...]] = []
    while True:
        seen = [process.look() for process in processes]
        now = time.monotonic()
        if seen != last:
            last, news = seen, now
        if now - news > QUIET and (all(map(_heard_controls, seen)) or now - begin > patience):
            return seen
        time.sleep(0.03)


@contextmanager
def pairs(find: Callable[[str], str], directory: Path) -> Iterator[dict[str, Pairs]]:
    """Both vendors, by name; without compiler, header or library the test skips, in CI it fails."""
    cyclone = compiled(find("cc"), _HERE / "cyclonedds_pair.c", directory, "-rdynamic", "-lddsc", "-ldl")
    library = compiled(find("cc"), _HERE / "cyclonedds_compromised.c", directory, "-shared", "-fPIC", "-ldl")
    libraries = ("-lfastrtps", "-lfastcdr", "-ldl")
    fastdds = compiled(find("c++"), _HERE / "fastdds_pair.cpp", directory, "-rdynamic", *libraries)
    yield {"cyclone": Pairs(cyclone, library), "fastdds": Pairs(fastdds, Path("compromised"))}
