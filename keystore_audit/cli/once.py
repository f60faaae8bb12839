"""Commands whose options take one value each, and not the last of several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import click


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
