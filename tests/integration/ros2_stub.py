"""Stands for `ros2 security`: finds verbs by their entry points and calls them as ros2cli and sros2 do.

Neither is on PyPI. What is kept of them, in words of our own: `importlib.metadata` finds the group `sros2.verb`, each
verb has a sub-parser of its name, a first pass parses what is known before the chosen verb adds its arguments, and the
exit code is what its `main` returns (ros2cli/command/__init__.py and cli.py; sros2/command/security.py).
"""

from __future__ import annotations

import argparse
import sys
from importlib.metadata import entry_points
from typing import Any


def main(argv: list[str]) -> Any:
    parser = argparse.ArgumentParser("ros2")
    commands = parser.add_subparsers(dest=" command")
    security = commands.add_parser("security")
    verbs = security.add_subparsers(dest=" verb")
    points = {point.name: point for point in entry_points(group="sros2.verb")}
    parsers = {name: verbs.add_parser(name, add_help=False) for name in sorted(points)}
    known, _rest = parser.parse_known_args([argument for argument in argv if argument not in ("-h", "--help")])
    name = getattr(known, " verb")
    if name is None:
        parser.print_help()
        return 0
    verb = points[name].load()()
    verb.NAME = name
    verbs.choices[name].add_argument("-h", "--help", action="help")
    parsers[name].description = (verb.__doc__ or "").splitlines()[0]
    verb.add_arguments(parsers[name], f"ros2 security {name}")
    return verb.main(args=parser.parse_args(argv))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
