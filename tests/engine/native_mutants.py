"""The native engine with one mistake in it: a change of one function's text, put in its place."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any

from keystore_audit.model.formal import attacker, permission, steps
from keystore_audit.model.formal.attacker import TrustDomainView
from keystore_audit.model.formal.permission import Decisions, Permissions
from keystore_audit.model.formal.system import System

MUTANTS: dict[str, tuple[Any, str, str, str]] = {
    "every matching rule counts, not the first": (steps, "decided", "& ~taken if taken else channels", ""),
    "a deny rule decides nothing": (steps, "decided", "taken |= channels", "taken |= channels if step.allow else 0"),
    "a deny rule allows": (steps, "allowed", " if step.allow", ""),
    "the default is always to deny": (Decisions, "steps", "self._system.grants[grant].default_allow", "False"),
    "the default is always to allow": (Decisions, "steps", "self._system.grants[grant].default_allow", "True"),
    "the default overrules rules": (Decisions, "steps", "append(", "insert(0, "),
    "a rule counts in every domain": (Decisions, "_matches", "bits(named) & within", "bits(named)"),
    "subscribing needs the right to publish": (Decisions, "_matches", "rule.named(operation)", "rule.publish"),
    "a default does not let join": (Decisions, "joins", "self._system.grants[grant].default_allow", "False"),
    "a deny rule lets join": (Decisions, "joins", " if rule.allow)", ")"),
    "a validity ends before its last instant": (Permissions, "in_force", "<= 2 * not_after", "< 2 * not_after"),
    "a validity begins after its first instant": (Permissions, "in_force", "2 * not_before <=", "2 * not_before <"),
    "no validity ends": (Permissions, "in_force", "<= self.moment <= 2 * not_after", "<= self.moment"),
    "no validity begins": (Permissions, "in_force", "2 * not_before <= self.moment", "self.moment"),
    "grants out of date are always skipped": (
        Permissions,
        "_chosen",
        "_system.reading_of(grant).skips_grants_out_of_date",
        "_system and True",
    ),
    "grants out of date are never skipped": (
        Permissions,
        "_chosen",
        "_system.reading_of(grant).skips_grants_out_of_date",
        "_system and False",
    ),
    "grants out of date count": (Permissions, "_chosen", "if in_force:", "if True:"),
    "every grant of a document counts": (Permissions, "_chosen", "not in seen", "is not None"),
    "the last domain rule decides": (
        permission,
        "protection",
        "domain_rules.get(document, ())",
        "domain_rules.get(document, ())[::-1]",
    ),
    "the last topic rule decides": (
        permission,
        "protection",
        "topic_rules.get(number, ())",
        "topic_rules.get(number, ())[::-1]",
    ),
    "every topic rule counts": (permission, "protection", "result, hit,", "result, each.channels,"),
    "any certificate issues": (TrustDomainView, "vouched", "i.authority and", "True and"),
    "the revoked are authentic": (TrustDomainView, "_known", "certificate not in self._trust_domain.revoked", "True"),
    "no trust domain pins the signer": (TrustDomainView, "_may_sign", "self.reading.pins_signer", "False"),
    "every trust domain pins the signer": (TrustDomainView, "_may_sign", "self.reading.pins_signer", "True"),
    "one good signer is enough": (TrustDomainView, "accepted", "all(self._may_sign", "any(self._may_sign"),
    "a message without a signer is genuine": (TrustDomainView, "genuine", "and d.signers and", "and"),
    "chains have one step": (TrustDomainView, "_chained", "pending = issued - found", "pending = issued - issued"),
    "origins are never authenticated": (TrustDomainView, "_able", "& ~p.metadata_authenticates_origin", ""),
    "readers have no keys": (TrustDomainView, "_able", "(~p.data_authenticates | reads)", "~p.data_authenticates"),
    "relays read": (TrustDomainView, "_able", "reach & ~p.data_encrypts &", "reach &"),
    "who signs where the CA was not read is known": (
        TrustDomainView,
        "_signs_for_itself",
        "self._system.certificates[number].opaque",
        "False",
    ),
    "documents that were not read grant nothing": (TrustDomainView, "_held", "self._any_opaque", "False"),
    "announcements are truthful": (TrustDomainView, "_unasked", "truthful or", "True or"),
    "everybody believes announcements": (TrustDomainView, "_unasked", "not self.reading.asks_announced_only", "False"),
    "authorities issued no other certificates": (System, "anybody", "not self.assumed >= IDENTITIES", "False"),
    "there are no other documents": (System, "anything_granted", "not self.assumed >= DOCUMENTS", "False"),
    "robots enforce": (TrustDomainView, "__init__", "Assumption.ROBOTS_ENFORCE not in system.assumed", "False"),
    "only the identity itself signs": (
        TrustDomainView,
        "_signs_for_itself",
        "key in self.signing_keys",
        "self._system.enclaves[enclave].identity in self.signing_below",
    ),
    "who signs with a key of nobody here signs for nobody": (
        TrustDomainView,
        "_signed_elsewhere",
        "bool(self.signing_keys - self.authority_keys - self._system.holders().keys())",
        "False",
    ),
    "join access control is off": (TrustDomainView, "_joined_by", "~p.join_controlled", "-1"),
}
"""By what is wrong: where (a class or a module), the function, its text, and what stands in its place."""


@contextmanager
def mistaken(name: str) -> Iterator[None]:
    """The native engine with this mistake."""
    owner, attribute, old, new = MUTANTS[name]
    original = inspect.getattr_static(owner, attribute)
    function: Callable[..., Any] = original
    if isinstance(original, (cached_property, property)):
        function = original.func if isinstance(original, cached_property) else original.fget
    source = textwrap.dedent(inspect.getsource(function)).removeprefix("@cached_property\n").removeprefix("@property\n")
    assert source.count(old) == 1, f"{name}: {old!r} occurs {source.count(old)} times"
    space: dict[str, Any] = {}
    exec(compile(source.replace(old, new), f"<{name}>", "exec"), function.__globals__, space)
    changed: Any = space[attribute]
    if isinstance(original, cached_property):
        changed = cached_property(changed)
        changed.__set_name__(owner, attribute)
    elif isinstance(original, property):
        changed = property(changed)
    users = [owner] if inspect.isclass(owner) else [steps, permission, attacker]
    try:
        for user in users:
            if hasattr(user, attribute):
                setattr(user, attribute, changed)
        yield
    finally:
        for user in users:
            if hasattr(user, attribute):
                setattr(user, attribute, original)
