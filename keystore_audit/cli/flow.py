"""`keystore-audit flow KEYSTORE FROM TO`, and `flow KEYSTORE --from-compromised WHO`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import click

from keystore_audit.cli import options as opt
from keystore_audit.cli import output, types
from keystore_audit.cli.program import Command
from keystore_audit.errors import EXIT_INCOMPLETE
from keystore_audit.text import counted, instant

if TYPE_CHECKING:
    from keystore_audit.flow import FlowAnswer
    from keystore_audit.properties.result import Status

ENGINES: Final = ("native", "auto", "both", "alloy")


@click.command("flow", cls=Command, short_help="Say whether data can get from one place to another.")
@click.argument("keystore", metavar="KEYSTORE", type=types.keystore_path)
@click.argument("source", metavar="[FROM", required=False)
@click.argument("target", metavar="TO]", required=False)
@click.option(
    "--from-compromised",
    "compromised",
    metavar="[ENCLAVE|identity-ca|permissions-ca]",
    help="Say instead what whoever holds this private key can do and reach.",
)
@opt.choice(
    "--attacker",
    words=opt.ATTACKERS,
    help="Who attacks: nobody, the source, or all on the way (default: each in turn; from outsider not nobody).",
)
@click.option(
    "--compromised",
    "fallen",
    metavar="N",
    type=click.IntRange(0, 3),
    help="Say instead which enclaves let it through, if N at most attack and all others are honest. Unmanaged "
    "identities and what could not be read count.",
)
@opt.passing_options
@opt.reading_options
@opt.network_option
@opt.file_options
@opt.choice("--engine", words=ENGINES, default="native", help="Who decides.")
@opt.alloy_options
@opt.format_option("How the answer is written.", "text", "json")
@opt.verbose_option()
def command(keystore: str, source: str | None, target: str | None, **given: Any) -> int:
    """Say whether anything can get from FROM to TO, whatever the nodes do, and how; or what a stolen key opens.

    \b
    FROM and TO:
      /arm/*            enclaves, by a glob (* also matches /)
      topic:/cmd_vel    ROS topics, by a glob
      dds:rt/cmd_vel    DDS topics, by a glob
      outsider          somebody without any key
    \b
    Exit codes:
      0   no flow, under every profile and attacker asked about, whoever is
          compromised; no use of a key
      1   there is a flow under some of them; the key opens something
      2   wrong usage, or a place that names nothing in the keystore
      4   something is unknown
    """  # noqa: D301 - click's mark for lines that stay as they are
    if given["compromised"] is not None:
        if source is not None:
            raise click.UsageError("--from-compromised asks about one key: give no FROM and TO.")
        return _stolen_key(keystore, given)
    if source is None or target is None:
        raise click.UsageError("Expected FROM and TO, or --from-compromised.")
    if given["fallen"] is not None and given["attacker"]:
        raise click.UsageError("--compromised says who attacks: give no --attacker.")
    from keystore_audit.flow import FlowQuestion, find_flow, find_routed_flow
    from keystore_audit.model.formal.asked import Attacker, ClaimKind

    settings = opt.named_settings(given, keystore)
    question = FlowQuestion(
        source=source,
        target=target,
        attackers=(Attacker(given["attacker"]),) if given["attacker"] else None,
        through=given["through"],
        include_ambient=given["include_ambient"],
        compromised=given["fallen"],
        able=tuple(each for each in settings.claims if each.kind is ClaimKind.ABLE) if settings else (),
    )
    engines = opt.engines(given)
    if given["network"] is None:
        answer = find_flow(keystore, question, opt.reading(given, settings), engines=engines)
    else:
        answer = find_routed_flow(keystore, question, engines, *opt.in_network(given, settings, "fallen"))
    output.write_stdout(rendered(answer, given["form"]))
    return exit_code(answer.status)


def _stolen_key(keystore: str, given: Mapping[str, Any]) -> int:
    """What a stolen key opens."""
    opt.refuse(("attacker", "fallen", "through", "alloy_jar"), "--from-compromised")
    if given["engine"] not in ("native", "auto"):
        raise click.UsageError("--from-compromised is worked out natively: no other engine decides it.")
    from keystore_audit.flow import find_blast_radius, find_routed_radius
    from keystore_audit.report import flow, routed_stolen

    settings = opt.named_settings(given, keystore)
    who, ambient, as_json = given["compromised"], given["include_ambient"], given["form"] == "json"
    if given["network"] is None:
        answer = find_blast_radius(keystore, who, opt.reading(given, settings), include_ambient=ambient)
        output.write_stdout((flow.stolen_json if as_json else flow.stolen_text)(answer))
        return exit_code(answer.status)
    opened = find_routed_radius(keystore, who, *opt.in_network(given, settings), include_ambient=ambient)
    output.write_stdout((routed_stolen.json if as_json else routed_stolen.text)(opened))
    return EXIT_INCOMPLETE if opened.beyond_itself is None else int(opened.beyond_itself)


def exit_code(status: Status) -> int:
    """0 where it holds, 1 where it is violated, 4 where nobody knows."""
    return {"holds": 0, "violated": 1}.get(status.value, EXIT_INCOMPLETE)


def rendered(answer: FlowAnswer, kind: str) -> str:
    """The answer as `text` or `json`."""
    from keystore_audit.report import flow
    from keystore_audit.report.routed_answer import unknown

    question, most = answer.question, answer.question.compromised
    if kind == "json":
        asked = {
            "from": question.source,
            "to": question.target,
            "through": list(question.through),
            "include_ambient": question.include_ambient,
            "at": instant(answer.at),
            "flow": flow.FOUND[answer.status],
            **({"declared": answer.declared} if answer.declared else {}),
            **({"folder": answer.folder, "unknown": unknown(answer.unclear)} if answer.folder else {}),
        }
        if most is not None:
            return flow.falls_json(asked, most, answer.profiles, answer.falls, answer.engines, answer.change)
        return flow.json(asked, answer.results, answer.engines)
    besides = f", except through {', '.join(question.through)}" if question.through else ""
    fleet = f" ({answer.declared})" if answer.declared else ""
    title = f"Can anything get from {question.source} to {question.target}{besides}{fleet}"
    if most is None:
        told = flow.by_attacker(f"{title}?", answer.results)
    else:
        with_ = f", with up to {counted(most, 'compromised enclave')}?"
        told = flow.by_fall(f"{title}{with_}", most, answer.profiles, answer.falls, answer.change)
    at, ambient = instant(answer.at), question.include_ambient
    return flow.text(told, answer.engines, answer.doubts, at=at, ambient=ambient, folder=answer.folder)
