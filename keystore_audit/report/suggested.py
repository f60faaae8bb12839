"""What `suggest` writes: a grant as a permissions document, and a policy as SROS2 reads it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain, groupby
from typing import TYPE_CHECKING, Any, Final

from keystore_audit.findings import Finding, Severity
from keystore_audit.intent.intent import Action
from keystore_audit.keystore.document import Text
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.permissions import Criterion, Grant, Rule
from keystore_audit.model.intended.observed_needs import LeastPolicy, NodePolicy, PolicyRight
from keystore_audit.profiles import Evidence, Profile
from keystore_audit.text import counted, html, shorten

if TYPE_CHECKING:
    from keystore_audit.properties.result import Counterexample


# What a report takes from the keystore while it is at hand: lines that findings show, and what was not looked at.


MAX_EXCERPT: Final = 200
"""Characters of a line."""


def excerpts(keystore: Keystore, findings: Sequence[Finding]) -> dict[tuple[str, int], str]:
    """The lines of signed documents that findings name first: nothing of a file in which a private key may be."""
    files = chain((keystore.layout.governance,), *(each.files.every for each in keystore.enclaves))
    documents = {each.place: each for each in files if each is not None and each.place.endswith(".p7s")}
    split: dict[str, list[bytes]] = {}
    found = {}
    for finding in findings:
        place = place_of(finding)
        if place is None or not finding.severity.at_least(Severity.MEDIUM):
            continue
        path, number = place
        file = documents.get(path)
        if file is None or file.content is None or file.holds_private_key:
            continue
        lines = split.get(path) or split.setdefault(path, file.content.split(b"\n"))
        line = lines[number - 1].decode("utf-8", "replace").strip() if number <= len(lines) else ""
        if line.startswith("<") and not line.startswith("<!"):  # of the XML, and of no signature, nor of a DTD
            found[place] = shorten(line, MAX_EXCERPT)
    return found


def place_of(finding: Finding) -> tuple[str, int] | None:
    """The path and the number of the line that the finding names first; None where it names none."""
    return next(((each.path, each.line) for each in finding.locations if each.line is not None), None)


def unread(keystore: Keystore) -> Iterator[str]:
    """Files that were not read, and what no digest speaks of."""
    files = keystore.unread_foreign
    if files:
        yield (
            f"{counted(len(files), 'file')} that could not be read and that nobody accepted, {files[0].place} first: "
            "what is said here holds if no key, certificate or document is in there, and no statement passes."
        )
    uncovered = keystore.uncovered
    if uncovered:
        yield (
            f"{len(uncovered)} files or directories whose content is in no digest, since they could not be read or are "
            f"too large, {uncovered[0]} first: what is put there later changes no digest, and no statement passes."
        )


def untested(profiles: Sequence[Profile]) -> Iterator[str]:
    """How the profiles are known whose rows this project's tests do not ask the real implementation about."""
    measured = [profile.name for profile in profiles if profile.evidence is Evidence.MEASURED]
    read = [profile.name for profile in profiles if profile.evidence is Evidence.READ and profile.name != "spec"]
    if measured:
        yield f"{', '.join(measured)}: by measurements on the releases, not asked again since (docs/profiles.md)."
    if read:
        yield f"{', '.join(read)}: by their source alone (docs/profiles.md)."


# Values in JSON as every report writes them: a line of ASCII that every reader takes.


_SURROGATE: Final = re.compile("[\ud800-\udfff]")
_MARKER: Final = re.compile("#(?=#)|:(?=:)")
"""Where what runners of pipelines take for a command begins (`##vso[`, `::error::`), as `text.terminal` has it."""


def encoded(value: Any) -> str:
    r"""One value on one line. Lone surrogates (bytes that are no text), which readers refuse, are shown: `\udc80`.

    Nothing in it is a command to the runner of a pipeline: the first sign of one is written as `\u0023` or `\u003a`.
    """
    text = json.dumps(value)  # without arguments: the one form for which Python keeps its encoder
    if r"\ud" in text:
        shown = _SURROGATE.sub(lambda match: rf"\\u{ord(match[0]):04x}", json.dumps(value, ensure_ascii=False))
        text = json.dumps(json.loads(shown))
    if "##" in text or "::" in text:  # in strings alone, in which a reader takes the one form for the other
        text = _MARKER.sub(lambda match: rf"\u{ord(match[0]):04x}", text)
    return text


def picked(value: object, *names: str) -> dict[str, Any]:
    """The fields of a value that a report calls as we do. JSON takes our words for strings, and tuples for arrays."""
    return {name: getattr(value, name) for name in names}


def keys(values: Mapping[str, Any]) -> list[str]:
    """A line for each key of a document."""
    return [f"  {encoded(key)}: {encoded(value)}" for key, value in values.items()]


BETWEEN: Final = ",\n    "
"""What stands between items of a key of a document."""


def array(key: str, items: Sequence[str], indent: int = 2) -> str:
    """A key of a document with a line for each of its items, which are JSON already."""
    space = " " * indent
    inner = f",\n{space}  ".join(items)
    return f"{space}{encoded(key)}: [\n{space}  {inner}\n{space}]" if items else f"{space}{encoded(key)}: []"


def document(parts: Iterable[str]) -> str:
    """Lines for keys as one document: fit to read and to diff, ten times faster than indenting."""
    return "{\n" + ",\n".join(parts) + "\n}\n"


def told(counterexample: Counterexample | None) -> dict[str, Any] | None:
    """A counterexample, or a way of data, as every report tells it."""
    if counterexample is None:
        return None
    steps = [picked(step, "enclave", "channel", "witness", "path", "line") for step in counterexample.steps]
    return {"text": counterexample.text, "steps": steps}


_SCHEMA: Final = "http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_permissions.xsd"
_DDS: Final = f'dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:noNamespaceSchemaLocation="{_SCHEMA}"'

_ELEMENTS: Final = {
    Action.PUBLISH: "topic",
    Action.SUBSCRIBE: "topic",
    Action.REQUEST: "service",
    Action.REPLY: "service",
    Action.CALL: "action",
    Action.EXECUTE: "action",
}


def permissions_xml(grant: Grant) -> str:
    """The document with this one grant (DDS-Security 1.1, 9.4.1.3), ready to be signed; ends in a line feed.

    Plain XML without comments, which implementations read in different ways.
    """
    return "".join(f"{line}\n" for line in _inside(_DDS, _inside("permissions", _grant(grant))))


def policy_xml(policy: LeastPolicy) -> str:
    """Version 0.2.0 of the ROS 2 design article "SROS2 access control policies"; ends in a line feed.

    The usual rights of a node stand behind a comment. Names are absolute, so that no namespace changes them. Each
    enclave has one `<profiles>`: of several, sros2 makes several grants, and implementations ask the first alone.
    """
    enclaves: list[str] = []
    for each in policy.enclaves:
        nodes = (line for node in each.nodes for line in _node(node))
        enclaves += _inside(f'enclave path="{html(each.path)}"', _inside("profiles", nodes))
    lines = _inside('policy version="0.2.0"', _inside("enclaves", enclaves))
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + "".join(f"{line}\n" for line in lines)


def _inside(opening: str, lines: Iterable[str]) -> Iterator[str]:
    """The lines within an element."""
    yield f"<{opening}>"
    yield from (f"  {line}" for line in lines)
    yield f"</{opening.split(' ', maxsplit=1)[0]}>"


def _element(name: str, text: Text) -> str:
    return f"<{name}>{html(text.text)}</{name}>"


def _grant(grant: Grant) -> Iterator[str]:
    validity = _element("not_before", grant.not_before), _element("not_after", grant.not_after)
    parts = [
        _element("subject_name", grant.subject_name),
        *_inside("validity", validity),
        *(line for rule in grant.rules for line in _rule(rule)),
        f"<default>{'ALLOW' if grant.default_allow else 'DENY'}</default>",
    ]
    return _inside(f'grant name="{html(grant.name)}"', parts)


def _rule(rule: Rule) -> Iterator[str]:
    domains: list[str] = []
    for each in rule.domains:
        ends = f"<min>{each.low}</min>", f"<max>{each.high}</max>"
        domains += [f"<id>{each.low}</id>"] if each.low == each.high else _inside("id_range", ends)
    criteria = (line for criterion in rule.criteria for line in _criterion(criterion))
    return _inside("allow_rule" if rule.allow else "deny_rule", [*_inside("domains", domains), *criteria])


def _criterion(criterion: Criterion) -> Iterator[str]:
    """A criterion in the default partition."""
    topics = (_element("topic", topic) for topic in criterion.topics)
    return _inside(criterion.operation.value, _inside("topics", topics))


def _node(node: NodePolicy) -> Iterator[str]:
    namespace, _, name = node.name.rpartition("/")
    lines: list[str] = []
    comment = "<!-- usual: every node has these, whatever it is for -->"
    for (usual, allow, action), rights in groupby(node.rights, _list):
        if usual and comment not in lines:
            lines.append(comment)
        element = _ELEMENTS[action]
        named = (f"<{element}>{html(right.name)}</{element}>" for right in rights)
        lines += _inside(f'{element}s {action.value}="{"ALLOW" if allow else "DENY"}"', named)
    return _inside(f'profile ns="{html(namespace or "/")}" node="{html(name)}"', lines)


def _list(right: PolicyRight) -> tuple[bool, bool, Action]:
    """What rights of one list have in common."""
    return right.usual, right.allow, right.action
