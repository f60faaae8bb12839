"""`ros2 security audit`: the command `keystore-audit audit` as a verb of sros2.

ros2cli finds it by the entry point `audit` of the group `sros2.verb`, makes one, lets it add its arguments and calls
`main` (ros2cli, ros2cli/command/__init__.py; sros2, sros2/verb/__init__.py). It asks for these methods and for no base
class, so that this module needs nothing of ROS.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import click

KEYSTORES = "keystores"


class AuditVerb:
    """Audit keystores: what the signed artifacts on disk really allow."""

    NAME: str | None = "audit"
    EXTENSION_POINT_VERSION = "0.1"

    def add_arguments(self, parser: argparse.ArgumentParser, cli_name: str) -> None:  # noqa: ARG002 - ros2cli's
        """Add every option of `keystore-audit audit`, so that `--help` and completion know them."""
        parser.add_argument(KEYSTORES, metavar="KEYSTORE", nargs="+", help="the directory of a keystore")
        for option in _options():
            more: dict[str, Any] = {"action": "store_true"}
            if not option.is_flag:  # a second value is passed on too: the command itself refuses it where one counts
                more = {"action": "append", "metavar": _metavar(option)}
            text = (option.help or "").replace("%", "%%")
            parser.add_argument(*option.opts, dest=option.name or "", help=text, **more)

    def main(self, *, args: argparse.Namespace) -> int:
        """Audit, and return the exit code of `keystore-audit`."""
        from keystore_audit.cli.program import run

        return run(["audit", *_given(args), "--", *getattr(args, KEYSTORES)])


def _options() -> Iterator[click.Option]:
    import click

    from keystore_audit.cli.audit import command

    for parameter in command.params:
        if isinstance(parameter, click.Option):
            yield parameter


def _metavar(option: click.Option) -> str:
    """What stands for the value; without brackets, which argparse takes for its own."""
    return (option.metavar or option.human_readable_name.upper()).strip("[]").replace("|", ",")


def _given(args: argparse.Namespace) -> Iterator[str]:
    """The options as they were given; what was not is left to its default."""
    for option in _options():
        value = getattr(args, option.name or "")
        if value is True:
            yield option.opts[-1]
        else:
            yield from (f"{option.opts[-1]}={each}" for each in value or ())
