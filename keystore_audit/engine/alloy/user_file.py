"""A user's Alloy file, as far as this program has to understand it (docs/alloy-properties.md).

The Analyzer gets the user's text, character for character, so that its complaints have the user's lines. Read here are
the commands, since a verdict on each must come back, and names that comments give to enclaves and topics. What could
make a command say something else than it seems to is refused. That is facts and sigs, scopes (the facts are one
structure, all of it), numbers (they overflow in silence), time, and unknown modules. Control characters end the
Analyzer's comments, and `/**/` begins a longer one: without them both sides see the same comments.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from msgspec import Struct

from keystore_audit import resources
from keystore_audit.engine.alloy.export import VOCABULARY
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

NO_NUMBERS: Final = "numbers overflow in silence; say `lone`, or `some disj a, b: ...`"

_REFUSED: Final = {
    **dict.fromkeys(("fact", "sig", "enum", "extends", "abstract", "var"), "a file asks, it adds no facts and no sigs"),
    **dict.fromkeys(("Int", "int", "sum", "seq", "String", "plus", "minus", "mul", "div", "rem"), NO_NUMBERS),
    **dict.fromkeys(
        ("always", "eventually", "after", "before", "once", "historically", "until", "since", "releases", "triggered"),
        "nothing changes with time in these modules: settings have `until` (docs/settings.md)",
    ),
    **dict.fromkeys(("steps", "but", "exactly", "private", "macro"), "expected no such word here"),
}
"""Words that a file does not have, and why."""

_FORMS: Final = {
    "module": (r"module (\w+)", "`module NAME`, without a path"),
    "open": (
        r"open (\w+(?: / \w+)*)(?: as \w+)?",
        f"one of the modules that may be opened: {', '.join(sorted(OPENED))}",
    ),
    **dict.fromkeys(
        ("pred", "fun", "assert"), (r"\w+ (\w+) (?=[\[:{])(?!.*\blet\b).*\}", "`pred NAME { ... }`, or fun or assert")
    ),
    **dict.fromkeys(
        ("check", "run"),
        (
            r"\w+ (\w+)(?: \{ \})? for 0(?: expect ([01]))?",
            "`check NAME for 0` or `run NAME { ... } for 0`, `expect 0` or `expect 1`: larger scopes would invent more",
        ),
    ),
}
"""By the word with which a paragraph begins: its tokens without what braces enclose, and what that is in words."""

_TOKEN: Final = re.compile(
    r"(?P<comment>(?://|--)[^\n]*|/\*(?!\*/).*?\*/)"
    r"|(?P<word>[A-Za-z_]\w*)"
    r"|(?P<number>[0-9]+)"
    r"|(?P<mark>[\[\]{}()|&+\-*~^.,:=<>!@]|/(?!\*))"
    r"|(?P<stranger>[^ \t\n])",
    re.DOTALL | re.ASCII,
)
_CONTROL: Final = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029]")
_VARIABLES: Final = re.compile(
    r"(?:(?<!\S)(?:[{\[(|,]|(?P<of>: )?(?:one|lone|some|disj|all|no))) (?P<names>\w+(?: , \w+)*)(?= :)"
    r"|(?<!\S)(?:let|,) (?P<let>\w+)(?= =)",
    re.ASCII,
)
"""A declaration of variables, in tokens with a blank before each; `of`: the multiplicity of another one's range."""

_DIRECTIVE: Final = re.compile(r"//@[ \t]*(enclave|topic|severity|statement)[ \t]+([^\s=]+)[ \t]*=[ \t]*(.*?\S)[ \t]*")
_NAME: Final = re.compile(r"(?![A-Z]{1,2}[0-9]+(?:_|$))[A-Z]\w*", re.ASCII)
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


class _Token(NamedTuple):
    """`kind`: word, number, mark or comment; `start`: index in the text."""

    kind: str
    text: str
    start: int
    line: int


def identifier(words: str) -> str:
    """Return words or a name in capitals as an id: small letters, digits and hyphens; perhaps nothing."""
    return "-".join(part.lower() for part in _HUMP.split(words) if part)


def read_user_file(source: Source) -> UserFile:
    """Return what a file says. Raises errors.UsageError, with the line, for what is refused."""
    if len(source.text) > MAX_BYTES:
        raise UsageError(f"{source.path} is larger than {MAX_BYTES} characters: no file of properties.")
    text = source.text.replace("\r\n", "\n")
    every = list(_tokens(source, text))
    code = [token for token in every if token.kind != "comment"]
    known = vocabulary() | {CONSISTENT}
    commands: dict[str, tuple[_Token, bool]] = {}
    given, opened = list(text), False
    for paragraph in _paragraphs(source, code):
        first, name, expected = _form(source, paragraph)
        opened |= first.text == "open" and name == VOCABULARY
        if first.text in ("pred", "fun", "assert") and name in known:
            raise source.malformed(first.line, f"{name!r} has a meaning in the model already: call it something else")
        if first.text in ("check", "run"):
            if name in commands:
                raise source.malformed(first.line, f"a second command is called {name!r}")
            commands[name] = first, first.text == "run" if expected is None else expected == "1"
            for token in paragraph[-2:] if expected else ():  # an error to the Analyzer, and left to us
                given[token.start : token.start + len(token.text)] = " " * len(token.text)
    if not opened:
        raise source.malformed(1, f"expected `open {VOCABULARY}`, which has the words to speak of a keystore")
    if not 0 < len(commands) <= MAX_COMMANDS:
        raise source.malformed(1, f"expected a check or a run, and {MAX_COMMANDS} at most, found {len(commands)}")
    said, places = _directives(source, [each for each in every if each.text.startswith("//@")], known, commands)
    _check_variables(source, code, known | {place.name for place in places})
    return UserFile(
        file=source.file,
        text=f"{''.join(each if each.isascii() else '?' for each in given)}\nrun {CONSISTENT} {{}} for 0\n",
        commands=tuple(_asked(source, name, *commands[name], said) for name in commands),
        places=places,
    )


def _tokens(source: Source, text: str) -> Iterator[_Token]:
    if control := _CONTROL.search(text):
        line = text.count("\n", 0, control.start()) + 1
        raise source.malformed(line, f"expected no control character, found {control[0]!r}")
    for match in _TOKEN.finditer(text):
        line, kind = text.count("\n", 0, match.start()) + 1, match.lastgroup or ""
        if kind == "stranger":
            raise source.malformed(line, f"expected Alloy without texts, numbers and time, found {match[0]!r}")
        if kind == "word" and match[0] in _REFUSED:
            raise source.malformed(line, f"{match[0]!r}: {_REFUSED[match[0]]}")
        yield _Token(kind, match[0], match.start(), line)


def _paragraphs(source: Source, code: Iterable[_Token]) -> list[list[_Token]]:
    """Each begins with a word of `_FORMS`; what stands within braces is left out. Numbers stand in scopes alone."""
    found: list[list[_Token]] = []
    depth = 0
    for token in code:
        depth -= token.text == "}"
        if depth == 0 and token.text in _FORMS:
            found.append([])
        if not found:
            raise source.malformed(token.line, f"expected {', '.join(_FORMS)}, found {token.text!r}")
        if token.kind == "number" and (depth or found[-1][0].text not in ("check", "run")):
            raise source.malformed(token.line, f"expected no numbers: {NO_NUMBERS}")
        found[-1] += [token] if depth == 0 else []
        depth += token.text == "{"
    return found


def _form(source: Source, paragraph: Sequence[_Token]) -> tuple[_Token, str, str | None]:
    """The word with which it begins, what it names, and of a command whether it is said to have an instance."""
    first, said = paragraph[0], " ".join(token.text for token in paragraph)
    form, words = _FORMS[first.text]
    match = re.fullmatch(form, said, re.ASCII)
    name = "" if match is None else match[1].replace(" ", "")
    if match is None or (first.text == "open" and name not in OPENED):
        raise source.malformed(paragraph[-1].line, f"expected {words}, found {said[:80]!r}")
    return first, name, match[2] if first.text in ("check", "run") else None


def _check_variables(source: Source, code: Sequence[_Token], known: frozenset[str]) -> None:
    """Variables that are called like a word of the model would hide it: what follows would ask something else."""
    text = "".join(f" {token.text}" for token in code)
    for match in _VARIABLES.finditer(text):
        names = match["let"] or ("" if match["of"] else match["names"])
        for name in known.intersection(names.split(" , ")):
            line = code[text.count(" ", 0, match.start()) - 1].line
            raise source.malformed(
                line, f"{name!r} has a meaning in the model already: call the variable something else"
            )


def _directives(
    source: Source, comments: Iterable[_Token], known: Collection[str], commands: Collection[str]
) -> tuple[Mapping[tuple[str, str], str], tuple[NamedPlace, ...]]:
    """What comments say: by severity or statement and command; and of names."""
    said: dict[tuple[str, str], str] = {}
    globs: dict[str, tuple[str, list[str], int]] = {}
    for comment in comments:
        line, match = comment.line, _DIRECTIVE.fullmatch(comment.text)
        if match is None:
            forms = "`//@ enclave Name = /path/*`, or topic, severity or statement in the place of enclave"
            raise source.malformed(line, f"expected {forms}, found {comment.text[:60]!r}")
        about, name, value = match.groups()
        if about in ("severity", "statement"):
            if name not in commands:
                raise source.malformed(line, f"there is no command {name!r}")
            if about == "severity" and value not in [each.value for each in Severity]:
                raise source.malformed(line, f"{value!r} is no severity: expected {', '.join(Severity)}")
            said[about, name] = value
            continue
        if not _NAME.fullmatch(name):
            raise source.malformed(
                line, f"{name!r} is no name for {about}s: expected a capital and letters, e.g. Brake"
            )
        if name in known or globs.get(name, (about,))[0] != about:
            raise source.malformed(line, f"{name!r} has a meaning already: call the {about} something else")
        globs.setdefault(name, (about, [], line))[1].append(_glob(source, line, about, value))
    if len(globs) > MAX_NAMES:
        raise source.malformed(1, f"these are more than {MAX_NAMES} names")
    return said, tuple(
        NamedPlace(
            name=name,
            globs=Globs(enclaves=tuple(words)) if about == "enclave" else Globs(topics=tuple(words)),
            place=f"{source.path}:{line}",
        )
        for name, (about, words, line) in globs.items()
    )


def _glob(source: Source, line: int, about: str, value: str) -> str:
    if about == "topic":
        try:
            return dds_topic(value)
        except ValueError as error:
            raise source.malformed(line, str(error)) from None
    if not value.startswith("/"):
        raise source.malformed(line, f"{value!r} is no enclave's path: it begins with /, e.g. /arm/*")
    return value


def _asked(source: Source, name: str, first: _Token, instance: bool, said: Mapping[tuple[str, str], str]) -> Asked:
    stem = source.path.rpartition("/")[2].removesuffix(".als")
    statement = said.get(("statement", name), f"{name} of {source.path}.")
    return Asked(
        id="-".join(filter(None, (identifier(stem) or "alloy", identifier(name)))),
        name=name,
        kind=first.text,
        instance=instance,
        statement=f"{statement} (Alloy alone decides this.)",
        severity=Severity(said.get(("severity", name), Severity.HIGH.value)),
        location=Location(path=source.path, line=first.line, beside=True),
    )


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

    Raises errors.UsageError for a file that is not readable as one, and where two properties have one id. So it does
    for a file in one of the `keystores`: their maker could then choose what is asked.
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
