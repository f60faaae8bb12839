"""What is left of rights that were taken away: peers take whatever document is presented to them.

Whoever keeps an old document presents it (measured on Fast DDS 2.9.1 and Cyclone DDS 0.10.2), and whoever keeps an old
identity is let in as before. So what is lost is asked of NEW's peers once more, with those files beside them.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from typing import Final

from keystore_audit.grouped import gathered
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.comparison.kept import BEFORE
from keystore_audit.model.comparison.sides import Pair, Sides, View
from keystore_audit.model.formal.bit_sets import members
from keystore_audit.text import instant

JOIN: Final = "join"


class Still:
    """What may still be done of what NEW grants no more."""

    def __init__(self, sides: Sides) -> None:
        self._subjects = {
            path: enclave.identity.subject
            for path, enclave in sides.enclaves[0].items()
            if enclave.identity is not None
        }
        self._kept: dict[int, _Kept] = {}

    def remains(self, pair: Pair) -> bool:
        """Whether peers of NEW take anything that OLD alone has."""
        return self._of(pair).remains()

    def split(
        self, pair: Pair, path: str, operation: str, channels: int, *, gained: bool = False
    ) -> Iterator[tuple[int, str | None]]:
        """What of the channels the enclave may still use, and until when; and (None) what is gone, or `gained`."""
        still, until = 0, None
        for rights, end in self._of(pair).rights(self._subjects.get(path), path, operation) if not gained else ():
            part = channels & rights
            if part:
                still |= part
                until = end if until is None else max(until, end)
        if until is not None:
            yield still, instant(until)
        if channels & ~still:
            yield channels & ~still, None

    def _of(self, pair: Pair) -> _Kept:
        if id(pair.kept) not in self._kept:
            self._kept[id(pair.kept)] = _Kept(pair.kept)
        return self._kept[id(pair.kept)]


class _Kept:
    """One view of NEW with what was kept of OLD."""

    def __init__(self, view: View) -> None:
        system = view.system
        self._view = view
        self._let_in = [
            number
            for number, each in enumerate(system.enclaves)
            if each.identity is not None and any(realm.authenticated(number) for realm in view.realms)
        ]
        identities = ((number, system.enclaves[number].identity) for number in self._let_in)
        self._named = gathered((system.certificates[each].label, each) for _n, each in identities if each is not None)
        self._grants = gathered(
            (certificate, number)
            for number, grant in enumerate(system.grants)
            if grant.document in view.taken and grant.not_after >= system.now
            for certificate in grant.names
        )

    def remains(self) -> bool:
        system = self._view.system
        documents = any(system.documents[each].label.startswith(BEFORE) for each in self._view.taken)
        return documents or any(system.enclaves[n].location.path.startswith(BEFORE) for n in self._let_in)

    def rights(self, subject: str | None, path: str, operation: str) -> Iterator[tuple[int, datetime]]:
        """What each grant that is not over, begun or not, gives a participant of that name, and until when at most."""
        system, number = self._view.system, self._view.numbers.get(path)
        identities = set(self._named.get(subject, ()) if subject is not None else ())
        if number in self._let_in and (own := system.enclaves[number].identity) is not None:
            identities.add(own)
        for identity in identities:
            for grant in self._grants.get(identity, ()):
                end = min(system.grants[grant].not_after, system.certificates[identity].not_after)
                yield channels_of(self._view, grant, operation), system.instants[end]


def channels_of(view: View, grant: int, operation: str) -> int:
    """On which channels the grant lets its holder do that."""
    if operation == JOIN:
        return view.decisions.within(members(view.decisions.joins(grant)))
    return view.decisions.met(view.decisions.allowed(grant, Operation(operation)))


def may(verb: str, until: str | None, *, gained: bool) -> str:
    """What somebody may do, as a verb phrase; never that a right is gone which they still have."""
    if gained:
        return f"may {verb}"
    return f"may no longer {verb}" if until is None else f"may still, until {until}, {verb}"


PRESENTED_BEFORE: Final = "unless somebody presents what was signed before,"
"""What is added to what others can no longer do, or where data can no longer get, where peers of NEW take that."""
