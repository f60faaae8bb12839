"""`keystore-audit can KEYSTORE ENCLAVE OPERATION NAME`."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final

import click
from click.core import ParameterSource

from keystore_audit.cli import options as opt
from keystore_audit.cli import output, types
from keystore_audit.cli.program import Command
from keystore_audit.errors import EXIT_INCOMPLETE, BudgetExceeded, UsageError
from keystore_audit.options import LAST_DOMAIN
from keystore_audit.profiles import facts

if TYPE_CHECKING:
    from keystore_audit.model.question import Answer, Question
    from keystore_audit.model.tables.access_table import AccessTable
    from keystore_audit.zenoh.answers import RoutedAnswer

ROS_OPERATIONS: Final = ("publish", "subscribe", "relay", "request", "reply", "call", "execute")
ROUTED_OPERATIONS: Final = tuple(each for each in ROS_OPERATIONS if each != "relay")
DDS_OPERATIONS: Final = ("publish", "subscribe", "relay")
KINDS: Final = ("ros", "dds")
EXPECTED: Final = ("allow", "deny")


@click.command("can", cls=Command, short_help="Say whether an enclave may do something, and which line decides.")
@click.argument("keystore", metavar="KEYSTORE", type=types.keystore_path)
@click.argument("words", metavar="[ENCLAVE OPERATION NAME]", nargs=-1)
@opt.choice(
    "--kind", words=KINDS, default="ros", help="What NAME is: of ROS, as /chatter, or of a DDS topic, as rt/chatter."
)
@opt.domain_option("In which domain (default: 0).")
@click.option(
    "--partition",
    "partitions",
    multiple=True,
    default=("",),
    metavar="NAME",
    help="In which partition (default: the one without a name); repeatable, of an endpoint in several at once.",
)
@opt.reading_options
@opt.network_option
@opt.file_options
@opt.format_option("How the answer is written.", "text", "json")
@click.option("--effective", is_flag=True, help="The exit code is about what peers accept, not about own checks.")
@opt.choice("--expect", words=EXPECTED, help="Exit with 0 only if every answer is this.")
@click.option(
    "--batch",
    type=click.Path(allow_dash=True, dir_okay=False, exists=True),
    metavar="FILE",
    help="Queries, one a line: enclave, operation, DDS name [, domain [, partitions]], with tabs between; - for stdin.",
)
@opt.verbose_option()
def command(keystore: str, words: tuple[str, ...], **given: Any) -> int:
    """Say whether ENCLAVE may do OPERATION on NAME, under each profile, and which line decides.

    \b
    OPERATION and NAME:
      publish, subscribe, relay   a topic, as /chatter
      request, reply              a service: both of its topics
      call, execute               an action: all of its topics and services
    \b
    Exit codes:
      0   every profile allows (or answers as --expect says)
      1   some profile denies, or allows a part alone
      4   some profile's answer is unknown
    """  # noqa: D301 - click's mark for lines that stay as they are
    if given["batch"] is not None and given["network"] is None:
        _check_batch(words, given)
        return _batch(keystore, given)
    if len(words) != 3:
        raise click.UsageError("Name ENCLAVE, OPERATION and NAME, e.g. `/talker publish /chatter`.")
    return (_one if given["network"] is None else _in_network)(keystore, *words, given)


def _in_network(keystore: str, enclave: str, operation: str, name: str, given: dict[str, Any]) -> int:
    """Answer by the files of the middleware that routes, by which permissions and partitions do not count."""
    from keystore_audit.access import routed
    from keystore_audit.intent.intent import is_ros_name
    from keystore_audit.report import routed_answer

    asked_of = opt.in_network(given, opt.named_settings(given, keystore), "batch", "kind", "partitions")
    if operation not in ROUTED_OPERATIONS:
        raise click.UsageError(types.unknown(f"{operation!r} is not one of", operation, ROUTED_OPERATIONS))
    if not is_ros_name(name):
        raise click.UsageError(f"{name!r} is no fully qualified ROS name: expected one like /chatter.")
    asked = routed(keystore, (enclave, operation, name), *asked_of)
    render = routed_answer.json if given["form"] == "json" else routed_answer.text
    output.write_stdout(render(asked))
    return _exit_code(asked.answers.values(), effective=given["effective"], expected=given["expect"])


def _check_batch(words: Sequence[str], given: dict[str, Any]) -> None:
    """Refuse what would be without effect beside --batch."""
    if words:
        raise click.UsageError("With --batch the queries come from the file: leave ENCLAVE, OPERATION and NAME out.")
    if given["expect"] is not None:
        raise click.UsageError("--batch answers questions and judges nothing: leave --expect out.")
    context = click.get_current_context()
    for option, parameter, value in (("--kind", "kind", "ros"), ("--format", "form", "text")):
        if context.get_parameter_source(parameter) is not ParameterSource.DEFAULT and given[parameter] == value:
            fixed = "names are those of DDS topics" if parameter == "kind" else "each answer is a line of JSON"
            raise click.UsageError(f"With --batch {fixed}: leave {option} {value} out.")


def _one(keystore: str, enclave: str, operation: str, name: str, given: dict[str, Any]) -> int:
    from keystore_audit.access import Access
    from keystore_audit.model.domains import contains, describe
    from keystore_audit.report import answer

    questions = _questions(enclave, operation, name, given)
    reading = opt.reading(given, opt.named_settings(given, keystore))
    access = Access(keystore, questions, reading)
    governed = access.governed(enclave) if given["domain"] is None else ()
    if governed and given["expect"] == "deny" and not contains(governed, 0):
        said = f"The governance of {enclave} covers domain {describe(governed)} and not 0, which would be asked about"
        raise UsageError(f"{said}: name the domain for --expect deny.")
    answers = access.joint(questions)
    asked = answer.Asked(
        enclave=enclave,
        operation=operation,
        name=name,
        domain=questions[0].domain,
        partitions=given["partitions"],
        dds_names=tuple((each.operation.value, each.topic) for each in questions),
        governed=governed,
        at=reading.at,
        fleets=reading.profiles,
    )
    render = answer.json if given["form"] == "json" else answer.text
    output.write_stdout(render(asked, answers))
    return _exit_code(answers.values(), effective=given["effective"], expected=given["expect"])


def _questions(enclave: str, operation: str, name: str, given: dict[str, Any]) -> tuple[Question, ...]:
    """The questions about DDS topics that the question is made of."""
    from keystore_audit.intent.intent import is_ros_name
    from keystore_audit.keystore.typed import Operation
    from keystore_audit.model.names import dds_channels
    from keystore_audit.model.question import Question

    known = DDS_OPERATIONS if given["kind"] == "dds" else ROS_OPERATIONS
    if operation not in known:
        raise click.UsageError(types.unknown(f"{operation!r} is not one of", operation, known))
    if not name:
        raise click.UsageError("NAME is empty: nothing is called so.")
    if given["kind"] == "ros" and not is_ros_name(name):
        expected = "expected one like /chatter; with --kind dds, that of a DDS topic, like rt/chatter"
        raise click.UsageError(f"{name!r} is no fully qualified ROS name: {expected}.")
    channels = dds_channels(operation, name) if given["kind"] == "ros" else ((Operation(operation), name),)
    return tuple(
        Question(
            enclave=enclave, operation=each, topic=topic, domain=given["domain"] or 0, partitions=given["partitions"]
        )
        for each, topic in channels
    )


def _exit_code(answers: Collection[Answer | RoutedAnswer], *, effective: bool, expected: str | None) -> int:
    """4 where any answer is unknown, 0 where all are `expected` (none: allow), else 1."""
    words = {answer.accepted if effective else answer.decided for answer in answers}
    if "unknown" in words:
        return EXIT_INCOMPLETE
    return 0 if words == {expected or "allow"} else 1


def _batch(keystore: str, given: dict[str, Any]) -> int:
    """Answer each line of the file with one of JSON."""
    from keystore_audit.access import Access
    from keystore_audit.report import answer

    lines, reading = list(_lines(given["batch"])), opt.reading(given, opt.named_settings(given, keystore))
    parsed = [_parse(line, given["domain"] or 0, given["partitions"]) for line in lines]
    try:
        access = Access(keystore, [each for each in parsed if not isinstance(each, str)], reading)
    except BudgetExceeded as error:
        output.write_stdout("".join(answer.error(number, error.message) for number, _ in enumerate(parsed, 1)))
        return EXIT_INCOMPLETE
    code = 0
    written: list[str] = []
    for number, each in enumerate(parsed, 1):
        if isinstance(each, str):
            written.append(answer.error(number, each))
            code = EXIT_INCOMPLETE
            continue
        try:
            answers = access.answers(each)
        except UsageError as error:
            written.append(answer.error(number, error.message))
            code = EXIT_INCOMPLETE
            continue
        asked = answer.Asked(
            enclave=each.enclave,
            operation=each.operation.value,
            name=each.topic,
            domain=each.domain,
            partitions=each.partitions,
            dds_names=((each.operation.value, each.topic),),
            at=reading.at,
            fleets=reading.profiles,
        )
        written.append(answer.json(asked, answers))
        code = code or _exit_code(answers.values(), effective=given["effective"], expected=None) // 4 * 4
    output.write_stdout("".join(written))
    return code


def _lines(path: str) -> Iterator[bytes]:
    """The lines of the file, without their ends."""
    try:
        if path == "-":
            content = sys.stdin.buffer.read()
        else:
            with open(path, "rb") as file:
                content = file.read()
    except OSError as error:
        raise UsageError(f"The queries cannot be read from {path}: {error.strerror or error}.") from error
    lines = content.split(b"\n")
    if lines and not lines[-1]:
        lines.pop()
    yield from (line.removesuffix(b"\r") for line in lines)


def _parse(line: bytes, domain: int, partitions: tuple[str, ...]) -> Question | str:
    """The query, in this domain and these partitions if it names none, or what is wrong with the line."""
    from keystore_audit.keystore.typed import Operation
    from keystore_audit.model.question import Question

    try:
        fields = line.decode("utf-8").split("\t")
    except UnicodeDecodeError:
        return "not UTF-8"
    if len(fields) < 3:
        return f"expected 3 fields or more with tabs between, found {len(fields)}"
    enclave, operation, name = fields[:3]
    if operation not in DDS_OPERATIONS:
        return f"unknown operation {operation!r}; expected publish, subscribe or relay"
    if not name:
        return "the name is empty"
    if len(fields) > 3:
        number = fields[3]
        if not (number.isascii() and number.isdigit() and len(number) <= 3 and int(number) <= LAST_DOMAIN):
            return f"{number!r} is no domain of 0 to {LAST_DOMAIN}"
        domain = int(number)
    return Question(
        enclave=enclave,
        operation=Operation(operation),
        topic=name,
        domain=domain,
        partitions=tuple(fields[4:]) or partitions,
    )


FORMATS: Final = ("text", "json", "csv")
MAX_WIDTH: Final = 200
"""A line longer than that is lost to the eye."""


@click.command("access", cls=Command, short_help="Show who may do what: enclaves and topics.")
@click.argument("keystore", metavar="KEYSTORE", type=types.keystore_path)
@opt.format_option("How the table is written.", *FORMATS)
@opt.domain_option(f"In which domain (default: the lowest that a governance covers; 0 with {facts.NETWORK_OPTION}).")
@opt.reading_options
@opt.network_option
@opt.file_options
@opt.verbose_option()
def access_command(keystore: str, **given: Any) -> int:
    """Show who may do what in KEYSTORE: its enclaves and all topics, for each implementation.

    \b
    Exit codes:
      0   everything is decided
      3   nothing to look at there
      4   something is unknown
    """  # noqa: D301 - click's mark for lines that stay as they are
    from keystore_audit.access import read_access_table

    if given["network"] is not None:
        return _network_table(keystore, given)
    table = read_access_table(keystore, opt.reading(given, opt.named_settings(given, keystore)))
    output.write_stdout(_rendered(table, given["form"]))
    return EXIT_INCOMPLETE if table.has_unknown else 0


def _network_table(keystore: str, given: dict[str, Any]) -> int:
    """What the files of the middleware that routes let enclaves do, by which permissions do not count."""
    from keystore_audit.access import routed_tables
    from keystore_audit.report import routed_access

    network, reading, asked = opt.in_network(given, opt.named_settings(given, keystore))
    (table,) = routed_tables([(keystore, network)], reading, asked)
    render = {"text": routed_access.text, "json": routed_access.json, "csv": routed_access.csv}[given["form"]]
    output.write_stdout(render(table))
    return EXIT_INCOMPLETE if table.has_unknown else 0


def _rendered(table: AccessTable, kind: str) -> str:
    from keystore_audit.report import access_text

    if kind == "text":
        return access_text.text(table, max(output.WIDTH, output.columns(MAX_WIDTH)))
    return access_text.json(table) if kind == "json" else access_text.csv(table)
