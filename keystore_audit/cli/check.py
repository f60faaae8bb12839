"""`keystore-audit check FILE KEYSTORE PROPERTY`: whether a certificate proves it, by code that decides nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from keystore_audit.cli import options as opt
from keystore_audit.cli import output, types
from keystore_audit.cli.program import Command
from keystore_audit.errors import EXIT_INCOMPLETE
from keystore_audit.options import now
from keystore_audit.text import terminal

if TYPE_CHECKING:
    from keystore_audit.certificate.checking import Given, Property

FORMS: Final = "no-flow FROM TO, only-publish TOPIC ENCLAVE..., or encrypted TOPIC outsider|insider"


def question(words: Sequence[str], keystore: str, given: Mapping[str, Any]) -> tuple[Property, Given]:
    """What is asked, and in which circumstances. Raises click.UsageError, and errors.UsageError for no place."""
    from keystore_audit.certificate.checking import Given
    from keystore_audit.model.trust.chain import Authorities
    from keystore_audit.profiles import resolve
    from keystore_audit.settings.settings import expected

    asked = _property(words, given)
    trusted = expected(Authorities(), given["identity_cas"], given["permissions_cas"], (keystore,))
    names = tuple(profile.name for profile in resolve(given["profiles"]))
    left_out = tuple(each.value for each in given["not_assumed"])
    return asked, Given(names, given["at"] or now(), left_out, trusted.identity, trusted.permissions)


def _property(words: Sequence[str], given: Mapping[str, Any]) -> Property:
    from keystore_audit.certificate.checking import Encrypted, NoFlow, OnlyPublish
    from keystore_audit.settings.claims import place

    match words:
        case "no-flow", source, target:
            for each in (source, target):
                place(each)
            return NoFlow(source, target, given["attacker"], given["through"], given["include_ambient"])
        case "only-publish", topic, *enclaves if enclaves and all(place(each).enclaves for each in enclaves):
            asked: Property = OnlyPublish(topic, tuple(enclaves))
        case "encrypted", topic, ("outsider" | "insider") as against:
            asked = Encrypted(topic, against)
        case _:
            raise click.UsageError(f"Expected the property as {FORMS}.")
    opt.refuse(("attacker", "through", "include_ambient"), words[0])
    place(f"topic:{topic}")
    return asked


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
    from keystore_audit.certificate.checking import Checker
    from keystore_audit.certificate.errors import CannotTell, NotAccepted

    asked, circumstances = question(words, keystore, given)
    try:
        content = file.read_bytes()
    except OSError as error:
        raise click.UsageError(f"The certificate cannot be read: {error.strerror or error}.") from error
    try:
        Checker(Path(keystore), asked, circumstances).check(content)
    except NotAccepted as why:
        cannot = isinstance(why, CannotTell)
        output.write_stdout(f"{'cannot tell' if cannot else 'refused'}: {terminal(str(why))}\n")
        return EXIT_INCOMPLETE if cannot else 1
    output.write_stdout("accepted\n")
    return 0
