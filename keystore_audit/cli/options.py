"""Types and options that commands share."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import click
from click.core import ParameterSource

from keystore_audit.assumptions import EVERY, Assumption
from keystore_audit.cli.types import Known, Number, Word, instant, launch_argument, profile_name, seconds, zone_name
from keystore_audit.errors import UsageError
from keystore_audit.options import LAST_DOMAIN, declared_files, now
from keystore_audit.profiles import MIDDLEWARE, Release, facts, releases

if TYPE_CHECKING:
    from keystore_audit.circumstances import Circumstances
    from keystore_audit.engine.engines import Engines
    from keystore_audit.settings.settings import Settings

ATTACKERS: Final = ("honest", "source", "relays")

F = TypeVar("F", bound=Callable[..., Any])
T = TypeVar("T")


def together(*options: Callable[[F], F]) -> Callable[[F], F]:
    """Return what adds all the options, in the order of the help."""

    def add(command: F) -> F:
        for option in reversed(options):
            command = option(command)
        return command

    return add


def _profiles() -> Iterable[str]:
    from keystore_audit.profiles import ALIASES, ROUTED, VARIANTS

    return (*VARIANTS, *ROUTED, *ALIASES)


def _scopes() -> tuple[Iterable[str], Iterable[str]]:
    """What --distro and --rmw take."""
    from keystore_audit.profiles import DEFAULT, MIDDLEWARE, ROUTING, VARIANTS

    shipped = (name for each in DEFAULT for name in VARIANTS[each].distributions)
    return dict.fromkeys(shipped), dict.fromkeys((*MIDDLEWARE.values(), *MIDDLEWARE, *ROUTING))


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
    from keystore_audit.profiles import in_scope

    try:
        chosen = in_scope(distros, rmws, names, routed=bool(context.params.get("network")))
    except UsageError as error:
        raise click.UsageError(error.message, context) from error
    return chosen if distros or rmws else names


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
        f"Of that, what this middleware runs on (repeatable; {', '.join(dict.fromkeys(MIDDLEWARE.values()))}, or as "
        "RMW_IMPLEMENTATION says).",
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


def _be_verbose(ctx: click.Context, _param: click.Parameter, value: bool) -> bool:
    if value:
        ctx.ensure_object(dict)["verbose"] = True
    return value


def choice(*names: str, words: Sequence[str], **more: Any) -> Callable[[F], F]:
    """Return an option that takes one of `words`; a wrong one is answered with the nearest."""
    return click.option(*names, type=Word(tuple(words)), metavar=f"[{'|'.join(words)}]", show_default=True, **more)


def file(*names: str, metavar: str = "FILE", **more: Any) -> Callable[[F], F]:
    """Return an option that names a file or directory, whatever is there."""
    return click.option(*names, type=click.Path(path_type=Path), metavar=metavar, **more)


def alloy_jar(text: str) -> Callable[[F], F]:
    """Return the option `--alloy-jar`; the jar has to be there: a misspelt one would leave properties to one engine.

    That of the variable, which is for all commands, only where an engine asks for it.
    """

    def check(context: click.Context, parameter: click.Parameter, value: Path | None) -> Path | None:
        named = context.get_parameter_source(parameter.name or "") is ParameterSource.COMMANDLINE
        unused = context.params.get("engine") == "native" or context.params.get("compromised") is not None
        if value is None or (unused and not named):
            return value
        there: Path = click.Path(exists=True, dir_okay=False, path_type=Path).convert(value, parameter, context)
        return there

    return click.option(
        "--alloy-jar",
        type=click.Path(path_type=Path),
        callback=check,
        envvar="KEYSTORE_AUDIT_ALLOY_JAR",
        show_envvar=True,
        metavar="FILE",
        help=text,
    )


def verbose_option(text: str = "Say where a fault is.", *, to_command: bool = False) -> Callable[[F], F]:
    """Return the option `-v`, known to whoever reports a fault, and to the command itself if wanted."""
    return click.option(
        "-v", "--verbose", is_flag=True, is_eager=True, callback=_be_verbose, expose_value=to_command, help=text
    )


_at = click.option(
    "--at", type=instant, metavar="ISO-TIME", help="Audit as of this time instead of now; without a zone: UTC."
)

_time_zone = click.option(
    "--time-zone",
    type=zone_name,
    metavar="NAME",
    help="The robots' time zone, e.g. Europe/Berlin: some implementations read dates of grants in it.",
)


def format_option(text: str, *words: str) -> Callable[[F], F]:
    """How an answer is written: as the first of `words`, if nobody says otherwise."""
    return choice("-f", "--format", "form", words=words, default=words[0], help=text)


def domain_option(text: str) -> Callable[[F], F]:
    """Return the option `--domain`."""
    return click.option("--domain", type=Number(0, LAST_DOMAIN), metavar="N", help=text)


_no_assume = click.option(
    "--no-assume",
    "not_assumed",
    type=Word(tuple(each.value for each in Assumption)),
    callback=lambda _context, _parameter, names: tuple(map(Assumption, names)),
    metavar="NAME",
    multiple=True,
    help="Decide without this assumption (repeatable; docs/assumptions.md has their names).",
)

reading_options: Final = together(scope_options, _at, _time_zone, _no_assume)
"""Those of a single question, which is about one domain: `reading` takes them."""

no_assume_option: Final = _no_assume
"""That of an audit, which takes more."""

network_option: Final = file(
    facts.NETWORK_OPTION,
    "network",
    metavar="DIR",
    is_eager=True,  # before the scope, which may be of that middleware alone
    help=f"What {facts.UNENFORCING} enforces: the folder of session and router files that name the keystore's keys.",
)

roots_option: Final = file(
    "--root", "roots", metavar="DIR", multiple=True, help="Links of the keystore may lead into DIR (repeatable)."
)

file_options: Final = together(
    file("--settings", help="What is declared of the keystore's files and of enclaves with two names."), roots_option
)
"""What is declared of a keystore that is asked about, not audited: `reading` takes them."""

interpretation_options: Final = together(
    _at,
    _time_zone,
    scope_options,
    domain_option("The DDS domain the robots use (default: any of 0 to 232)."),
)
"""Those that decide what a keystore means."""

alloy_options: Final = together(
    click.option("--offline", is_flag=True, help="Never fetch the Alloy Analyzer."),
    alloy_jar("Use this jar of the Alloy Analyzer."),
    click.option("--timeout", type=seconds, default=120, metavar="SECONDS", help="The longest that Alloy may take."),
)
"""Those that say where the Alloy Analyzer is, and how long it may take."""


def engines(given: Mapping[str, Any]) -> Engines:
    """Return who decides."""
    from keystore_audit.engine.engines import Engines

    return Engines(choice=given["engine"], jar=given["alloy_jar"], offline=given["offline"], timeout=given["timeout"])


def named_settings(given: Mapping[str, Any], *keystores: str) -> Settings | None:
    """Return the settings that `--settings` names; raise UsageError for some that are none or lie in a keystore."""
    if given["settings"] is None:
        return None
    from keystore_audit.settings.settings import read_settings

    return read_settings(given["settings"], keystores)


def reading(given: Mapping[str, Any], settings: Settings | None, *, uniform: str = "") -> Circumstances:
    """Return what the options mean that decide how keystores are read.

    `uniform`: the command, if it knows no fleets of several implementations; raise UsageError for one then.
    """
    from keystore_audit.circumstances import Circumstances
    from keystore_audit.profiles import fleets, resolve

    runs = settings.runs if settings is not None else {}
    if uniform and runs:
        raise UsageError(f"{uniform} knows no mixed fleets yet: name settings without [enclaves].")
    return Circumstances(
        profiles=fleets(resolve(given["profiles"] or (settings.scope if settings else ())), runs),
        at=given["at"] or now(),
        zone=given["time_zone"],
        domain=given.get("domain"),
        declared=declared_files(settings, given["roots"]),
        assumed=EVERY.difference(given.get("not_assumed", ())),
    )


def refuse(names: Collection[str], question: str) -> None:
    """Raise UsageError for an option, by the name of its value, that is on the command line."""
    context = click.get_current_context()
    for each in context.command.params:
        name = each.name or ""
        if name in names and context.get_parameter_source(name) is ParameterSource.COMMANDLINE:  # no variable
            raise click.UsageError(f"{each.opts[0]} says nothing about {question}.")


def in_network(
    given: Mapping[str, Any], settings: Settings | None, *refused: str, uniform: str = ""
) -> tuple[Any, Circumstances, tuple[Release, ...]]:
    """The folder of sessions and routers (or those of two sides), what else is given, and the releases asked about.

    Raises UsageError for `refused` options and others that say nothing about such files, and as `reading`.
    """
    refuse((*refused, "not_assumed", "time_zone"), "files of sessions and routers")
    return given["network"], reading(given, settings, uniform=uniform), releases(given["profiles"])


def check_launch_arguments(arguments: Collection[object], launches: Collection[Path]) -> None:
    """Raise UsageError for arguments of launch files where there are no such files: they would be without effect."""
    if arguments and not launches:
        raise click.UsageError("--launch-argument is for the files that --launch names.")


observation_options: Final = together(
    file("--graph", "graphs", multiple=True, help="A ROS graph in JSON: the nodes that use the keystore (repeatable)."),
    file(
        "--launch",
        "launches",
        multiple=True,
        help="A launch file, read and never run: the nodes that will use the keystore (repeatable).",
    ),
    click.option(
        "--launch-argument",
        "launch_arguments",
        type=launch_argument,
        multiple=True,
        metavar="NAME:=VALUE",
        help="Give an argument of the launch files its value (repeatable).",
    ),
)
"""Those that name graphs and launch files."""


authority_options: Final = together(
    *(
        click.option(
            f"--expect-{role}-ca",
            f"{role}_cas",
            multiple=True,
            metavar="FINGERPRINT|FILE",
            help=f"The {role} CA that you trust: sha256:... of certificate or key, or the certificate (repeatable).",
        )
        for role in ("identity", "permissions")
    )
)
"""Those that declare whom the user trusts."""

passing_options: Final = together(
    click.option(
        "--through",
        multiple=True,
        metavar="ENCLAVE",
        help="A flow through this enclave does not count (glob; repeatable).",
    ),
    click.option("--include-ambient", is_flag=True, help="Over /rosout, /parameter_events, /clock and discovery too."),
)
"""Those that say which flows count."""

certifying_options: Final = together(
    choice("--attacker", words=ATTACKERS, default=ATTACKERS[-1], help="Who attacks, at most."),
    passing_options,
    scope_options,
    _at,
    _no_assume,
    authority_options,
)
"""Those of a certificate: the question is the same for whoever writes one and whoever checks it."""


def use_color(choice: str, *, terminal: bool) -> bool:
    """Whether to colour: what `--color` says, else NO_COLOR, else FORCE_COLOR, else only a terminal that can."""
    if choice != "auto":
        return choice == "always"
    if os.environ.get("NO_COLOR"):
        return False
    return bool(os.environ.get("FORCE_COLOR")) or (terminal and os.environ.get("TERM") != "dumb")
