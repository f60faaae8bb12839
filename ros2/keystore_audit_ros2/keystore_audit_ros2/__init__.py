"""`ros2 security audit` and `ros2 security record`: the programs of keystore-audit as verbs of sros2.

ros2cli finds a verb by its entry point in the group `sros2.verb`, makes one, lets it add its arguments and calls
`main` (ros2cli, ros2cli/command/__init__.py; sros2, sros2/verb/__init__.py). It asks for these methods and for no base
class. Nothing but the standard library is imported: sros2 and keystore-audit need different versions of cryptography.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys

FOLDER = "KEYSTORE_AUDIT_BIN"
"""The variable that names the folder of the programs; without it they are looked for on PATH."""


class _Program:
    """A verb that is a program with its first words."""

    NAME: str | None = None  # ros2cli sets it
    EXTENSION_POINT_VERSION = "0.1"
    command: tuple[str, ...]

    def add_arguments(self, parser: argparse.ArgumentParser, cli_name: str) -> None:  # noqa: ARG002 - ros2cli's
        """Leave every word to the program, `--help` too."""
        parser.prefix_chars = "\0"
        parser.add_argument("words", nargs=argparse.REMAINDER)

    def main(self, *, args: argparse.Namespace) -> int:
        """Become the program. Returns 2 where it is not there."""
        program = shutil.which(self.command[0], path=os.environ.get(FOLDER))
        if program is None:
            where = f"in the folder that {FOLDER} names" if FOLDER in os.environ else f"on PATH ({FOLDER} is not set)"
            say = f"{self.command[0]} is not {where}: install it apart from ROS, `pipx install keystore-audit`"
            print(say, file=sys.stderr)  # noqa: T201
            return 2
        return os.execv(program, [*self.command, *args.words])  # noqa: S606 - no process of ROS around it


class AuditVerb(_Program):
    """Audit keystores: what the signed artifacts on disk really allow."""

    command = ("keystore-audit", "audit")

    def main(self, *, args: argparse.Namespace) -> int:
        """Audit without the modules of ROS's workspaces, which stand before those of any environment."""
        os.environ.pop("PYTHONPATH", None)
        return super().main(args=args)


class RecordVerb(_Program):
    """Record the running graph, as JSON for `ros2 security audit --graph`."""

    command = ("keystore-audit-record",)

    def main(self, *, args: argparse.Namespace) -> int:
        """Record with this very Python, which has rclpy: the program takes the first `python3` on PATH."""
        os.environ["PATH"] = os.pathsep.join((os.path.dirname(sys.executable), os.environ.get("PATH", os.defpath)))
        return super().main(args=args)
