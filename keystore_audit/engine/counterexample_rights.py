"""Says why an enclave gets its samples taken on a channel, or reads it: by which right, flag, or keys."""

from __future__ import annotations

from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.engine import causes
from keystore_audit.engine import counterexample_identities as identities
from keystore_audit.engine.counterexample_case import Case
from keystore_audit.findings import Location
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.formal.attacker import realm_views
from keystore_audit.properties.counterexample import Step
from keystore_audit.properties.property import Role


class Way(Struct, frozen=True, kw_only=True):
    """Why an enclave can, in words that follow a colon (empty: by a grant of the permissions CA), and the lines."""

    why: str
    steps: tuple[Step, ...]


_BY_PATTERN: Final = "it may be in a partition that is a pattern, which meets this one"
"""How a right is used that is about other partitions (KA637)."""


_BY_ITSELF: Final[dict[Operation, str]] = {
    Operation.SUBSCRIBE: "its own implementation lets it read there; honest peers would not, but who attacks "
    "gives its keys to anybody",
    Operation.PUBLISH: "its own implementation lets it write there; honest peers would not take it, but who "
    "attacks takes samples from anybody",
}
"""How an endpoint is used that honest peers refuse."""


def way(case: Case, enclave: int, operation: Operation, *, alone: bool) -> Way:
    """How an enclave gets to the channel of `case`: by right, else as another whose key it has, else by its keys.

    `alone`: what its own implementation lets it do is enough.
    """
    own = _as_itself(case, enclave, operation) or (_alone(case, enclave, operation) if alone else None)
    if own is not None:
        return _shown(case, enclave, own)
    system = case.system
    for number in range(len(system.enclaves)):
        if number != enclave and _same_key(case, enclave, number):
            other = _as_itself(case, number, operation)
            if other is not None:
                who = system.enclaves[number].label
                why = f"it has the key of {who}" + (f": {other.why}" if other.why else "")
                return _shown(case, number, replace(other, why=why))
    return as_anybody(case, operation, enclave) or _shown(case, enclave, _announced(case, enclave) or by_keys(case))


def as_anybody(case: Case, operation: Operation, enclave: int | None) -> Way | None:
    """Without any key, as members of the realm of `case` protect the channel; else, where the enclave (None: nobody's)
    has no keys for it there, as those of another realm do; None: nowhere.
    """
    channel = case.witness[Role.CHANNEL]
    views = realm_views(case.system)
    for realm in sorted(range(len(views)), key=lambda each: each != case.realm):
        view = views[realm]
        if (view.injectable if operation == Operation.PUBLISH else view.readable) >> channel & 1:
            there = replace(case, witness={**case.witness, Role.REALM: realm})
            verb, besides = ("send", there.open_door()) if operation == Operation.PUBLISH else ("read", "")
            why = f"anybody on the network can {verb} it: {there.kinds()}{besides}"
            return Way(why=why, steps=there.governance_steps())
        if realm == case.realm and enclave is not None:
            able = view.abilities(enclave)
            if (able.forges if operation == Operation.PUBLISH else able.overhears) >> channel & 1:
                return None
    return None


def beyond_grants(case: Case, operation: Operation) -> Way:
    """How the enclave of `case` does what the permissions CA did not grant it: by a flag, a concession, or keys."""
    enclave = case.witness[Role.ENCLAVE]
    found = _uncontrolled(case, enclave, operation) or _conceded(case, enclave, operation)
    return _shown(case, enclave, found or _announced(case, enclave) or by_keys(case))


def _shown(case: Case, enclave: int, found: Way) -> Way:
    """With the certificate that makes it a participant, where it is no enclave."""
    atom = case.system.enclaves[enclave]
    step = identities.identity_step(case.system, atom)
    if not atom.at_large or step in found.steps:
        return found
    return replace(found, steps=(*found.steps, step))


def _announced(case: Case, enclave: int) -> Way | None:
    """By what it says of its endpoints, where that is not taken to be true."""
    if not case.system.announcements_trusted:  # nearly always
        return None
    view = realm_views(case.system)[case.realm]
    if not view.abilities(enclave).unannounced >> case.witness[Role.CHANNEL] & 1:
        return None
    why = "by announcing its endpoint as free of access control: peers believe it, and no file here changes that"
    return Way(why=why, steps=case.governance_steps())


def by_keys(case: Case) -> Way:
    """By the keys that an enclave holds as a participant, reader or relay."""
    return Way(why=f"with the keys that it holds, since {case.kinds()}", steps=case.governance_steps())


def _as_itself(case: Case, enclave: int, operation: Operation) -> Way | None:
    granted = [
        right
        for right in causes.rights(case.system, enclave, operation, case.witness[Role.CHANNEL])
        if causes.signed_by_ca(case.system, case.realm, right.document)
    ]
    if granted and not case.is_open:
        return Way(why=_BY_PATTERN if granted[0].by_pattern else "", steps=_steps(case, enclave, granted[0].location))
    return _uncontrolled(case, enclave, operation) or _conceded(case, enclave, operation)


def _uncontrolled(case: Case, enclave: int, operation: Operation) -> Way | None:
    """By a topic rule that asks for no right."""
    rule = case.topic_rule
    if rule is None or case.is_open:
        return None
    if operation == Operation.PUBLISH and not rule.enable_write_access_control:
        return Way(why="enable_write_access_control is false", steps=_steps(case, enclave, rule.location))
    if operation == Operation.SUBSCRIBE and not rule.enable_read_access_control:
        return Way(why="enable_read_access_control is false", steps=_steps(case, enclave, rule.location))
    return None


def _alone(case: Case, number: int, operation: Operation) -> Way | None:
    """By what its own implementation decides, from or to somebody that attacks."""
    steps = case.lone_steps(number, operation)
    return Way(why=_BY_ITSELF[operation], steps=steps) if steps else None


def _conceded(case: Case, number: int, operation: Operation) -> Way | None:
    """By a right that peers concede though the permissions CA did not give it."""
    system, enclave = case.system, case.system.enclaves[number]
    if case.is_open:
        return Way(why=case.kinds(), steps=case.governance_steps())
    identity = (identities.identity_step(system, enclave),)
    if enclave.opaque:
        return Way(why="its identity could not be read, so it may be anybody", steps=identity)
    if causes.has_authority_key(system, case.realm, enclave.identity):
        return Way(why="its key is that of the permissions CA", steps=identity)
    if case.view.self_granting(number):
        return Way(why="it can sign itself permissions that its peers accept", steps=identity)
    if case.view.issuing(number):
        why = "its key is that of an identity CA, so that it can issue itself the identity of whomever a grant names"
        return Way(why=why, steps=identity)
    for right in causes.rights(system, number, operation, case.witness[Role.CHANNEL]):
        if not right.document.opaque and not causes.signed_by_ca(system, case.realm, right.document):
            why = f"{right.document.label} grants it, which the permissions CA did not sign and peers accept"
            return Way(why=why, steps=_steps(case, number, right.location))
    if document := causes.opaque_document(system):
        why = f"{document.label} could not be read, so it may grant anything"
        return Way(why=why, steps=_steps(case, number, document.location))
    return None


def _same_key(case: Case, one: int, other: int) -> bool:
    first, second = (case.system.enclaves[number] for number in (one, other))
    if first.opaque or second.opaque:
        return True
    key = case.system.key_of(one)
    return key is not None and key == case.system.key_of(other)


def _steps(case: Case, enclave: int, location: Location | None) -> tuple[Step, ...]:
    """The one step that an enclave takes on a channel because of a line."""
    return (case.step(location, case.system.enclaves[enclave].label),)
