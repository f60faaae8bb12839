"""`keystore-audit suggest KEYSTORE`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click
from msgspec.structs import replace

from keystore_audit.cli import options as opt
from keystore_audit.cli import output, types
from keystore_audit.cli.program import Command
from keystore_audit.errors import EXIT_INCOMPLETE, UsageError
from keystore_audit.profiles import facts

if TYPE_CHECKING:
    from keystore_audit.model.intended.observed_needs import EnclavePolicy
    from keystore_audit.suggest import SuggestedNetwork, Suggester, Suggestion

POLICY: Final = "policy"
PERMISSIONS: Final = "permissions"
NETWORK: Final = facts.NETWORK_FORM
FILE_NAME: Final = "permissions.xml"
CONFIGURATION: Final = "process.json5"


@click.command("suggest", cls=Command, short_help="Print the least policy for what was observed or launched.")
@click.argument("keystore", metavar="KEYSTORE", type=types.keystore_path)
@opt.observation_options
@opt.file("--policy", help="An SROS2 policy: what its author means the nodes to do.")
@opt.file(
    "--policy-include",
    "include",
    metavar="DIR",
    help="Where the policy may include files from, and from below (default: its own directory).",
)
@opt.choice(
    "--as",
    "form",
    words=(POLICY, PERMISSIONS, NETWORK),
    default=POLICY,
    help=facts.SUGGESTED_FORMS,
)
@click.option("--router", metavar="PATH", help="The enclave whose certificate the router has (without: peers).")
@click.option(
    "--listen",
    "addresses",
    type=types.listening,
    multiple=True,
    metavar="PATH=HOST:PORT",
    help="Where the router listens, or a peer (repeatable): of any two with rights to share, one has to.",
)
@click.option("--enclave", metavar="PATH", help="Only this enclave.")
@click.option("--no-usual", is_flag=True, help="Leave out what every node has: log, parameters, type description.")
@opt.file(
    "-o",
    "--output",
    "place",
    metavar="FILE|DIR",
    help="Write it there: a file; a directory for permissions of several enclaves, and a new one for a network.",
)
@opt.interpretation_options
@opt.file_options
@opt.verbose_option()
def command(keystore: str, **given: Any) -> int:
    """Print the least SROS2 policy for what graphs, launch files or a policy say of the nodes of KEYSTORE.

    As the files of a network, without any of these: for what its permissions grant.

    \b
    Exit codes:
      0   printed
      2   wrong usage, or a file that cannot be read or written
      3   nothing to look at there
      4   printed, and something may be missing: stderr says what
    """  # noqa: D301 - click's mark for lines that stay as they are
    networked = given["form"] == NETWORK
    observed = bool(given["graphs"] or given["launches"] or given["policy"])
    if not (observed or networked):
        raise click.UsageError("Name what the nodes do: --graph, --launch or --policy.")
    if given["include"] is not None and given["policy"] is None:
        raise click.UsageError("--policy-include says where a policy includes from: name one with --policy.")
    router, addresses = given["router"], dict(given["addresses"])
    if networked != bool(router or addresses) or (networked and given["place"] is None):
        raise click.UsageError(f"--router PATH or --listen PATH=HOST:PORT, -o DIR and --as {NETWORK} belong together.")
    if router is not None and {*addresses} - {router}:
        raise click.UsageError("The clients of a router listen nowhere.")
    if networked and given["enclave"] is not None:
        raise click.UsageError("A network is of all enclaves: leave out --enclave.")
    if networked and given["no_usual"] and not observed:
        raise click.UsageError("--no-usual needs --policy, --graph or --launch: permissions do not say what is usual.")
    opt.check_launch_arguments(given["launch_arguments"], given["launches"])
    from keystore_audit.intent import read_observed
    from keystore_audit.suggest import Suggester

    arguments = dict(given["launch_arguments"])
    intents = read_observed(given["graphs"], given["launches"], arguments, given["policy"], given["include"])
    read = opt.reading(given, opt.named_settings(given, keystore), uniform="suggest")
    if networked and read.domain is None:
        read = replace(read, domain=0)
    suggester = Suggester(keystore, intents, read)
    suggestion = suggester.suggestion(usual=not given["no_usual"])
    if networked:
        network = suggester.network(suggestion.policy if observed else None, router, addresses)
        return _write_network(keystore, network, suggestion if observed else None, given["place"])
    enclaves = _chosen(suggestion, given["enclave"])
    if given["form"] == POLICY:
        _write_policy(keystore, suggestion, enclaves, given["place"])
    else:
        _write_permissions(keystore, suggester, suggestion, enclaves, given["place"])
    for note in _notes(suggestion, enclaves):
        output.say(note)
    left_out = given["form"] == PERMISSIONS and any(enclave.path in suggestion.unknown for enclave in enclaves)
    return EXIT_INCOMPLETE if suggestion.doubts or left_out else 0


def _chosen(suggestion: Suggestion, path: str | None) -> tuple[EnclavePolicy, ...]:
    """The enclaves to write."""
    enclaves = suggestion.policy.enclaves
    known = [enclave.path for enclave in enclaves]
    if path is not None and path not in known:
        raise UsageError(types.unknown(f"No node is in the enclave {path!r}; there are nodes in", path, known))
    if not enclaves:
        raise UsageError("The files name no node, so that there is nothing to suggest.")
    return tuple(enclave for enclave in enclaves if path is None or enclave.path == path)


def _write_policy(
    keystore: str, suggestion: Suggestion, enclaves: tuple[EnclavePolicy, ...], place: Path | None
) -> None:
    from keystore_audit.report.suggested import policy_xml

    _write(keystore, POLICY, policy_xml(replace(suggestion.policy, enclaves=enclaves)), place)


def _write_permissions(
    keystore: str,
    suggester: Suggester,
    suggestion: Suggestion,
    enclaves: Sequence[EnclavePolicy],
    place: Path | None,
) -> None:
    """One document, or a tree of them as it stands below enclaves/."""
    from keystore_audit.report.suggested import permissions_xml

    if len(enclaves) == 1:
        _write(keystore, PERMISSIONS, permissions_xml(suggester.grant(enclaves[0])), place)
        return
    if place is None:
        raise click.UsageError(
            "Permissions are a document for each enclave: choose one with --enclave, or name -o DIR."
        )
    known = [enclave for enclave in enclaves if enclave.path not in suggestion.unknown]
    documents = {
        _folder_of(enclave.path, place) / FILE_NAME: permissions_xml(suggester.grant(enclave)) for enclave in known
    }
    _write_all(keystore, PERMISSIONS, documents, place)


def _write_network(keystore: str, network: SuggestedNetwork, suggestion: Suggestion | None, place: Path) -> int:
    """A file for each enclave. Return the exit code."""
    if place.exists():
        raise UsageError(f"{place} is there already: old files beside new ones would count too.")
    documents = {_folder_of(path, place) / CONFIGURATION: text for path, text in network.files.items()}
    _write_all(keystore, NETWORK, documents, place)
    notes = [*network.left_out]
    if suggestion is not None:
        policy = replace(suggestion.policy, wildcards=())
        notes += _notes(replace(suggestion, policy=policy), policy.enclaves)
    for note in notes:
        output.say(note)
    return EXIT_INCOMPLETE if notes else 0


def _write_all(keystore: str, form: str, documents: Mapping[Path, str], place: Path) -> None:
    """Below the directory `place`, which is made."""
    output.check_outside(place, (keystore,))
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"Cannot make the directory {place}: {error.strerror or error}.") from error
    targets = [output.Target(format=form, path=path, folder=place) for path in documents]
    output.check(targets, (keystore,))
    for target, document in zip(targets, documents.values(), strict=True):
        output.write(target, document)


def _folder_of(path: str, directory: Path) -> Path:
    """Below the directory, as below enclaves/ of a keystore; its tokens are letters, digits and underscores."""
    from keystore_audit.intent.intent import is_path

    if not is_path(path):
        raise UsageError(f"{path!r} is no enclave's name that a directory could have: choose it with --enclave.")
    return directory.joinpath(*path.strip("/").split("/"))


def _write(keystore: str, form: str, document: str, place: Path | None) -> None:
    if place is None:
        output.write_stdout(document)
        return
    target = output.Target(format=form, path=place)
    output.check((target,), (keystore,))
    output.write(target, document)


def _notes(suggestion: Suggestion, enclaves: Iterable[EnclavePolicy]) -> Iterator[str]:
    """What the document itself does not say."""
    yield from suggestion.doubts
    if suggestion.doubts:
        yield "Something may be missing: see above."
    shown = {enclave.path for enclave in enclaves}
    for path in suggestion.unknown:
        if path in shown:
            yield f"The keystore has no enclave {path}."
    for name in suggestion.policy.wildcards:
        yield f"{name} is an expression of the policy and is kept: what it allows is unbounded."
