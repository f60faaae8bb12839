"""Who may publish by a claim of only-publish: whom it names, or the one enclave that does now."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from keystore_audit.model.claims.elsewhere import same_elsewhere
from keystore_audit.model.claims.named_enclaves import left_out, named_enclaves
from keystore_audit.model.formal.attacker import realm_views
from keystore_audit.model.formal.bit_sets import bits
from keystore_audit.model.formal.claim import Place
from keystore_audit.model.formal.system import LeftOut, System


def permitted(system: System, globs: Collection[str], known: Collection[str], channels: frozenset[int]) -> Place:
    """Whom the globs name, of all enclaves (`known`) those that are in the system; without globs some writer.

    With whoever has the subject of one elsewhere, where its peers refuse the certificate that it has here. And (MUST)
    with what may be of enclaves that were left out and that are meant: that they publish is no violation.
    """
    if globs:
        here = named_enclaves(system, globs, known, unread=False)
        return _with_theirs(system, here, left_out(system, globs, known))
    writer = _some_writer(system, channels)
    return _with_theirs(system, writer, () if writer else system.left_out)


def _with_theirs(system: System, enclaves: frozenset[int], unread: Iterable[LeftOut]) -> Place:
    """The enclaves, whoever has their subjects elsewhere, and each certificate that may be one of `unread`."""
    identities = {each.identity for each in unread}
    anybody = None in identities
    keys = {system.certificates[identity].key for identity in identities if identity is not None}
    at_large = {n for n, each in enumerate(system.enclaves) if each.at_large and (anybody or system.key_of(n) in keys)}
    here = {each.identity for each in system.enclaves}
    possible = {n for n in range(len(system.certificates)) if anybody or n in identities} - here
    theirs = {each for enclave in enclaves for each in same_elsewhere(system, enclave)}
    return Place(enclaves=enclaves | at_large, certificates=frozenset(possible | theirs))


def _some_writer(system: System, channels: frozenset[int]) -> frozenset[int]:
    """One enclave that may write one of the channels at the audit instant, none where nobody may.

    One that could be read is taken rather than one that may be anybody, and none that is no enclave's identity; one
    whose subject alone may, elsewhere, where there is no other. That nobody else writes there is not said.
    """
    asked = bits(channels)
    views = realm_views(system)
    enclaves = [number for number, enclave in enumerate(system.enclaves) if not enclave.at_large]
    for number in sorted(enclaves, key=lambda number: system.enclaves[number].opaque):
        if any(view.abilities(number).may_write & asked for view in views):
            return frozenset({number})
    writing = {each for view in views for each, able in view.elsewhere.items() if able.may_write & asked}
    for number in enclaves if writing else ():
        if writing.intersection(same_elsewhere(system, number)):
            return frozenset({number})
    return frozenset()
