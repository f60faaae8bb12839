"""`keystore-audit prove KEYSTORE PROPERTY -o FILE`: a certificate that `check` accepts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from keystore_audit.cli import options as opt
from keystore_audit.cli import output, types
from keystore_audit.cli.check import question
from keystore_audit.cli.flow import exit_code
from keystore_audit.cli.program import Command
from keystore_audit.errors import AuditError
from keystore_audit.text import terminal


@click.command("prove", cls=Command, short_help="Write a certificate of a property that holds.")
@click.argument("keystore", metavar="KEYSTORE", type=types.keystore_path)
@click.argument("words", metavar="PROPERTY", nargs=-1, required=True)
@opt.file("-o", "--output", "file", required=True, help="Where the certificate goes.")
@opt.certifying_options
@opt.verbose_option()
def command(keystore: str, words: tuple[str, ...], file: Path, **given: Any) -> int:
    """Write a certificate of PROPERTY, which others check with `check` and the same options.

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
      0   written, and accepted by the checker
      1   it is violated; nothing is written
      2   wrong usage, or a place that names nothing in the keystore
      4   unknown, or the checker cannot follow; nothing is written
    """  # noqa: D301 - click's mark for lines that stay as they are
    from keystore_audit.certificate.errors import NotAccepted
    from keystore_audit.prove import prove

    target = output.Target(format="json", path=file)
    output.check((target,), (keystore,))
    asked, told = question(words, keystore, given)
    circumstances = opt.reading({**given, "at": told.at, "time_zone": None, "roots": ()}, None)
    try:
        result, certificate = prove(Path(keystore), asked, circumstances, told)
    except NotAccepted as why:
        raise AuditError(f"The checker cannot follow: {why}.") from why
    if certificate is None:
        from keystore_audit.report.flow import answers

        said = [terminal(result.prop.statement), *answers(result, result.profiles, {}, set())]
        output.write_stdout("\n".join(said) + "\n")
        return exit_code(result.status)
    output.write(target, certificate.decode())
    output.write_stdout(f"proved: {terminal(str(file))}\n")
    return 0
