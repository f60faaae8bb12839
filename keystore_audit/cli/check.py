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

FORM: Final = "no-flow FROM TO"


def question(words: Sequence[str], keystore: str, given: Mapping[str, Any]) -> tuple[Property, Given]:
    """What is asked, and in which circumstances. Raises click.UsageError."""
    from keystore_audit.certificate.checking import Given, Property
    from keystore_audit.model.trust.chain import Authorities
    from keystore_audit.profiles import resolve
    from keystore_audit.settings.settings import expected

    if len(words) != len(FORM.split()) or words[0] != FORM.split()[0]:
        raise click.UsageError(f"Expected the property as {FORM}.")
    asked = Property(words[1], words[2], given["attacker"], given["through"], given["include_ambient"])
    trusted = expected(Authorities(), given["identity_cas"], given["permissions_cas"], (keystore,))
    names = tuple(profile.name for profile in resolve(given["profiles"]))
    left_out = tuple(each.value for each in given["not_assumed"])
    return asked, Given(names, given["at"] or now(), left_out, trusted.identity, trusted.permissions)


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
      no-flow FROM TO   nothing gets from FROM to TO (places as for flow)
    \b
    Exit codes:
      0   accepted
      1   refused: a hop without a reason, or with one that is not true
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
