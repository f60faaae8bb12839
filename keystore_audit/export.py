"""`keystore-audit model`: the Alloy model of a keystore, for the Analyzer's window."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from keystore_audit.circumstances import Circumstances
from keystore_audit.engine.alloy.export import write_folders, write_model
from keystore_audit.engine.alloy.user_file import UserFile, identifier
from keystore_audit.errors import BudgetExceeded, UsageError
from keystore_audit.intent.intent import Intent
from keystore_audit.model.claims.named import NamedPlace
from keystore_audit.model.intended.observed_rights import wiring
from keystore_audit.model.interpret import interpret
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.profiles import Release


def export_model(
    path: str | os.PathLike[str],
    directory: Path,
    given: Circumstances,
    *,
    intents: Sequence[Intent] = (),
    files: Sequence[UserFile] = (),
) -> None:
    """Writes the Alloy model of the keystore into `directory`, ready for the Alloy Analyzer.

    `intents`: which nodes will use it. `files`: properties of users, to stand beside it. Raises errors.NothingToAudit,
    errors.UsageError (names that two files give) or errors.BudgetExceeded.
    """
    places = [place for file in files for place in file.places]
    beside = _beside(files, places)
    keystore = given.keystore(path)
    nodes = wiring(intents, keystore.layout.kind)
    accesses = given.accesses(keystore)
    usabilities = Usabilities(given.domain, accesses)
    meaning = interpret(keystore, given.profiles, given.at, accesses, usabilities, places=places, nodes=nodes)
    if meaning.over_budget is not None:
        raise BudgetExceeded(meaning.over_budget)
    write_model(meaning.systems, directory, beside)


def export_network(
    path: str | os.PathLike[str], directory: Path, folder: Path, given: Circumstances, releases: Sequence[Release]
) -> bool:
    """Writes that of the files of sessions and routers in `folder`, for each release; whether all could be read.

    Raises as `export_model`.
    """
    from keystore_audit.engine.alloy.routed import network_model
    from keystore_audit.zenoh.participants import flows_in

    flows = flows_in(given.keystore(path), folder, given.at)
    write_folders({each.name: network_model(flows, each) for each in releases}, directory)
    return not flows.rights.doubts


def _beside(files: Sequence[UserFile], places: Sequence[NamedPlace]) -> dict[str, str]:
    """The users' files by their names beside the modules; raises errors.UsageError for names in conflict."""
    known: dict[str, NamedPlace] = {}
    for place in places:
        if place.name in known:
            raise UsageError(f"{place.place}: {place.name!r} has a meaning at {known[place.name].place} already.")
        known[place.name] = place
    beside: dict[str, str] = {}
    for file in files:
        name = f"{identifier(Path(file.path).stem).replace('-', '_') or 'properties'}_asked.als"
        if name in beside:
            raise UsageError(f"{file.path}: a second file would be called {name!r} in the model.")
        beside[name] = file.text
    return beside
