"""The program: finds the command, and turns whatever ends it into a sentence and an exit code."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

import click

from keystore_audit import __version__
from keystore_audit.cli.types import COMMANDS, directories
from keystore_audit.errors import EXIT_INCOMPLETE, EXIT_INTERRUPTED, EXIT_USAGE, AuditError, fault

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

NAME: Final = "keystore-audit"
DEFAULT_COMMAND: Final = "audit"


class Command(click.Command):
    """A command that refuses a second value of an option that takes one.

    Click keeps the last and says nothing: what the first one asked for, as the settings that a script names, would be
    asked by nobody. The help shows the options in `groups`, the names of parameters under each heading.
    """

    def __init__(self, *arguments: Any, groups: Mapping[str, Sequence[str]] | None = None, **more: Any) -> None:
        """As click's; without groups, options stand under one heading."""
        super().__init__(*arguments, **more)
        self.groups = groups or {}

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write each group, and what is in none under "Other"."""
        if not self.groups:
            super().format_options(ctx, formatter)
            return
        options = (each for each in self.get_params(ctx) if isinstance(each, click.Option))
        records = {each.name: record for each in options if (record := each.get_help_record(ctx))}
        for heading, names in self.groups.items():
            with formatter.section(heading):
                formatter.write_dl([record for name in names if (record := records.pop(name, None))])
        with formatter.section("Other"):
            formatter.write_dl([*records.values()])

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse as click does, then look for options that occur again; help and version have answered by then."""
        given = [*args]
        rest = super().parse_args(ctx, args)
        if not ctx.resilient_parsing:
            _values, _rest, order = self.make_parser(ctx).parse_args(given)
            _refuse_second(order, ctx)
        return rest


class Group(Command, click.Group):
    """A group of such commands."""

    command_class = Command


def _refuse_second(order: Sequence[click.Parameter], ctx: click.Context) -> None:
    """Raise UsageError for an option with a value that stands in `order`, as all occurred, more than once."""
    seen: set[click.Parameter] = set()
    for option in order:
        if not isinstance(option, click.Option) or option.is_flag or option.multiple:
            continue
        if option in seen:
            name = max(option.opts, key=len)
            raise click.UsageError(f"{name} is given twice and takes one value: give it once.", ctx)
        seen.add(option)


class Program(Group):
    """The commands; a first argument that is none of them belongs to `audit`."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        """Return the commands in the order of the help."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import the command; None if there is none of that name."""
        if cmd_name not in COMMANDS:
            return None
        module, attribute = COMMANDS[cmd_name]
        command: click.Command = getattr(import_module(f"keystore_audit.cli.{module}"), attribute)
        return command

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Put the default command where none is named."""
        own = {name for option in self.get_params(ctx) for name in option.opts}
        if ctx.resilient_parsing and not args:  # a shell asks what may come first
            return super().parse_args(ctx, args)
        if not args:
            raise click.UsageError(f"Name a keystore, e.g. `{NAME} ./keys`, or a command: {', '.join(COMMANDS)}.")
        if args[0] not in own and args[0] not in COMMANDS:
            args = [DEFAULT_COMMAND, *args]
        return super().parse_args(ctx, args)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Offer commands, and directories: a keystore may come first."""
        found = super().shell_complete(ctx, incomplete)
        default = self.get_command(ctx, DEFAULT_COMMAND)
        if incomplete.startswith("-") and default is not None:  # its name may be left out
            inner = default.shell_complete(click.Context(default, parent=ctx), incomplete)
            return list({item.value: item for item in (*found, *inner)}.values())
        return [*directories(incomplete), *found]


@click.command(
    NAME,
    cls=Program,
    subcommand_metavar="[COMMAND] [ARGS]...",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 80},
    epilog=f"`{NAME} ./keys` is `{NAME} audit ./keys`. Options of a command: `{NAME} COMMAND --help`.",
)
@click.version_option(__version__, prog_name=NAME, message="%(prog)s %(version)s")
def program() -> None:
    """Audit SROS2 keystores: what the signed artifacts on disk really allow."""


def run(args: Sequence[str]) -> int:
    """Run the command line `args` and return the exit code; no exception leaves this function but SystemExit."""
    said: dict[str, bool] = {}  # by options, while they are read
    try:
        code = program.main(
            list(args),
            prog_name=NAME,
            # Scripts of completion call the bare command. Beside a command line the variable would be an exit 0 that
            # nobody audited for.
            complete_var=None if not args else "=",  # which no variable is called
            standalone_mode=False,
            obj=said,
        )
    except click.Abort:  # click's name for KeyboardInterrupt
        return _end(EXIT_INTERRUPTED, "Interrupted: there is no verdict.")
    except click.UsageError as error:
        if isinstance(error, click.NoSuchOption):
            alike = _alike(error.option_name, error.possibilities or ())
            error = click.NoSuchOption(error.option_name, possibilities=alike, ctx=error.ctx)
        if error.ctx is not None:
            click.echo(error.ctx.get_usage(), err=True)
            click.echo(f"Try '{error.ctx.command_path} --help' for help.\n", err=True)
        return _end(EXIT_USAGE, error.format_message())
    except click.ClickException as error:
        return _end(EXIT_USAGE, error.format_message())
    except AuditError as error:
        return _end(error.exit_code, error.message)
    except Exception as error:  # noqa: BLE001 - the one place that keeps a traceback from the user
        return _end(EXIT_INCOMPLETE, fault(error, verbose=said.get("verbose", False)))
    return code if isinstance(code, int) else 0


def _alike(option: str, possibilities: Iterable[str]) -> list[str]:
    """Those that are like `option` without the hyphens, which all of them have."""
    from difflib import get_close_matches  # for mistakes alone

    names = {each.lstrip("-"): each for each in possibilities}
    return [names[name] for name in get_close_matches(option.lstrip("-"), names)]


def _end(code: int, sentence: str) -> int:
    from keystore_audit.cli.output import say

    say(sentence)
    return code
