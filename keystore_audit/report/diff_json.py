"""What changed between two keystores as JSON: `schemas/diff.schema.json`."""

from __future__ import annotations

from typing import Any, Final

from keystore_audit import __version__
from keystore_audit.findings import Location
from keystore_audit.model.comparison.change import Change, Comparison, Consequence, FailOn, Influenced, Name, Names
from keystore_audit.model.domains import describe
from keystore_audit.model.names import parse_dds_name, ros_name
from keystore_audit.report.diff_text import REMEDY, conditions
from keystore_audit.report.json import array, document, encoded, keys, picked
from keystore_audit.text import instant

SCHEMA_VERSION: Final = 1


def json(comparison: Comparison, fail_on: FailOn) -> str:
    """A line for each change; ends in a newline."""
    failing = set(map(id, comparison.failing(fail_on)))
    head = {
        "schema_version": SCHEMA_VERSION,
        "tool": {"name": "keystore-audit", "version": __version__},
        "old": {"path": comparison.old, "digest": comparison.old_digest},
        "new": {"path": comparison.new, "digest": comparison.new_digest},
        "at": instant(comparison.at),
        "domain": comparison.domain,
        "profiles": comparison.profiles,
        "fail_on": fail_on,
        "labels": comparison.labels,
        "complete": not comparison.unknown,
        "failing": len(failing),
        "common_enclaves": comparison.common,
        "assumptions": [each.described for each in conditions(comparison)],
    }
    unknown = [
        {**picked(each, "side", "enclave"), "location": _location(each.location), "reason": each.reason}
        for each in comparison.unknown
    ]
    changes = [_change(change, fails=id(change) in failing) for change in comparison.changes]
    lists = {"unknown": unknown, "changes": changes}
    return document([*keys(head), *(array(key, [*map(encoded, items)]) for key, items in lists.items())])


def _change(change: Change, *, fails: bool) -> dict[str, Any]:
    return {
        **picked(change, "layer", "kind", "direction"),
        "fails": fails,
        **picked(change, "what", "enclaves", "labels", "operation"),
        "aspects": [picked(each, "what", "old", "new", "direction") for each in change.aspects],
        "names": _names(change.names),
        "profiles": change.profiles,
        "profiles_differ": change.varies,
        "reasons": change.reasons,
        "influence": _influence(change.influenced),
        "old": _location(change.old),
        "new": _location(change.new),
        "consequences": [_consequence(each) for each in change.consequences],
        **picked(change, "until", "severity", "against"),
        "remedy": REMEDY if change.until else None,
    }


def _consequence(each: Consequence) -> dict[str, Any]:
    return {
        **picked(each, "what", "direction", "enclaves"),
        "names": _names(each.names),
        **picked(each, "profiles", "reasons"),
        "influence": _influence(each.influenced),
        "enclaves_differ": each.parts,
    }


def _names(names: Names | None) -> dict[str, Any] | None:
    if names is None:
        return None
    return {
        "witnesses": [_witness(name) for name in names.shown],
        **picked(names, "more", "infinite"),
        "domains": describe(names.domains),
        "every": names.every,
    }


def _witness(name: Name) -> dict[str, Any]:
    return {
        "topic": name.topic,
        "ros": ros_name(name.topic) if parse_dds_name(name.topic) is not None else None,
        "partition": name.partition,
        "domains": describe(name.domains),
        "one": not name.several,
    }


def _influence(influenced: Influenced | None) -> dict[str, Any] | None:
    if influenced is None:
        return None
    way = [{"from": hop.sender, "on": _witness(hop.name), "to": hop.receiver} for hop in influenced.way]
    return {"pairs": influenced.pairs, "way": way}


def _location(location: Location | None) -> dict[str, Any] | None:
    return None if location is None else picked(location, "path", "line")
