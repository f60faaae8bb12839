"""Says what a witness of an engine means, in the user's names and with the lines that cause it.

Both engines' witnesses are told by this module. Names in the texts are raw: whoever shows them escapes them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from keystore_audit.engine import counterexample_identities as identities
from keystore_audit.engine.counterexample_case import Case
from keystore_audit.engine.counterexample_rights import beyond_grants
from keystore_audit.findings import Location
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.formal.attacker import realm_views
from keystore_audit.model.formal.flow import Flows
from keystore_audit.model.formal.system import System
from keystore_audit.properties import stated
from keystore_audit.properties.counterexample import Counterexample, Step
from keystore_audit.properties.property import Property, Role, Witness


def describe(system: System, prop: Property, witness: Witness) -> Counterexample:
    """Return the counterexample that `witness`, an assignment of `prop.roles` to atoms of `system`, stands for."""
    return _TELLERS[prop.id](Case(system=system, witness=witness))


def _outsider_reads(case: Case) -> Counterexample:
    return Counterexample(
        text=f"Anybody on the network can read {case.topic}: {case.kinds()}.",
        steps=case.governance_steps() + case.user_steps(Operation.PUBLISH),
    )


def _unprotected(case: Case, what: str, otherwise: str) -> str:
    """Why the `what` of the topic, discovery or liveliness, is unprotected; `otherwise`: as whole messages are not."""
    rule = case.topic_rule
    if case.is_open or rule is None or case.domain_rule is None:
        return case.kinds()
    flag, kind = f"enable_{what}_protection", f"{what}_protection_kind"
    said = f"{kind} is {getattr(case.domain_rule, kind).value}" if getattr(rule, flag) else f"{flag} is false for it"
    return f"{said}, and whole messages are not {otherwise}"


def _outsider_learns(case: Case) -> Counterexample:
    return Counterexample(
        text=f"Anybody on the network learns of {case.topic}: {_unprotected(case, 'discovery', 'encrypted')}.",
        steps=case.governance_steps() + case.user_steps(Operation.PUBLISH, Operation.SUBSCRIBE),
    )


def _outsider_injects(case: Case) -> Counterexample:
    return Counterexample(
        text=f"Anybody on the network can send samples on {case.topic}: {case.kinds()}{case.open_door()}.",
        steps=case.governance_steps() + case.user_steps(Operation.SUBSCRIBE),
    )


def _outsider_replays(case: Case) -> Counterexample:
    return Counterexample(
        text=f"Anybody on the network can send recorded samples of {case.topic} again, and forge the messages that "
        f"say what was sent: {case.kinds()}{case.open_door()}.",
        steps=case.governance_steps() + case.user_steps(Operation.SUBSCRIBE),
    )


def _outsider_asserts(case: Case) -> Counterexample:
    why = _unprotected(case, "liveliness", "authenticated")
    return Counterexample(
        text=f"Anybody on the network can say that a writer of {case.topic} is alive: {why}{case.open_door()}.",
        steps=case.governance_steps() + case.user_steps(Operation.SUBSCRIBE),
    )


def _unenforced(case: Case) -> Counterexample:
    flag, step = _switched_off(case)
    return Counterexample(
        text=f"The grants on {case.topic} are not asked for: {flag}.",
        steps=(*step, *case.granted_steps(Operation.PUBLISH, Operation.SUBSCRIBE)),
    )


def _switched_off(case: Case) -> tuple[str, tuple[Step, ...]]:
    """Say which access control is off: one for which there is a grant to ask for, if all grants could be read."""
    topic_rule, domain_rule = case.topic_rule, case.domain_rule
    if case.is_open or topic_rule is None or domain_rule is None:
        return case.kinds(), case.governance_steps()
    writes, reads = Operation.PUBLISH, Operation.SUBSCRIBE
    controls: tuple[tuple[str, bool, Location, tuple[Operation, ...]], ...] = (
        ("write", topic_rule.enable_write_access_control, topic_rule.location, (writes,)),
        ("read", topic_rule.enable_read_access_control, topic_rule.location, (reads,)),
        ("join", domain_rule.enable_join_access_control, domain_rule.location, (writes, reads)),
    )
    kind, _is_on, place, _operations = min(controls, key=lambda each: (each[1], not case.granted_steps(*each[3])))
    return f"enable_{kind}_access_control is false", (case.step(place),)


def _insider_writes(case: Case) -> Counterexample:
    way = beyond_grants(case, Operation.PUBLISH)
    return Counterexample(
        text=f"{case.enclave.label} can get its samples taken on {case.topic} without a grant of the permissions CA: "
        f"{way.why}.",
        steps=way.steps,
    )


def _insider_reads(case: Case) -> Counterexample:
    way = beyond_grants(case, Operation.SUBSCRIBE)
    return Counterexample(
        text=f"{case.enclave.label} can read {case.topic} without a grant of the permissions CA: {way.why}.",
        steps=way.steps,
    )


def _reader_forges(case: Case) -> Counterexample:
    right = case.right_steps(case.witness[Role.ENCLAVE], Operation.SUBSCRIBE)
    only = "may only subscribe to" if right else "may have a right, which could not be read, only to subscribe to"
    return Counterexample(
        text=f"{case.enclave.label}, which {only} {case.topic}, can pass for a publisher of it: readers "
        f"hold the keys of the writer, and no kind tells them apart ({case.kinds()}).",
        steps=right + case.governance_steps(),
    )


def _relay_reads(case: Case) -> Counterexample:
    return Counterexample(
        text=f"{case.enclave.label}, which may only relay {case.topic}, can read it: relays hold the keys of "
        f"submessages, and the payload is not encrypted by itself ({case.kinds()}).",
        steps=case.right_steps(case.witness[Role.ENCLAVE], Operation.RELAY) + case.governance_steps(),
    )


def _bridge(case: Case) -> Counterexample:
    enclave, channel = case.witness[Role.ENCLAVE], case.witness[Role.OTHER_CHANNEL]
    realm, writer = _feeding(case.system, case.realm, enclave, channel)
    there = Case(system=case.system, witness={**case.witness, Role.REALM: realm, Role.CHANNEL: channel})
    other = case.system.enclaves[writer]
    has = "may have" if other.opaque or case.enclave.opaque else "has"
    guise = "" if writer == enclave else f" as {other.label}, whose key it {has}"
    return Counterexample(
        text=f"{case.enclave.label} can read {case.topic} and write {there.topic}{guise}: what is said in the one can "
        "get into the other.",
        steps=(*_way(case, enclave, Operation.SUBSCRIBE), *_way(there, writer, Operation.PUBLISH)),
    )


def _feeding(system: System, first: int, enclave: int, channel: int) -> tuple[int, int]:
    """The realm in which an enclave feeds a channel, the `first` if it does there; and as whom: itself, if it does."""
    views = realm_views(system)
    for who in (enclave, *Flows(system, views).acting(enclave)):
        for realm in (first, *range(len(views))):
            able = views[realm].abilities(who)
            if (able.may_write | able.forges) >> channel & 1:
                return realm, who
    return first, enclave


def _way(case: Case, enclave: int, operation: Operation) -> tuple[Step, ...]:
    """Return the line that gives the right, else those of the governance that leaves it open."""
    return case.right_steps(enclave, operation) or case.governance_steps()


_TELLERS: Final[Mapping[str, Callable[[Case], Counterexample]]] = {
    **identities.TELLERS,
    stated.OUTSIDERS_CANNOT_READ.id: _outsider_reads,
    stated.OUTSIDERS_CANNOT_LEARN_NAMES.id: _outsider_learns,
    stated.OUTSIDERS_CANNOT_INJECT.id: _outsider_injects,
    stated.OUTSIDERS_CANNOT_REPLAY.id: _outsider_replays,
    stated.OUTSIDERS_CANNOT_FORGE_LIVELINESS.id: _outsider_asserts,
    stated.GRANTS_ARE_ENFORCED.id: _unenforced,
    stated.NOBODY_WRITES_WITHOUT_A_GRANT.id: _insider_writes,
    stated.NOBODY_READS_WITHOUT_A_GRANT.id: _insider_reads,
    stated.READERS_CANNOT_FORGE.id: _reader_forges,
    stated.RELAYS_CANNOT_READ.id: _relay_reads,
    stated.NO_BRIDGES.id: _bridge,
}
