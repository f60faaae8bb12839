"""A user's Alloy file, as far as this program has to understand it (docs/alloy-properties.md).

What the Analyzer is given is the user's text, character for character, so that its complaints have the user's lines.
Read here are the commands, since a verdict on each must come back, and names that comments give to enclaves and topics.
Everything else is refused that could make a command say something else than it seems to: facts and sigs, scopes (the
facts are one structure, all of it), numbers (they overflow in silence), time, and modules that are not known.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Final

from msgspec import Struct

from keystore_audit import resources
from keystore_audit.engine.alloy.export import VOCABULARY
from keystore_audit.engine.alloy.user_tokens import NO_NUMBERS, Token, Wrong, tokens
from keystore_audit.errors import UsageError
from keystore_audit.findings import Location, Severity
from keystore_audit.given import GivenFile, check_beside
from keystore_audit.intent.source import Source, read_source
from keystore_audit.model.claims.globs import Globs
from keystore_audit.model.claims.named import Determinism, NamedPlace
from keystore_audit.model.claims.stated import Claim
from keystore_audit.properties import BY_ID
from keystore_audit.settings.document import dds_topic

CONSISTENT: Final = "KeystoreAuditIsConsistent"
"""The run that is added to each file: without an instance, nothing that the file says means anything."""

MAX_BYTES: Final = 100_000
"""A property file is written by people."""

MAX_COMMANDS: Final = 50
"""Of one file: each is asked of every kind of implementation, in both readings."""

MAX_NAMES: Final = 100
"""Names for enclaves and topics of one file."""

OPENED: Final = frozenset(
    {
        VOCABULARY,
        *("dds_security", "precedence", "authentication", "documents", "governance", "permissions", "capabilities"),
        *("outsiders", "enforcement", "properties", "vacuity", "information_flow", "claims"),
        *("util/relation", "util/graph", "util/ternary"),
    }
)
"""What may be opened: the static modules of the model, and libraries that only define functions."""

ABOUT: Final = ("enclave", "topic", "severity", "statement")
"""What a directive may be about."""

_MULTIPLICITIES: Final = ("one", "lone", "some", "disj")
_BEGINNING: Final = (*_MULTIPLICITIES, "all", "no", "{", "[", "(", "|", ",")
"""What stands before the first name of a declaration, or before a further one."""

_DIRECTIVE: Final = re.compile(r"//@[ \t]*(\S+)[ \t]+([^\s=]+)[ \t]*=[ \t]*(.*?)[ \t]*")
_NAME: Final = re.compile(r"[A-Z][A-Za-z0-9_]*", re.ASCII)
_ATOM: Final = re.compile(r"[A-Z]{1,2}[0-9]+(_.*)?", re.ASCII)
_DECLARED: Final = re.compile(r"^(?:\w+ )*?(?:fun|pred|assert|sig) ([\w, \n]+)", re.MULTILINE | re.ASCII)
_HUMP: Final = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])|[^A-Za-z0-9]+", re.ASCII)


class Asked(Struct, frozen=True, kw_only=True):
    """A command of a user's file. `kind`: check or run. `instance`: whether it is meant to have one.

    `id`: of the property that it is, unique in the file. `location`: where it stands.
    """

    id: str
    name: str
    kind: str
    instance: bool
    statement: str
    severity: Severity
    location: Location


class UserFile(Struct, frozen=True, kw_only=True):
    """A `file` of properties in Alloy. `text`: what the Analyzer is given, ASCII, the
    run `CONSISTENT` at its end; `places`: its names for enclaves and topics.
    """

    file: GivenFile
    text: str
    commands: tuple[Asked, ...]
    places: tuple[NamedPlace, ...]

    @property
    def path(self) -> str:
        """As the user gave it."""
        return self.file.path


def read_user_file(source: Source) -> UserFile:
    """Return what a file says. Raises errors.UsageError, with line and column, for what is refused."""
    if len(source.text) > MAX_BYTES:
        raise UsageError(f"{source.path} is larger than {MAX_BYTES} characters: no file of properties.")
    try:
        return _Reader(source).file()
    except Wrong as wrong:
        raise UsageError(f"{source.path}:{wrong.line}:{wrong.column}: {wrong.message}.") from None


def identifier(words: str) -> str:
    """Return words or a name in capitals as an id: small letters, digits and hyphens; perhaps nothing."""
    return "-".join(part.lower() for part in _HUMP.split(words) if part)


class _Reader:
    """One file being read, paragraph by paragraph."""

    def __init__(self, source: Source) -> None:
        self._source = source
        every = tokens(source.text.replace("\r\n", "\n"))
        self._comments = [token for token in every if token.kind == "comment"]
        self._code = [token for token in every if token.kind != "comment"]
        self._next = 0
        self._commands: dict[str, Token] = {}
        self._instance: dict[str, bool] = {}
        self._expects: list[Token] = []
        self._opened = False

    def file(self) -> UserFile:
        while self._next < len(self._code):
            self._paragraph(self._take())
        if not self._commands:
            raise Wrong(self._end, "expected a check or a run, found none: nothing would be asked")
        if not self._opened:
            raise Wrong(self._code[0], f"expected `open {VOCABULARY}`, which has the words to speak of a keystore")
        severities, statements, places = self._directives()
        self._check_variables(self._taken | {place.name for place in places})
        return UserFile(
            file=self._source.file,
            text=self._text(),
            commands=tuple(self._asked(name, severities, statements) for name in self._commands),
            places=places,
        )

    def _asked(self, name: str, severities: dict[str, Severity], statements: dict[str, str]) -> Asked:
        token, stem = self._commands[name], re.sub(r"\.als$", "", self._source.path.rpartition("/")[2])
        said = statements.get(name) or f"{name} of {self._source.path}."
        return Asked(
            id="-".join(filter(None, (identifier(stem) or "alloy", identifier(name)))),
            name=name,
            kind=token.text,
            instance=self._instance[name],
            statement=f"{said} (Alloy alone decides this.)",
            severity=severities.get(name, Severity.HIGH),
            location=Location(path=self._source.path, line=token.line, beside=True),
        )

    # paragraphs

    def _paragraph(self, first: Token) -> None:
        match first.text:
            case "module":
                self._word("the name of the module, without a path")
            case "open":
                self._open()
            case "pred" | "fun" | "assert":
                self._definition(first)
            case "check" | "run":
                self._command(first)
            case _:
                raise Wrong(first, f"expected module, open, pred, fun, assert, check or run, found {first.text!r}")

    def _open(self) -> None:
        first = self._word("the name of a module")
        path = first.text
        while self._peek("/"):
            self._take()
            path += "/" + self._word("the name of a module").text
        if path not in OPENED:
            raise Wrong(first, f"{path!r} is not among the modules that may be opened: {', '.join(sorted(OPENED))}")
        self._opened = self._opened or path == VOCABULARY
        if self._peek("as"):
            self._take()
            self._word("another name for the module")

    def _definition(self, first: Token) -> None:
        name = self._word("a name")
        if name.text in self._taken:
            raise Wrong(name, f"{name.text!r} has a meaning in the model already: call it something else")
        while not self._peek("{"):
            self._no_number(self._take_within(first))
        self._block()

    def _command(self, first: Token) -> None:
        name = self._word(f"`{first.text} NAME`, since its answer is reported by its name")
        if name.text in self._commands:
            raise Wrong(name, f"a second command is called {name.text!r}")
        if len(self._commands) == MAX_COMMANDS:
            raise Wrong(first, f"these are more than {MAX_COMMANDS} commands")
        if self._peek("{"):
            self._block()
        self._scope(name)
        self._commands[name.text] = first
        self._instance[name.text] = first.text == "run"
        if self._peek("expect"):
            expect, number = self._take(), self._take_within(name)
            if number.text not in ("0", "1"):
                raise Wrong(number, f"expected `expect 0` or `expect 1`, found {number.text!r}")
            self._instance[name.text] = number.text == "1"
            self._expects += (expect, number)

    def _scope(self, name: Token) -> None:
        """`for 0`: every sig of a keystore is there as it is, and a larger scope would invent more."""
        given = [self._take().text for _ in range(2) if self._next < len(self._code)]
        if given != ["for", "0"]:
            raise Wrong(name, f"expected `for 0` at the end of the command {name.text}: the facts are all there is")

    def _block(self) -> None:
        depth, first = 0, self._code[self._next]
        while True:
            token = self._take_within(first)
            depth += {"{": 1, "}": -1}.get(token.text, 0)
            if depth == 0:
                return
            self._no_number(token)

    # tokens

    def _no_number(self, token: Token) -> None:
        if token.kind == "number":
            raise Wrong(token, NO_NUMBERS)

    def _take(self) -> Token:
        self._next += 1
        return self._code[self._next - 1]

    def _take_within(self, what: Token) -> Token:
        if self._next == len(self._code):
            raise Wrong(what, f"expected the end of what begins here with {what.text!r}, found none")
        return self._take()

    def _peek(self, text: str) -> bool:
        return self._next < len(self._code) and self._code[self._next].text == text

    def _word(self, what: str) -> Token:
        before = self._code[self._next - 1]
        token = self._take() if self._next < len(self._code) else before
        if token is before or token.kind != "word":
            raise Wrong(token, f"expected {what}, found {token.text!r}")
        return token

    def _check_variables(self, taken: frozenset[str]) -> None:
        """Variables that are called like a word of the model would hide it: what follows would ask something else."""
        words = ["", "", *(token.text for token in self._code), ""]
        for place, token in enumerate(self._code, 2):
            after, before = words[place + 1], words[place - 1]
            if token.text not in taken or after not in (":", ",", "="):
                continue
            begins = before in _BEGINNING and not (before in _MULTIPLICITIES and words[place - 2] == ":")
            if before in ("let", ",") if after == "=" else begins and self._leads_to_colon(place - 2):
                raise Wrong(
                    token, f"{token.text!r} has a meaning in the model already: call the variable something else"
                )

    def _leads_to_colon(self, place: int) -> bool:
        """Whether the word at the place is of a list of names that ends in a colon."""
        place += 1
        while place + 1 < len(self._code) and self._code[place].text == ",":
            place += 2
        return place < len(self._code) and self._code[place].text == ":"

    @property
    def _end(self) -> Token:
        return self._code[-1] if self._code else Token("end", "", 0, 1, 1)

    @cached_property
    def _taken(self) -> frozenset[str]:
        return vocabulary() | {CONSISTENT}

    def _text(self) -> str:
        """The text for the Analyzer: comments in ASCII, and `expect` left to us, since it would be an error to it."""
        characters = list(self._source.text.replace("\r\n", "\n"))
        for token in self._expects:
            characters[token.start : token.start + len(token.text)] = " " * len(token.text)
        text = "".join(character if character.isascii() else "?" for character in characters)
        return f"{text}\nrun {CONSISTENT} {{}} for 0\n"

    # directives

    def _directives(self) -> tuple[dict[str, Severity], dict[str, str], tuple[NamedPlace, ...]]:
        severities: dict[str, Severity] = {}
        statements: dict[str, str] = {}
        globs: dict[tuple[str, str], list[str]] = {}
        first: dict[str, Token] = {}
        for comment in self._comments:
            if not comment.text.startswith("//@"):
                continue
            about, name, value = self._directive(comment)
            if about in ("severity", "statement") and name not in self._commands:
                raise Wrong(comment, f"there is no command {name!r}")
            if about == "severity":
                severities[name] = _severity(comment, value)
            elif about == "statement":
                statements[name] = value
            else:
                self._check_name(comment, about, name, globs)
                globs.setdefault((about, name), []).append(_glob(comment, about, value))
                first.setdefault(name, comment)
        if len(globs) > MAX_NAMES:
            raise Wrong(self._end, f"these are more than {MAX_NAMES} names")
        return severities, statements, tuple(self._places(globs, first))

    def _directive(self, comment: Token) -> tuple[str, str, str]:
        match = _DIRECTIVE.fullmatch(comment.text)
        if match is None or not match[3] or match[1] not in ABOUT:
            forms = "`//@ enclave Name = /path/*`, or topic, severity or statement in the place of enclave"
            raise Wrong(comment, f"expected {forms}, found {comment.text[:60]!r}")
        return match[1], match[2], match[3]

    def _check_name(self, comment: Token, about: str, name: str, globs: Iterable[tuple[str, str]]) -> None:
        if not _NAME.fullmatch(name) or _ATOM.fullmatch(name):
            raise Wrong(comment, f"{name!r} is no name for {about}s: expected a capital and letters, e.g. Brake")
        if name in self._taken or any(other == name and kind != about for kind, other in globs):
            raise Wrong(comment, f"{name!r} has a meaning already: call the {about} something else")

    def _places(self, globs: dict[tuple[str, str], list[str]], first: dict[str, Token]) -> Iterable[NamedPlace]:
        for (about, name), words in globs.items():
            place = f"{self._source.path}:{first[name].line}:{first[name].column}"
            found = Globs(enclaves=tuple(words)) if about == "enclave" else Globs(topics=tuple(words))
            yield NamedPlace(name=name, globs=found, place=place)


def _severity(comment: Token, value: str) -> Severity:
    try:
        return Severity(value)
    except ValueError:
        raise Wrong(comment, f"{value!r} is no severity: expected {', '.join(s.value for s in Severity)}") from None


def _glob(comment: Token, about: str, value: str) -> str:
    if about == "topic":
        try:
            return dds_topic(value)
        except ValueError as error:
            raise Wrong(comment, str(error)) from None
    if not value.startswith("/"):
        raise Wrong(comment, f"{value!r} is no enclave's path: it begins with /, e.g. /arm/*")
    return value


def vocabulary() -> frozenset[str]:
    """Return every name that a file sees: those that static modules declare, and the words of generated ones."""
    declared = {VOCABULARY, "Node", "runs_in", "publishes_to", "subscribes_to"}
    modules = {name for name in OPENED if "/" not in name} - {VOCABULARY} | {"keystore", "application"}
    for module in modules:
        text = (resources.alloy() / f"{module}.als").read_text(encoding="ascii")
        for names in _DECLARED.findall(text):
            declared |= set(re.findall(r"\w+", names))
    return frozenset(declared)


def read_user_files(
    paths: Sequence[Path], claims: Sequence[Claim | Determinism] = (), keystores: Sequence[str] = ()
) -> tuple[UserFile, ...]:
    """Return what the files say, beside the `claims` of settings.

    Raises errors.UsageError for a file that is none, for one that lies in one of the `keystores`, whose maker would
    then say what is asked, and where two properties have one id.
    """
    for path in paths:
        check_beside(path, keystores)
    files = tuple(read_user_file(read_source(path)) for path in paths)
    taken = dict.fromkeys(BY_ID, "that of a property which is always decided")
    taken.update((claim.id, f"taken at {claim.place}") for claim in claims)
    for file in files:
        for asked in file.commands:
            place = f"{file.path}:{asked.location.line}"
            if asked.id in taken:
                raise UsageError(f"{place}: the id of this property, {asked.id!r}, is {taken[asked.id]}.")
            taken[asked.id] = f"taken at {place}"
    return files
