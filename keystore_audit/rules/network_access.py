"""KA8: the access control of sessions and routers: what their rules keep from whom (`--zenoh DIR`)."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import islice, product
from typing import Final

from keystore_audit.findings import Location, Severity, outside
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.profiles import Release, facts
from keystore_audit.rules.network import found, is_peer
from keystore_audit.rules.registry import Context, Violation, listed, more_like, paths, quoted, rule
from keystore_audit.text import meant
from keystore_audit.truth import Truth
from keystore_audit.zenoh.access_control import AccessControl, Flow, Kind, Subject
from keystore_audit.zenoh.access_control import Rule as Written
from keystore_audit.zenoh.answers import SENDING, Reached, Rights, rights_in
from keystore_audit.zenoh.configuration import Mode
from keystore_audit.zenoh.names import domains_in, name_in, names_in, names_of, operations_of
from keystore_audit.zenoh.network import Network, Process, common_name, is_session

_TAKEN: Final = (Kind.PUT, Kind.DELETE, Kind.QUERY, Kind.REPLY)
"""What changes something in whoever takes it."""

MAX_ASKED: Final = 500
"""Rights that are asked about without the own file: a few seconds."""

NAMED: Final = (
    f"Let `keystore-audit suggest KEYSTORE --as {facts.NETWORK_FORM} --router PATH -o DIR` write files that hold."
)
BY_HAND: Final = (
    "All sessions are then clients of one router, whose rules name certificates (without a router: --listen). By hand: "
    "give policies subjects with cert_common_names in every file, for both directions."
)


@rule(
    "KA804",
    Severity.HIGH,
    facts.ROUTED_ACCESS,
    outside("Add access_control with enabled true and default_permission deny.", NAMED, BY_HAND),
)
def no_access_control(process: Process) -> Iterator[Violation]:
    """A process has no access control: whoever has a link to it may do anything with it.

    `enabled` left out means false, whatever else the section says (measured). A router without it passes on whatever
    comes, and those behind it see only the router.
    """
    says = process.says
    section, enabled = says.find("access_control"), says.find("access_control", "enabled")
    if says.starts and says.whole is not None and (enabled is None or enabled.content is not True):
        what = "is not enabled" if section is not None else "is missing"
        line = section.line if section is not None else None
        yield found(process, f"access_control of {process.name} {what}: whoever has a link may do anything.", line)


@rule(
    "KA805",
    Severity.HIGH,
    facts.ROUTED_ACCESS,
    outside("Set default_permission to deny, and allow what is needed."),
)
def default_is_allow(process: Process) -> Iterator[Violation]:
    """A process allows what none of its rules is about, and messages wider than a rule that denies."""
    access = process.says.access
    if access is not None and access.allows and process.says.starts:
        yield found(process, f"{process.name} allows what no rule is about.", access.default_line)


@rule(
    "KA806",
    Severity.HIGH,
    facts.ROUTED_ACCESS,
    outside("Deny by default, and allow each named subject what it needs."),
)
def deny_rule_evaded(process: Process) -> Iterator[Violation]:
    """A deny rule can be evaded: with default allow, it does not apply to a message about a wider expression.

    A put on `**` reaches a subscriber of what is denied, and a subscriber of `**` gets it (measured). With default
    deny, it is void for a process that is also another subject, with an allow rule: medium.
    """
    access = process.says.access
    if access is None or not process.says.starts:
        return
    denying = [each for each in access.rules if not each.allow]
    if access.allows and denying:
        yield found(
            process,
            f"{process.name} denies by the rule {quoted(denying[0].name)}, which wider messages evade"
            f"{more_like(denying)}.",
            *(each.line for each in denying),
        )
    void = [each for each in denying if not access.allows and _is_void(access, each)]
    if void:
        message = (
            f"The rule {quoted(void[0].name)} of {process.name} is void for a process that is another subject as well."
        )
        yield found(process, message, *(each.line for each in void), severity=Severity.MEDIUM, key="void")


def _is_void(access: AccessControl, denying: Written) -> bool:
    """Whether one process can be a subject of the rule and another one, which has some rule that allows."""
    having = [subject for subject, (_line, rules) in access.subjects.items() if denying in rules]
    others = [
        subject
        for subject, (_line, rules) in access.subjects.items()
        if denying not in rules and any(each.allow for each in rules)
    ]
    return any(_together(one, other) for one in having for other in others)


def _together(one: Subject, other: Subject) -> bool:
    """Whether one process can be both."""
    pairs = zip(_properties(one), _properties(other), strict=True)
    return all(None in (left, right) or left == right for left, right in pairs)


def _properties(subject: Subject) -> tuple[str | None, ...]:
    return subject.interface, subject.name, subject.user, subject.protocol, subject.zid


@rule(
    "KA807",
    Severity.HIGH,
    facts.ROUTED_ACCESS,
    outside(NAMED, BY_HAND),
)
def anybody_may_send(process: Process) -> Iterator[Violation]:
    """A policy lets a subject send that proves no identity.

    The subject has no property, or only an interface, a protocol or an id, which every connecting process chooses.
    Files from zenoh_security_tools have only such subjects, and restrain only whoever starts with them.
    """
    rules = _of_anybody(process, *_TAKEN)
    if rules:
        keys = [text for rule in rules for text, _line in rule.keys]
        kinds = sorted({kind.value for rule in rules for kind in _TAKEN if rule.is_about(kind, Flow.INGRESS)})
        message = f"{process.name} accepts {listed(kinds)} on {listed(dict.fromkeys(keys))} from anybody."
        yield found(process, message, *(rule.line for rule in rules), key=f"{sorted(keys)}")


def _of_anybody(process: Process, *kinds: Kind) -> Sequence[Written]:
    """The rules that let such messages in from a subject that nobody has to prove to be."""
    access = process.says.access if process.says.starts else None
    subjects = access.subjects.items() if access is not None else ()
    given = (rule for subject, (_line, rules) in subjects if not subject.authenticated for rule in rules if rule.allow)
    return [*{r.name: r for r in given if any(r.is_about(kind, Flow.INGRESS) for kind in kinds)}.values()]


@rule(
    "KA835",
    Severity.LOW,
    facts.ROUTED_ACCESS,
    outside(NAMED, BY_HAND),
)
def graph_from_anybody(process: Process) -> Iterator[Violation]:
    """A policy lets a subject that proves no identity announce nodes: ROS tools may list invented nodes.

    The graph is what liveliness tokens say (`@ros2_lv`, measured). They let no data in, but mislead people and tools
    that look or wait for a node.
    """
    rules = _of_anybody(process, Kind.TOKEN)
    if rules:
        message = f"{process.name} accepts announcements of nodes from anybody."
        yield found(process, message, *(rule.line for rule in rules))


@rule(
    "KA808",
    Severity.HIGH,
    facts.ROUTED_ACCESS,
    outside(NAMED, BY_HAND),
)
def file_restrains_only_its_owner(network: Network, context: Context) -> Iterator[Violation]:
    """An enclave can do what its own file denies, by starting without that file.

    Each process polices only its own links, and a compromised one drops its file. What others let in does not depend on
    who sends; what their rules deny to its certificate stays denied. Holders of a router's key are not reported here.
    Checked for 500 rights that rules name; with more, and none found among these, it stays open.
    """
    rights, told, places = rights_in(network), list[str](), dict[Location, None]()
    sent = list[tuple[str, str]]()
    asked = [*islice(_asked(network, context), MAX_ASKED + 1)]
    for enclave, does, operation, key in asked[:MAX_ASKED]:
        reaching = (_dropping(rights, enclave, operation, key, release) for release in context.releases)
        reached = next((each for each in reaching if each is not None), None)
        if reached is not None:
            what = f"{enclave.path} can {does} {name_of(key)} if it starts without its file"
            told.append(f"{what}: {reached.last.name} accepts it")
            sent += [(enclave.path, name_of(key))] if operation in SENDING else []
            places |= {reached.location: None} if reached.location is not None else {}
    if told:
        yield Violation(f"{told[0]}{more_like(told)}.", [*places], key=told[0], sent=tuple(sent))
    elif len(asked) > MAX_ASKED:
        message = f"Only {MAX_ASKED} of the rights that rules in {network.path} name were checked."
        yield Violation(message, (), undecided=True, key="more")


def _asked(network: Network, context: Context) -> Iterator[tuple[Enclave, str, str, str]]:
    """Who, in words and as `can` calls it, on which expression: what rules name that let others in."""
    running = {each.owner for each in network.started if is_session(each)}
    for does, operation, kind, flow in (
        ("publish", "publish", Kind.PUT, Flow.INGRESS),
        ("call", "request", Kind.QUERY, Flow.INGRESS),
        ("read", "subscribe", Kind.PUT, Flow.EGRESS),
    ):
        for process in filter(is_session, network.started):
            for key in _allowed(process, kind, flow):
                for enclave in filter(running.__contains__, context.keystore.enclaves):
                    if enclave is not process.owner:
                        yield enclave, does, operation, key


def _allowed(process: Process, kind: Kind, flow: Flow) -> Iterator[str]:
    yield from (
        text for rule in process.says.rules if rule.allow and rule.is_about(kind, flow) for text, _line in rule.keys
    )


def _dropping(rights: Rights, enclave: Enclave, operation: str, key: str, release: Release) -> Reached | None:
    works = rights.works(enclave, operation, key, release)
    could = rights.could(enclave, operation, key, release) if works.truth is Truth.NO else works
    return could if could is not works and could.truth is Truth.YES else None


def name_of(key: str) -> str:
    """The ROS name that an expression of a rule is about, else the expression."""
    domain, name = name_in(key)
    return name if domain is not None and name is not None else quoted(key)


@rule(
    "KA809",
    Severity.HIGH,
    facts.ROUTED_LINKS,
    outside(
        "Make the sessions clients (mode client, no listen endpoints). Or write rules by certificate names into every "
        "session's file."
    ),
)
def router_bypassed(process: Process, context: Context) -> Iterator[Violation]:
    """A router has rules, but its sessions are also linked with each other.

    As peers they find each other by gossip or by multicast, or listen, and then send straight to each other (measured).
    """
    if context.network is None or process.says.mode is not Mode.ROUTER or process.says.access is None:
        return
    peers = [each for each in context.network.started if is_peer(each)]
    if len(peers) > 1:
        names = listed(each.name for each in peers)
        message = f"The rules of the router {process.name} do not apply between {names}, which are peers."
        yield found(process, message, process.says.access.line)


@rule(
    "KA812",
    Severity.MEDIUM,
    facts.ROUTED_ACCESS,
    outside("Replace the last /** by /*/*: that is the type and its hash, and nothing below the name."),
)
def longer_names_reached(network: Network, context: Context) -> Iterator[Violation]:
    """A rule allows a name with all that is below it: `0/image/**` is about /image/raw, too (measured).

    zenoh_security_tools wrote its rules so until September 2025. Reported if permissions name the one as a topic or a
    service, and permissions or rules name another below it. The rule must have no own expression for that.
    """
    signed = {*names_in(each.permissions for each in context.keystore.enclaves if each.permissions is not None)}
    every = sorted({*signed, *(right for process in network.started for right in names_of(process))})
    for process in network.started:
        reached: dict[str, tuple[int, str]] = {}
        for each in process.says.rules:
            own = {name_in(text) for text, _line in each.keys}
            tails = {name_in(key[0]): key for key in each.keys if each.allow and key[0].endswith("/**")}
            for ((domain, name), (text, line)), operation in product(tails.items(), operations_of(each)):
                if domain is not None and name is not None and (operation, name) in signed:
                    longer = (other for other in _below(every, operation, name) if (domain, other) not in own)
                    first = next(longer, None)
                    if first is not None:
                        reached[text] = line, first
        if reached:
            text, (_line, other) = next(iter(reached.items()))
            message = f"{process.name} has a rule for {quoted(text)}, which also covers {other}"
            yield found(process, f"{message}{more_like(reached)}.", *(line for line, _other in reached.values()))


def _below(every: Sequence[tuple[str, str]], operation: str, name: str) -> Iterator[str]:
    """The names below one that stand, in order, among these."""
    for index in range(bisect_left(every, (operation, f"{name}/")), len(every)):
        does, other = every[index]
        if does != operation or not other.startswith(f"{name}/"):
            return
        yield other


@rule(
    "KA818",
    Severity.HIGH,
    facts.ROUTED_ACCESS,
    outside("Write the enclave's path as in its certificate; names are compared letter by letter."),
)
def name_of_nobody(process: Process, context: Context) -> Iterator[Violation]:
    """A subject names a certificate that no enclave has: its rules are for nobody, or for a stranger who has it.

    Names have no patterns, and case and blanks count (measured).
    """
    names = {common_name(each.identity) for each in context.keystore.enclaves if each.identity is not None}
    access = process.says.access
    subjects = access.subjects.items() if access is not None else ()
    nobody = {subject.name: line for subject, (line, _rules) in subjects if subject.name not in (None, *names)}
    if nobody:
        hints = [meant(f"{name}", (each for each in names if each), " (the nearest is {})") for name in nobody]
        named = listed(f"{quoted(f'{name}')}{hint}" for name, hint in zip(nobody, hints, strict=True))
        yield found(process, f"{process.name} has rules for {named}, which no enclave is.", *nobody.values())


@rule(
    "KA821",
    Severity.MEDIUM,
    facts.ROUTED_ACCESS,
    outside("Name it in a policy, or remove it."),
)
def rule_of_no_policy(process: Process) -> Iterator[Violation]:
    """No policy names a rule or a subject.

    Such a rule has no effect. Such a subject still counts, and gets the default (measured).
    """
    unused = process.says.access.unused if process.says.access is not None else ()
    if unused:
        message = f"No policy of {process.name} names the {quoted(unused[0][0])}{more_like(unused)}."
        yield found(process, message, *(line for _what, line in unused))


@rule(
    "KA823",
    Severity.MEDIUM,
    facts.ROUTED_ACCESS,
    outside("Write the rules of all files for the robot's domain (ROS_DOMAIN_ID)."),
)
def domain_of_no_other(network: Network) -> Iterator[Violation]:
    """The rules of a process are about another domain than those of all others, so nothing comes through.

    The generator is told its domain separately from the robot. Not reported if another process lets anything through,
    or a file was not read.
    """
    spoken = {each.path: domains_in(each) for each in network.started}
    files = Counter(domain for domains in spoken.values() for domain in domains)
    open_to_any = None in files or any(each.says.access is None or each.says.access.allows for each in network.started)
    alone = [
        each
        for each in network.started
        if (own := spoken[each.path]) and files.keys() - own and all(files[domain] == 1 for domain in own)
    ]
    if alone and not (open_to_any or network.unread):
        domains = listed(f"{domain}" for domain in spoken[alone[0].path])
        message = f"No other file has rules for the domain of {alone[0].name}, {domains}{more_like(alone)}."
        yield Violation(message, [each.at(None) for each in alone])


@rule(
    "KA824",
    Severity.HIGH,
    facts.ROUTED_FILES,
    outside("Write one file for each enclave that runs, which names its cert.pem and key.pem."),
)
def file_without_enclave(network: Network, context: Context) -> Iterator[Violation]:
    """A file names the certificate of no enclave: its process has no identity of the keystore.

    Medium for an enclave that no file names: it starts with another file, or with the defaults, which are plain.
    """
    nobody = [each for each in network.started if each.owner is None and each.says.whole is not None]
    for process in nobody:
        yield found(process, f"{process.path} names the certificate of no enclave.")
    without = [each for each in context.keystore.enclaves if all(p.owner is not each for p in network.processes)]
    if without:
        message = f"{network.path} has no file for {paths(without)}."
        places = [each.certificate.file.place for each in without if each.certificate is not None]
        yield Violation(message, [*map(Location, places)], severity=Severity.MEDIUM, key=f"{sorted(places)}")
