"""How three XML parsers read a document: tinyxml2 (Fast DDS), Cyclone DDS's own, libxml2 (ours, through lxml)."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

from lxml import etree
from msgspec import Struct

from tests.conftest import lacking

_SOURCES = Path(__file__).parent


class Item(NamedTuple):
    """One thing that a parser hands out, in document order: a value, an element with elements in it, an attribute."""

    kind: str
    path: str
    value: str


Reading = tuple[Item, ...] | None
"""None: the parser refuses the document."""


class Parser(Struct, frozen=True):
    """A parser that we did not write, in a process that lives as long as the tests ask it."""

    process: subprocess.Popen[bytes]

    def items(self, document: bytes) -> tuple[Item, ...]:
        """Everything the parser reads; a refusal is one item of kind R."""
        stdin, stdout = self.process.stdin, self.process.stdout
        assert stdin is not None
        assert stdout is not None
        stdin.write(len(document).to_bytes(4, "big") + document)
        stdin.flush()
        header = stdout.read(4)
        assert len(header) == 4, f"the parser died ({self.process.wait()}) on {document!r}"
        # Octets that are no UTF-8 stay apart from all that is: some parsers let them pass.
        fields = stdout.read(int.from_bytes(header, "big")).decode("utf-8", "surrogateescape").split("\0")[:-1]
        return tuple(Item(*fields[place : place + 3]) for place in range(0, len(fields), 3))

    def read(self, document: bytes) -> Reading:
        """What a DDS implementation reads with it: without the attributes that they pass over."""
        items = self.items(document)
        if items[0].kind == "R":
            return None
        return tuple(item for item in items if not (item.kind == "A" and item.path.endswith(_PASSED_OVER)))


_PASSED_OVER = ("@xmlns:xsi", "@xsi:noNamespaceSchemaLocation")
"""Of any element: Fast DDS asks for names of grants alone, Cyclone DDS's plugin refuses all others but these."""


class Parsers(Struct, frozen=True):
    """The parsers of the two vendors."""

    tinyxml2: Parser
    cyclone: Parser


@contextmanager
def running(find: Callable[[str], str], directory: Path) -> Iterator[Parsers]:
    """Compile both and keep them running; without compiler or library the test skips, in CI it fails."""
    with ExitStack() as stack:
        tinyxml2 = compiled(find("c++"), "tinyxml2_reading.cpp", directory, "-ltinyxml2")
        cyclone = compiled(find("cc"), "cyclone_reading.c", directory, "-lddsc")
        yield Parsers(stack.enter_context(_started(tinyxml2)), stack.enter_context(_started(cyclone)))


_made: dict[tuple[str, ...], Path] = {}
"""What was compiled already, for another module of tests: a program in C++ takes two to six seconds."""


def compiled(compiler: str, source: str | Path, directory: Path, *libraries: str) -> Path:
    """The program made of `source` (a path, or a name here); without a library the test skips, in CI it fails.

    In `directory`, or where it was made before.
    """
    asked = (compiler, str(source), *libraries)
    if asked in _made:
        return _made[asked]
    program = directory / Path(source).stem
    options = ("-O1", "-Wall", "-Wextra", "-Werror", f"-I{_SOURCES}")  # for document_stream.h
    command = [compiler, *options, "-o", str(program), str(_SOURCES / source), *libraries]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        lacking(f"what compiles {source} (a -dev package?): {done.stderr[:400]}")
    _made[asked] = program
    return program


MEASURED_WITH = {"TINYXML2_MAJOR_VERSION": "9", "DDS_VERSION": '"0.10.2"', "FASTRTPS_VERSION_STR": '"2.9.1"'}
"""What the committed tables were measured with: Debian 12."""

_HEADERS = ("tinyxml2.h", "dds/version.h", "fastrtps/config.h")


def require_measured_versions(find: Callable[[str], str]) -> None:
    """Skip where other releases are installed than those of the tables, which say nothing of them; fail in CI."""
    command = [find("c++"), "-E", "-dM", "-x", "c++", *(f"-include{header}" for header in _HEADERS), "/dev/null"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    words = [line.split(maxsplit=2) for line in done.stdout.splitlines()]
    installed = {word[1]: word[2] for word in words if len(word) == 3 and word[1] in MEASURED_WITH}
    if installed != MEASURED_WITH:
        lacking(f"what was measured with, {MEASURED_WITH}: there are {installed}")


@contextmanager
def _started(program: Path) -> Iterator[Parser]:
    with subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        yield Parser(process)
        assert process.stdin is not None
        process.stdin.close()


def lxml_reading(document: bytes) -> Reading:
    """What libxml2 reads when entities stay as they are and comments and CDATA count for nothing."""
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False)
    try:
        root = etree.fromstring(document, parser)
    except (etree.XMLSyntaxError, ValueError, LookupError):
        return None
    return tuple(_walk(root, ""))


def _walk(element: etree._Element, parent: str) -> Iterator[Item]:
    path = f"{parent}{element.tag!s}"
    children = list(element.iterchildren(etree.Element))
    text = "" if children else (element.text or "") + "".join(child.tail or "" for child in element)
    yield Item("E" if children else "V", path, str(text))
    for name, value in element.items():
        if not str(name).endswith("}noNamespaceSchemaLocation"):
            yield Item("A", f"{path}@{name!s}", str(value))
    for child in children:
        yield from _walk(child, path + "/")
