"""Says why an enclave gets its samples taken on a channel, or reads it: by which right, flag, or keys."""

from __future__ import annotations

from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.engine.case import Case
from keystore_audit.findings import Location
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.formal.attacker import realm_views
from keystore_audit.properties.result import Role, Step


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
    own = _as_itself(case, enclave, operation)
    if own is None and alone and (steps := case.lone_steps(enclave, operation)):
        own = Way(why=_BY_ITSELF[operation], steps=steps)
    if own is not None:
        return _shown(case, enclave, own)
    enclaves = case.system.enclaves
    for number, atom in enumerate(enclaves):
        key = case.system.key_of(enclave)
        same = enclaves[enclave].opaque or atom.opaque or (key is not None and key == case.system.key_of(number))
        other = _as_itself(case, number, operation) if same and number != enclave else None
        if other is not None:
            why = f"it has the key of {atom.label}" + (f": {other.why}" if other.why else "")
            return _shown(case, number, replace(other, why=why))
    return as_anybody(case, operation, enclave) or _by_keys(case, enclave)


def as_anybody(case: Case, operation: Operation, enclave: int | None) -> Way | None:
    """Without any key, as members of the realm of `case` protect the channel; else, where the enclave (None: nobody's)
    has no keys for it there, as those of another realm do; None: nowhere.
    """
    channel = case.witness[Role.CHANNEL]
    views = realm_views(case.system)
    writes = operation == Operation.PUBLISH
    for realm in sorted(range(len(views)), key=lambda each: each != case.realm):
        view = views[realm]
        if (view.injectable if writes else view.readable) >> channel & 1:
            there = case.at({Role.REALM: realm})
            verb, besides = ("send", there.open_door()) if writes else ("read", "")
            why = f"anybody on the network can {verb} it: {there.kinds()}{besides}"
            return Way(why=why, steps=there.governance_steps())
        if realm == case.realm and enclave is not None:
            able = view.abilities(enclave)
            if (able.forges if writes else able.overhears) >> channel & 1:
                return None
    return None


def beyond_grants(case: Case, operation: Operation) -> Way:
    """How the enclave of `case` does what the permissions CA did not grant it: by a flag, a concession, or keys."""
    enclave = case.witness[Role.ENCLAVE]
    found = _uncontrolled(case, enclave, operation) or _conceded(case, enclave, operation)
    return _shown(case, enclave, found) if found is not None else _by_keys(case, enclave)


def _shown(case: Case, enclave: int, found: Way) -> Way:
    """With the certificate that makes it a participant, where it is no enclave."""
    atom = case.system.enclaves[enclave]
    step = case.identity_step(atom)
    return replace(found, steps=(*found.steps, step)) if atom.unmanaged and step not in found.steps else found


def _by_keys(case: Case, enclave: int) -> Way:
    """By the keys that an enclave holds as a participant, reader or relay; or by what it says of its endpoints."""
    why = f"with the keys that it holds, since {case.kinds()}"
    trusted = case.system.announcements_trusted  # hardly ever
    if trusted and case.view.abilities(enclave).unannounced >> case.witness[Role.CHANNEL] & 1:
        why = "by announcing its endpoint as free of access control: peers believe it, and no file here changes that"
    return _shown(case, enclave, Way(why=why, steps=case.governance_steps()))


def _as_itself(case: Case, enclave: int, operation: Operation) -> Way | None:
    for right in () if case.is_open else case.rights(enclave, operation):
        if case.signed_by_ca(case.system.documents[right.document]):
            return _along(case, enclave, right.location, _BY_PATTERN if right.by_pattern else "")
    return _uncontrolled(case, enclave, operation) or _conceded(case, enclave, operation)


def _uncontrolled(case: Case, enclave: int, operation: Operation) -> Way | None:
    """By a topic rule that asks for no right."""
    kind = {Operation.PUBLISH: "write", Operation.SUBSCRIBE: "read"}.get(operation)
    rule, flag = case.topic_rule, f"enable_{kind}_access_control"
    if kind is None or rule is None or case.is_open or getattr(rule, flag):
        return None
    return _along(case, enclave, rule.location, f"{flag} is false")


def _conceded(case: Case, number: int, operation: Operation) -> Way | None:
    """By a right that peers concede though the permissions CA did not give it."""
    enclave = case.system.enclaves[number]
    if case.is_open:
        return Way(why=case.kinds(), steps=case.governance_steps())
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
            return Way(why=why, steps=(case.identity_step(enclave),))
    for right in case.rights(number, operation):
        document = case.system.documents[right.document]
        if not document.opaque and not case.signed_by_ca(document):
            why = f"{document.label} grants it, which the permissions CA did not sign and peers accept"
            return _along(case, number, right.location, why)
    unread = case.opaque_document()
    if unread is None:
        return None
    return _along(case, number, unread.location, f"{unread.label} could not be read, so it may grant anything")


def _along(case: Case, enclave: int, location: Location, why: str) -> Way:
    """The one step that an enclave takes on a channel because of a line."""
    return Way(why=why, steps=(case.step(location, case.system.enclaves[enclave].label),))
