"""Fast DDS and Cyclone DDS themselves: does an enclave's participant start, and which endpoints may it create?"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from msgspec import Struct

from keystore_audit.keystore.typed import Operation
from tests.oracles.xml.parsers import compiled

_HERE = Path(__file__).parent


class Endpoint(Struct, frozen=True, kw_only=True):
    """A writer or reader that an enclave is to create; `partitions` as its publisher or subscriber names them."""

    operation: Operation
    topic: str
    partitions: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.operation.value} {self.topic}" + "".join(f" @{partition}" for partition in self.partitions)

    def encoded(self) -> bytes:
        """As the programs read it."""
        letter = "P" if self.operation is Operation.PUBLISH else "S"
        return "".join(f"{text}\0" for text in (letter, self.topic, len(self.partitions), *self.partitions)).encode()


def publish(topic: str, *partitions: str) -> Endpoint:
    """A writer."""
    return Endpoint(operation=Operation.PUBLISH, topic=topic, partitions=partitions)


def subscribe(topic: str, *partitions: str) -> Endpoint:
    """A reader."""
    return Endpoint(operation=Operation.SUBSCRIBE, topic=topic, partitions=partitions)


class Answer(Struct, frozen=True, kw_only=True):
    """What a vendor does with an enclave.

    `participant`: None where it is created, else the vendor's message, "crash" or "hang". `endpoints`: for each that
    was asked, None where it is created, else where creation failed (topic, group, endpoint) and the vendor's message.
    """

    participant: str | None
    endpoints: tuple[str | None, ...] = ()

    @property
    def allowed(self) -> tuple[bool, ...]:
        """For each endpoint, whether it is created."""
        return tuple(refusal is None for refusal in self.endpoints)


class Vendor:
    """One implementation, in a process for each time zone that is started again when an enclave ends it."""

    def __init__(self, program: Path) -> None:
        self._program = program
        self._processes: dict[str, subprocess.Popen[bytes]] = {}

    def ask(
        self, enclave: Path, domain: int, endpoints: Sequence[Endpoint], time_zone: str = "UTC"
    ) -> Callable[[], Answer]:
        """What becomes of the enclave in this directory, once it is called; `time_zone` is what TZ says.

        The process works while others do something else. It has to answer before it is asked again.
        """
        process = self._running(time_zone)
        assert process.stdin is not None
        listed = b"".join(endpoint.encoded() for endpoint in endpoints)
        for field in (os.fsencode(enclave), str(domain).encode(), listed):
            process.stdin.write(len(field).to_bytes(4, "big") + field)
        process.stdin.flush()
        return partial(self._answer, process, enclave, endpoints, time_zone)

    def _answer(
        self, process: subprocess.Popen[bytes], enclave: Path, endpoints: Sequence[Endpoint], time_zone: str
    ) -> Answer:
        assert process.stdout is not None
        header = process.stdout.read(4)
        if len(header) < 4:
            code = self._end(time_zone)
            assert code in (-11, -6, -14), f"ended with {code} on {enclave}"
            return Answer(participant="hang" if code == -14 else "crash")
        text = process.stdout.read(int.from_bytes(header, "big")).decode("utf-8", "replace")
        created, message, *rest = text.split("\0")[:-1]
        if created != "A":
            return Answer(participant=message or "no message")
        assert len(rest) == 2 * len(endpoints), (rest, endpoints)
        places = zip(rest[::2], rest[1::2], strict=True)
        return Answer(
            participant=None, endpoints=tuple(None if place == "A" else f"{place}: {why}" for place, why in places)
        )

    def _running(self, time_zone: str) -> subprocess.Popen[bytes]:
        if time_zone not in self._processes:
            pipe = subprocess.PIPE
            self._processes[time_zone] = subprocess.Popen(
                [self._program], stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, env={**os.environ, "TZ": time_zone}
            )
        return self._processes[time_zone]

    def _end(self, time_zone: str) -> int:
        process = self._processes.pop(time_zone)
        process.communicate(timeout=30)
        return process.returncode

    def close(self) -> None:
        """End the processes."""
        for time_zone in list(self._processes):
            self._end(time_zone)


@contextmanager
def vendors(find: Callable[[str], str], directory: Path) -> Iterator[dict[str, Vendor]]:
    """Both, by name; without compiler, header or library the test skips, in CI it fails."""
    cyclone = compiled(find("cc"), _HERE / "cyclonedds_enclave.c", directory, "-lddsc")
    fastdds = compiled(find("c++"), _HERE / "fastdds_enclave.cpp", directory, "-lfastrtps", "-lfastcdr")
    both = {"cyclone": Vendor(cyclone), "fastdds": Vendor(fastdds)}
    yield both
    for vendor in both.values():
        vendor.close()
