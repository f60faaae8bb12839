"""What changed in meaning between two keystores: `diff`, and whoever wants the answer as a value."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.circumstances import Circumstances
from keystore_audit.engine.native import NativeEngine
from keystore_audit.intent.intent import Intent
from keystore_audit.intent.policy import Policy
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.claims.globs import Globs
from keystore_audit.model.claims.stated import Claim
from keystore_audit.model.comparison.change import Change, Comparison, Direction, Layer, Unread
from keystore_audit.model.comparison.compare import compare
from keystore_audit.model.comparison.sides import with_what_was
from keystore_audit.model.intended.drift import Drift, drift
from keystore_audit.model.intended.observed import observe
from keystore_audit.model.interpret import interpret
from keystore_audit.model.names import ros_name
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.properties import Status


class Intended(Struct, frozen=True, kw_only=True):
    """What somebody asked of the keystores: a policy, graphs and launch files, properties of the settings."""

    policy: Policy | None = None
    intents: Sequence[Intent] = ()
    claims: Sequence[Claim] = ()

    def __bool__(self) -> bool:
        return self.policy is not None or bool(self.intents) or bool(self.claims)


def compare_keystores(
    old: str | os.PathLike[str],
    new: str | os.PathLike[str],
    given: Circumstances,
    *,
    labels: Mapping[str, Globs] | None = None,
    intended: Intended | None = None,
) -> Comparison:
    """What changed from the keystore at `old` to that at `new`.

    `labels`: by label, what has it; where there are some, changes about others do not fail. `intended`: a right that it
    names is not to be lost, and one that it forbids not to stay with whoever keeps an old document.
    Raises errors.NothingToAudit where one of them is none, and errors.UsageError for a label of nothing in either.
    Raises errors.BudgetExceeded where there are too many classes of names.
    """
    keystores = given.keystore(old), given.keystore(new)
    found = compare(*keystores, given.profiles, given.at, given.zone, given.domain, labels, given.assumed)
    if not intended:
        return found
    kept = with_what_was(*keystores)
    before, after, still = (_Asked(keystore, intended, given) for keystore in (*keystores, kept))
    needed = [
        _change("needed", enclave, words, found)
        for (enclave, _right), words in _beyond(after.lacking(), before.lacking())
    ]
    removed = {path for each in found.changes if each.kind == "enclave-removed" for path in each.enclaves}
    unnamed = removed - {each.enclave for each in intended.policy.profiles} if intended.policy is not None else ()
    forbidden: list[_Forbidden] = [(path, None, f"the policy does not name {path}") for path in unnamed]
    forbidden += [(path, right[0], words) for (path, right), words in _beyond(still.exceeding(), after.exceeding())]
    changes = [replace(each, against=tuple(_against(each, forbidden))) for each in found.changes]
    until = max((each.until for each in changes if each.until), default=None)
    counting = [
        _change("forbidden", None, f"{words} while older signed documents count", found, until)
        for _key, words in _beyond(still.violated(), after.violated())
    ]
    undecided = (
        Unread(side=side, enclave=doubt.enclave, location=doubt.location, reason=doubt.reason)
        for side, asked in (("old", before), ("new", after))
        for doubt in (asked.drifts.undecided if asked.drifts else ())
    )
    unknown = tuple(dict.fromkeys((*found.unknown, *undecided)))
    return replace(found, changes=(*changes, *needed, *counting), unknown=unknown)


_Forbidden = tuple[str | None, str | None, str]
"""An enclave, an operation (None: any), and who says so."""


def _against(change: Change, forbidden: Iterable[_Forbidden]) -> Iterator[str]:
    """Why a right that is lost, but still effective, was never intended."""
    for path, operation, words in forbidden if change.until else ():
        if path in change.enclaves and operation in (None, change.operation):
            yield words


def _change(kind: str, enclave: str | None, words: str, found: Comparison, until: str | None = None) -> Change:
    return Change(
        layer=Layer.ACCESS,
        kind=kind,
        direction=Direction.LOST,
        what=words,
        enclaves=(enclave,) if enclave is not None else (),
        profiles=found.profiles,
        labels=found.labels,
        until=until,
        against=(words,),
    )


_Key = tuple[str | None, tuple[str, ...]]


def _beyond(one: Mapping[_Key, str], other: Iterable[_Key]) -> Iterator[tuple[_Key, str]]:
    known = set(other)
    yield from ((key, words) for key, words in one.items() if key not in known)


class _Asked:
    """What of the intended does not hold for one keystore, in words, by what identifies it."""

    def __init__(self, keystore: Keystore, intended: Intended, given: Circumstances) -> None:
        self._keystore, self._intended, self._accesses = keystore, intended, given.accesses(keystore)
        self._profiles, self._at, self._domain = given.profiles, given.at, given.domain

    def lacking(self) -> dict[_Key, str]:
        """Rights that the policy or a node needs and the keystore does not grant, and claims that are violated."""
        found: dict[_Key, str] = {}
        for each in self.drifts.enclaves if self.drifts else ():
            if each.lacking.more:
                words = f"may no longer do {each.lacking.more} more things that the policy allows"
                found[each.enclave, ("more", str(each.lacking.more))] = words
            for right in each.lacking.rights if each.own else ():
                key = each.enclave, (right.operation.value, right.topic, right.partition)
                found[key] = f"may no longer {right.operation.value} {ros_name(right.topic)}; the policy allows it"
        if self._intended.intents:
            asked = (self._intended.intents, self._keystore, self._profiles, self._at, self._accesses, self._domain)
            for need in (missing.need for missing in observe(*asked).missing):
                what = f"{need.action.value} {need.name}" if need.action is not None else "take part in discovery"
                found[need.enclave, (need.node, what)] = f"may no longer {what}; {need.node or 'a node'} needs it"
        return found | self.violated()

    def exceeding(self) -> dict[_Key, str]:
        """Rights that documents grant and the policy does not; for every operation where not all are listed."""
        found: dict[_Key, str] = {}
        for each in self.drifts.enclaves if self.drifts else ():
            whom = f"the policy does not let {each.enclave}"
            for right in each.exceeding.rights:
                key = each.enclave, (right.operation.value, right.topic, right.partition)
                found[key] = f"{whom} {right.operation.value} {ros_name(right.topic)}"
            if each.exceeding.more:
                for operation in Operation:
                    key = each.enclave, (operation.value, each.document, str(each.exceeding.more))
                    found[key] = f"{whom} do {each.exceeding.more} more things that documents grant"
        return found

    @cached_property
    def drifts(self) -> Drift | None:
        """What differs from the policy."""
        policy = self._intended.policy
        if policy is None:
            return None
        return drift(self._keystore, policy, self._profiles, self._at, self._accesses, self._domain)

    def violated(self) -> dict[_Key, str]:
        """The claims of the settings that do not hold."""
        if not self._intended.claims:
            return {}
        claims, usabilities = self._intended.claims, Usabilities(self._domain, self._accesses)
        meaning = interpret(self._keystore, self._profiles, self._at, self._accesses, usabilities, claims)
        answers = NativeEngine(meaning.systems).claim_answers()
        return {
            (None, (claim.id,)): f"the property {claim.id} does not hold"
            for claim in claims
            if any(each[claim.id].status is Status.VIOLATED for each in answers if claim.id in each)
        }
