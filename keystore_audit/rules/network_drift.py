"""KA8: what was signed, or what the policy says, and what sessions and routers let enclaves do (`--zenoh DIR`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache, reduce
from itertools import islice
from operator import and_
from typing import Final

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location, Severity, decision
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.channels import Point, document_channels
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.intended.drift_rights import policy_grant
from keystore_audit.model.matching.expression import any_matches
from keystore_audit.model.names import Use, dds_channels
from keystore_audit.profiles import Matcher, facts
from keystore_audit.rules.network_access import NAMED
from keystore_audit.rules.registry import Context, Violation, more_like, rule
from keystore_audit.truth import Truth, any_of
from keystore_audit.zenoh.answers import rights_in
from keystore_audit.zenoh.names import MAX_RIGHTS, rule_domains, written_names
from keystore_audit.zenoh.network import Network, is_session

Granted = Callable[[Enclave, Sequence[Use]], Truth]
"""Whether an enclave was given all of it."""
_Asked = tuple[Enclave, str, str, int]
"""Who, what, on which name of ROS 2, in which domain."""
WORDS: Final = {"publish": "publish", "subscribe": "subscribe to", "request": "call", "reply": "serve"}


@rule(
    "KA822",
    Severity.HIGH,
    facts.ROUTED_ACCESS,
    decision(f"Sign what is meant (or write it into the policy), or forbid it in the files. {NAMED}"),
)
def right_beyond_permissions(network: Network, context: Context) -> Iterator[Violation]:
    """An enclave can do what its signed permissions do not grant, or where a policy is named, what that does not say.

    Nobody reads permissions.p7s here: what counts is what others' files let in, with the enclave's own file or without.
    Asked of topics and services that permissions or rules name, in the domains that rules name (else 0), and of one
    name (`any` for wildcards) of each pattern of a rule. Rights by patterns are granted like others; patterns are not
    compared with patterns. Routers, which pass on what comes, and enclaves without permissions (where no policy is
    named) are not compared. Of more than 2,000 rights it stays open.
    """
    rights, told, places, doubtful = rights_in(network), list[str](), dict[Location, None](), False
    try:
        asked = [*islice(_not_granted(network, context), MAX_RIGHTS + 1)]
    except BudgetExceeded as exceeded:
        yield Violation(f"Not compared with what was granted: {exceeded.message}", (), undecided=True, key="budget")
        return
    for (enclave, operation, name, domain), granted in asked[:MAX_RIGHTS]:
        answers = [rights.answer(enclave, operation, name, domain, each) for each in context.releases]
        reached = [way for each in answers for way in (each.could, each.works) if way.truth is Truth.YES]
        truth = Truth.YES if reached else any_of(each.could.truth for each in answers)
        if truth is Truth.YES and granted is Truth.NO:
            told.append(f"{enclave.path} {WORDS[operation]} {name}")
            places |= {each.location: None for each in reached if each.location is not None}
        doubtful = doubtful or truth.may
    whose = "The policy does" if context.drift is not None else "Permissions do"
    if told:
        yield Violation(
            f"{whose} not let {told[0]}{more_like(told)}, and the files let it.", [*places], key="\n".join(sorted(told))
        )
    elif len(asked) > MAX_RIGHTS:
        message = f"Only {MAX_RIGHTS} rights beyond what was granted were asked about in {network.path}."
        yield Violation(message, (), undecided=True, key="more")
    elif doubtful and not rights.doubts:  # these are a finding of their own
        message = f"Whether the files in {network.path} let more than was granted cannot be told."
        yield Violation(message, (), undecided=True, key="doubt")


def _not_granted(network: Network, context: Context) -> Iterator[tuple[_Asked, Truth]]:
    """What is not granted for certain."""
    routing = {each.owner for each in network.started} - {each.owner for each in network.started if is_session(each)}
    enclaves = [each for each in context.keystore.enclaves if each not in routing and each.identity is not None]
    if context.drift is None:
        enclaves = [each for each in enclaves if each.permissions is not None]
    documents = [each.permissions for each in context.keystore.enclaves if each.permissions is not None]
    for domain in rule_domains(network):
        named = written_names(documents, network, domain).rights
        uses = {(operation, name): dds_channels(operation, name) for operation, name in named}
        granted = _by_policy(context) or _by_permissions(context, [*uses.values()], domain)
        for enclave in enclaves:
            for (operation, name), needed in uses.items():
                truth = granted(enclave, needed)
                if truth is not Truth.YES:
                    yield (enclave, operation, name, domain), truth


def _by_policy(context: Context) -> Granted | None:
    """What the policy says, whose denials come first, as sros2 writes them; None: there is none."""
    if context.drift is None:
        return None
    rights = {each.enclave: policy_grant(each).rights for each in context.drift.policy.profiles if not each.lost}

    def granted(enclave: Enclave, needed: Sequence[Use]) -> Truth:
        own = rights.get(enclave.path, {})

        def listed_to(allow: bool, use: Use) -> bool:
            texts = (text for given, operation, text in own if given is allow and operation is use[0])
            return any_matches(texts, use[1], Matcher.POSIX)

        return Truth.YES if all(listed_to(True, use) and not listed_to(False, use) for use in needed) else Truth.NO

    return granted


def _by_permissions(context: Context, uses: Sequence[Sequence[Use]], domain: int) -> Granted:
    """What each enclave's own permissions grant to all that read them, whatever the governance."""
    accesses = context.accesses
    numbers = {topic: number for number, topic in enumerate(dict.fromkeys(topic for each in uses for _, topic in each))}
    points: list[Point] = [(topic, "") for topic in numbers]
    files = [each.permissions for each in context.keystore.enclaves]
    channels = document_channels(accesses.by_row(context.profiles, files), points, opened=True)
    rights = LocalRights(accesses, channels, context.at)

    @cache
    def given(enclave: Enclave, operation: Operation) -> int:
        each = (rights.peer_authorised(enclave, profile, operation) for profile in context.profiles)
        return reduce(and_, each)

    @cache
    def silent(enclave: Enclave) -> bool:
        file = enclave.permissions
        return file is not None and any(accesses.read(file, row).is_silent for row in accesses.rows(context.profiles))

    def granted(enclave: Enclave, needed: Sequence[Use]) -> Truth:
        if silent(enclave):
            return Truth.UNKNOWN
        every = (given(enclave, use) >> channels.of_point(domain, numbers[topic]) & 1 for use, topic in needed)
        return Truth.YES if all(every) else Truth.NO

    return granted
