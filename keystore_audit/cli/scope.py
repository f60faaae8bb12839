"""The options that choose what is judged: `--distro`, `--rmw` and `--profile`, which may stand together."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Final, TypeVar

import click

from keystore_audit.cli.completion import Known
from keystore_audit.errors import UsageError

F = TypeVar("F", bound=Callable[..., Any])
T = TypeVar("T")


def read(by: Callable[[str], T], value: str) -> T:
    """What the value means to `by`, which raises UsageError."""
    try:
        return by(value)
    except UsageError as error:
        raise click.BadParameter(error.message) from error


def together(*options: Callable[[F], F]) -> Callable[[F], F]:
    """Return what adds all the options, in the order of the help."""

    def add(command: F) -> F:
        for option in reversed(options):
            command = option(command)
        return command

    return add


def profile_name(value: str) -> str:
    """Return the name of a variant of an implementation, or an alias, as it was given."""
    from keystore_audit.profiles import resolve

    read(lambda name: resolve((name,)), value)
    return value


def _profiles() -> Iterable[str]:
    from keystore_audit.profiles import ALIASES, VARIANTS

    return (*VARIANTS, *ALIASES)


def _scopes() -> tuple[Iterable[str], Iterable[str]]:
    """What --distro and --rmw take."""
    from keystore_audit.profiles import DEFAULT, MIDDLEWARE, VARIANTS

    shipped = (name for each in DEFAULT for name in VARIANTS[each].distributions)
    return dict.fromkeys(shipped), dict.fromkeys((*MIDDLEWARE.values(), *MIDDLEWARE))


def _scoping(name: str, destination: str, words: Callable[[], Iterable[str]], text: str) -> Callable[[F], F]:
    """An option that chooses profiles together with `--profile`: read before it, and kept for `_in_scope`."""

    def kept(context: click.Context, _parameter: click.Parameter, words: tuple[str, ...]) -> None:
        context.meta[destination] = words

    return click.option(
        name,
        destination,
        type=Known(str, words),
        metavar="NAME",
        multiple=True,
        is_eager=True,
        expose_value=False,
        callback=kept,
        help=text,
    )


def _in_scope(context: click.Context, _parameter: click.Parameter, names: tuple[str, ...]) -> tuple[str, ...]:
    """The profiles that --distro, --rmw and --profile choose together."""
    distros, rmws = context.meta.get(_DISTROS, ()), context.meta.get(_RMWS, ())
    if not distros and not rmws:
        return names
    from keystore_audit.profiles import in_scope

    try:
        return in_scope(distros, rmws, names)
    except UsageError as error:
        raise click.UsageError(error.message, context) from error


_DISTROS: Final = "distros"
_RMWS: Final = "rmws"

scope_options: Final = together(
    _scoping(
        "--distro",
        _DISTROS,
        lambda: _scopes()[0],
        "Judge what this distribution of ROS 2 ships (repeatable; humble, jazzy, kilted, lyrical, rolling).",
    ),
    _scoping(
        "--rmw",
        _RMWS,
        lambda: _scopes()[1],
        "Of that, what this middleware runs on (repeatable; fastdds, cyclonedds, or as RMW_IMPLEMENTATION says).",
    ),
    click.option(
        "--profile",
        "profiles",
        type=Known(profile_name, _profiles),
        metavar="NAME",
        multiple=True,
        callback=_in_scope,
        help="Judge as this release of an implementation does (repeatable; docs/profiles.md has their names).",
    ),
)

"""They make one parameter, `profiles`: names of variants and aliases, none where nothing was chosen."""
