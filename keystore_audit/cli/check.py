"""`keystore-audit check FILE KEYSTORE PROPERTY`: whether a certificate proves it, by code that decides nothing else."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from keystore_audit.cli import options as opt
from keystore_audit.cli import output, types
from keystore_audit.cli.program import Command
from keystore_audit.errors import EXIT_INCOMPLETE
from keystore_audit.given import GivenFile, read_given
from keystore_audit.options import now
from keystore_audit.text import terminal

if TYPE_CHECKING:
    from datetime import datetime

    from keystore_audit.assumptions import Assumption
    from keystore_audit.certificate.checking import Given, Property
    from keystore_audit.model.trust.chain import Authorities

FORMS: Final = "no-flow FROM TO, only-publish TOPIC ENCLAVE..., or encrypted TOPIC outsider|insider"

MAX_BYTES: Final = 64_000_000
"""Of a certificate."""

_OF_FLOWS: Final = ("attacker", "through", "include_ambient")


def question(words: Sequence[str], keystore: str, given: Mapping[str, Any]) -> tuple[Property, Given]:
    """What is asked, and in which circumstances. Raises click.UsageError, and errors.UsageError for no place."""
    from keystore_audit.model.trust.chain import Authorities
    from keystore_audit.profiles import resolve
    from keystore_audit.settings.settings import expected

    asked = stated(words, given)
    trusted = expected(Authorities(), given["identity_cas"], given["permissions_cas"], (keystore,))
    names = tuple(profile.name for profile in resolve(given["profiles"]))
    return asked, told(names, given["at"] or now(), given["not_assumed"], trusted)


def told(profiles: tuple[str, ...], at: datetime, not_assumed: Iterable[Assumption], trusted: Authorities) -> Given:
    """What the checker is to be told of these circumstances."""
    from keystore_audit.certificate.checking import Given

    left_out = tuple(each.value for each in not_assumed)
    return Given(profiles, at, left_out, trusted.identity, trusted.permissions)


def stated(words: Sequence[str], given: Mapping[str, Any]) -> Property:
    """The property in these words; of flows, `given` may say more. Raises as `question`."""
    from keystore_audit.certificate.checking import Encrypted, NoFlow, OnlyPublish
    from keystore_audit.settings.claims import place

    match words:
        case "no-flow", source, target if all(map(place, (source, target))):
            return NoFlow(source, target, **{name: given[name] for name in _OF_FLOWS if name in given})
        case "only-publish", topic, *enclaves if enclaves and all(place(each).enclaves for each in enclaves):
            asked: Property = OnlyPublish(topic, tuple(enclaves))
        case "encrypted", topic, ("outsider" | "insider") as against:
            asked = Encrypted(topic, against)
        case _:
            raise click.UsageError(f"Expected the property as {FORMS}.")
    opt.refuse(_OF_FLOWS, words[0])
    place(f"topic:{topic}")
    return asked


def accepted(file: Path, keystore: str, asked: Property, told: Given) -> tuple[GivenFile, Mapping[str, str]]:
    """The certificate, and the digests of the keystore's files, by place; raises certificate.errors.NotAccepted."""
    from keystore_audit.certificate.checking import Checker

    found, text = read_given(file, MAX_BYTES, "a certificate")
    checker = Checker(Path(keystore), asked, told)
    checker.check(text.encode())
    return found, checker.store.digests


@click.command("check", cls=Command, short_help="Check a certificate of a property, sharing no code with the audit.")
@click.argument("file", metavar="FILE", type=click.Path(path_type=Path))
@click.argument("keystore", metavar="KEYSTORE", type=types.keystore_path)
@click.argument("words", metavar="PROPERTY", nargs=-1, required=True)
@opt.certifying_options
@opt.verbose_option()
def command(file: Path, keystore: str, words: tuple[str, ...], **given: Any) -> int:
    """Check that FILE proves PROPERTY of KEYSTORE. FILE says who may be inside, and why each hop out is refused.

    \b
    PROPERTY:
      no-flow FROM TO                   nothing gets from FROM to TO (places
                                        as for flow)
      only-publish TOPIC ENCLAVE...     nobody but these enclaves (globs) may
                                        publish TOPIC (/cmd_vel or
                                        dds:rt/cmd_vel, globs)
      encrypted TOPIC outsider|insider  nobody reads TOPIC without a key, or
                                        nobody whom no grant lets read it
    \b
    Exit codes:
      0   accepted
      1   refused: a reason is missing or not true
      2   wrong usage
      4   cannot tell: the keystore or the question is beyond the checker
    """  # noqa: D301 - click's mark for lines that stay as they are
    from keystore_audit.certificate.errors import CannotTell, NotAccepted

    try:
        accepted(file, keystore, *question(words, keystore, given))
    except NotAccepted as why:
        cannot = isinstance(why, CannotTell)
        output.write_stdout(f"{'cannot tell' if cannot else 'refused'}: {terminal(str(why))}\n")
        return EXIT_INCOMPLETE if cannot else 1
    output.write_stdout("accepted\n")
    return 0
