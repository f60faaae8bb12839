"""Says why an enclave gets its samples taken on a channel, or reads it: by which right, flag, or keys.

Each in words that follow a colon (empty: by a grant of the permissions CA), with the lines.
"""

from __future__ import annotations

from typing import Final

from keystore_audit.engine.case import Case, Told
from keystore_audit.findings import Location
from keystore_audit.keystore.permissions import Operation
from keystore_audit.properties.result import Role

_BY_PATTERN: Final = "it may be in a partition that is a pattern, which meets this one"
"""How a right is used that is about other partitions (KA637)."""

_BY_ITSELF: Final[dict[Operation, str]] = {
    Operation.SUBSCRIBE: "its own implementation lets it read there; honest peers would not, but who attacks "
    "gives its keys to anybody",
    Operation.PUBLISH: "its own implementation lets it write there; honest peers would not take it, but who "
    "attacks takes samples from anybody",
}
"""How an endpoint is used that honest peers refuse."""


def way(case: Case, enclave: int, operation: Operation, *, alone: bool) -> Told:
    """How an enclave gets to the channel of `case`: by right, else as another whose key it has, else by its keys.

    `alone`: what its own implementation lets it do is enough.
    """
    own = _as_itself(case, enclave, operation)
    if own is None and alone and (steps := case.lone_steps(enclave, operation)):
        own = _BY_ITSELF[operation], steps
    if own is not None:
        return _shown(case, enclave, own)
    enclaves, key = case.system.enclaves, case.system.key_of(enclave)
    for number, atom in enumerate(enclaves):
        same = enclaves[enclave].opaque or atom.opaque or (key is not None and key == case.system.key_of(number))
        other = _as_itself(case, number, operation) if same and number != enclave else None
        if other is not None:
            why = f"it has the key of {atom.label}" + (f": {other[0]}" if other[0] else "")
            return _shown(case, number, (why, other[1]))
    return as_anybody(case, operation, enclave) or _by_keys(case, enclave)


def as_anybody(case: Case, operation: Operation, enclave: int | None) -> Told | None:
    """Without any key, as the trust domain of `case` protects the channel; else, where the enclave (None:
    nobody's) has no keys for it there, as those of another one do; None: nowhere.
    """
    writes = operation == Operation.PUBLISH
    for number in sorted(range(len(case.views)), key=lambda each: each != case.trust_domain):
        view = case.views[number]
        if (view.injectable if writes else view.readable) >> case.number & 1:
            there = case.at({Role.TRUST_DOMAIN: number})
            verb, besides = ("send", there.open_door()) if writes else ("read", "")
            return f"anybody on the network can {verb} it: {there.kinds()}{besides}", there.governance_steps()
        if number == case.trust_domain and enclave is not None:
            able = view.abilities(enclave)
            if (able.forges if writes else able.overhears) >> case.number & 1:
                return None
    return None


def beyond_grants(case: Case, operation: Operation) -> Told:
    """How the enclave of `case` does what the permissions CA did not grant it: by a flag, a concession, or keys."""
    enclave = case.witness[Role.ENCLAVE]
    found = _uncontrolled(case, enclave, operation) or _peer_authorised(case, enclave, operation)
    return _shown(case, enclave, found) if found is not None else _by_keys(case, enclave)


def _shown(case: Case, enclave: int, found: Told) -> Told:
    """With the certificate that makes it a participant, where it is no enclave."""
    atom = case.system.enclaves[enclave]
    why, steps = found
    step = case.identity_step(atom)
    return (why, (*steps, step)) if atom.unmanaged and step not in steps else found


def _by_keys(case: Case, enclave: int) -> Told:
    """By the keys that an enclave holds as a participant, reader or relay; or by what it says of its endpoints."""
    why = f"with the keys that it holds, since {case.kinds()}"
    trusted = case.system.announcements_trusted  # hardly ever
    if trusted and case.view.abilities(enclave).unannounced >> case.number & 1:
        why = "by announcing its endpoint as free of access control: peers believe it, and no file here changes that"
    return _shown(case, enclave, (why, case.governance_steps()))


def _as_itself(case: Case, enclave: int, operation: Operation) -> Told | None:
    for right in () if case.is_open else case.rights(enclave, operation):
        if right.document in case.view.genuine:
            return _along(case, enclave, right.location, _BY_PATTERN if right.by_pattern else "")
    return _uncontrolled(case, enclave, operation) or _peer_authorised(case, enclave, operation)


def _uncontrolled(case: Case, enclave: int, operation: Operation) -> Told | None:
    """By a topic rule that asks for no right."""
    kind = {Operation.PUBLISH: "write", Operation.SUBSCRIBE: "read"}.get(operation)
    rule, flag = case.topic_rule, f"enable_{kind}_access_control"
    if kind is None or rule is None or case.is_open or getattr(rule, flag):
        return None
    return _along(case, enclave, rule.location, f"{flag} is false")


def _peer_authorised(case: Case, number: int, operation: Operation) -> Told | None:
    """By a right that peers concede though the permissions CA did not give it."""
    enclave = case.system.enclaves[number]
    if case.is_open:
        return case.kinds(), case.governance_steps()
    as_whom = (
        (enclave.opaque, "its identity could not be read, so it may be anybody"),
        (case.has_authority_key(enclave.identity), "its key is that of the permissions CA"),
        (case.view.self_granting(number), "it can sign itself permissions that its peers accept"),
        (
            case.view.issuing(number),
            "its key is that of an identity CA, so that it can issue itself the identity of whomever a grant names",
        ),
    )
    for so, why in as_whom:
        if so:
            return why, (case.identity_step(enclave),)
    for right in case.rights(number, operation):
        document = case.system.documents[right.document]
        if not document.opaque and right.document not in case.view.genuine:
            why = f"{document.label} grants it, which the permissions CA did not sign and peers accept"
            return _along(case, number, right.location, why)
    unread = case.opaque_document()
    if unread is None:
        return None
    return _along(case, number, unread.location, f"{unread.label} could not be read, so it may grant anything")


def _along(case: Case, enclave: int, location: Location, why: str) -> Told:
    """The one step that an enclave takes on a channel because of a line."""
    return why, (case.step(location, case.system.enclaves[enclave].label),)
