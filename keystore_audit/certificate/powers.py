"""What participants can do, as peers of one trust domain see them (docs/model.md), and which lines refuse the rest."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta
from functools import cache
from typing import Final

from msgspec import Struct

from keystore_audit.certificate.documents import DomainRule, Domains, Grant, Permissions, Rule, TopicRule
from keystore_audit.certificate.errors import CannotTell
from keystore_audit.certificate.kinds import Row
from keystore_audit.certificate.names import Expressions
from keystore_audit.certificate.reading import Enclave, Store

OUTSIDER: Final = "outsider"
"""Somebody on the network, without any key."""

CERTIFIED: Final = "anybody certified"
"""Somebody for whom the identity CA vouches, with a subject that no grant names."""

_ANY_ZONE: Final = timedelta(hours=14)


class Name(Struct, frozen=True):
    """A class of names by one of them. `ends`: the expressions that match the topic.

    In the default partition, since no document names one. So a right elsewhere is a right there too, by a partition
    that is a pattern.
    """

    domain: int
    topic: str
    ends: int


class Because(Struct, frozen=True):
    """A line that refuses: `rule` says how. `document`: its file."""

    rule: str
    document: str
    line: int


class Powers(Struct, frozen=True):
    """What somebody can do on a channel: by right; to overhear and forge, to attack. `own_*`: as far as its own
    implementation lets it.
    """

    writes: bool = False
    reads: bool = False
    overhears: bool = False
    forges: bool = False
    own_writes: bool = False
    own_reads: bool = False


class Peers:
    """One trust domain: enclaves with equal authorities and governance, as an implementation has it at an instant.

    `truthful`: whether everybody announces endpoints truthfully.
    """

    def __init__(
        self, store: Store, members: Sequence[Enclave], expressions: Expressions, row: Row, at: datetime, truthful: bool
    ) -> None:
        self.members = {each.path for each in members}
        self.first = members[0]
        self._store, self._row, self._at, self._truthful = store, row, at, truthful
        self._expressions = expressions
        self._enclaves = {each.path: each for each in store.enclaves}
        self._own = {each.identity.fingerprint for each in store.enclaves}
        self._vouched = self._under(self.first.identity_ca.fingerprint)
        signers = {self.first.permissions_ca.fingerprint}
        self._below = set[str]() if self._row.pins_signer else self._under(*signers) - signers
        signers |= self._below
        self._accepted = [each for each in store.permissions if each.signer in signers]
        named = {grant.subject for document in store.permissions for grant in document.grants}
        here = {each.identity.subject for each in store.enclaves if self.known(each.path)}
        self.elsewhere = sorted(named - here)
        """Subjects of grants that no enclave has whom these peers take: others may have them."""
        self.powers, self.rules, self.refusals = cache(self._powers), cache(self._rules), cache(self._refusals)
        self._grants = cache(self._grants_of)

    def _under(self, authority: str) -> set[str]:
        return {below for above, below in self._store.issued if above == authority}

    def _identities(self, who: str) -> set[str]:
        """The certificate of an enclave; for holders elsewhere, all that the identity CA issued stand for theirs."""
        return {self._enclaves[who].identity.fingerprint} if who in self._enclaves else self._vouched

    def grants_itself(self, who: str) -> bool:
        """Whether somebody signs its own permissions and peers accept them; any other signer may do it for it."""
        return not self._below.isdisjoint(self._identities(who)) or not self._below <= self._own

    def known(self, who: str) -> bool:
        """Whether the identity CA vouches for somebody."""
        return self._identities(who) <= self._vouched

    def entitled(self, who: str, name: Name) -> bool:
        """Whether all that somebody reads there it reads by a grant of the permissions CA itself.

        If its own implementation takes such a right away, it reads nothing, which does no harm.
        """
        topic, powers = self.rules(name)[1], self.powers(who, name, True)
        asked = topic and topic.read and powers.reads and not powers.overhears
        return bool(asked) and {each.signer for each, _grant in self._grants(who)} == {
            self.first.permissions_ca.fingerprint
        }

    def _rules(self, name: Name) -> tuple[DomainRule | None, TopicRule | None]:
        """What governs the channel."""
        domain = next((each for each in self.first.governance.rules if _within(name.domain, each.domains)), None)
        under = domain.topics if domain else ()
        return domain, next((each for each in under if self._expressions.ends[each.expression] & name.ends), None)

    def _powers(self, who: str, name: Name, attacks: bool) -> Powers:
        """The powers of a participant, as anybody on the network and by its keys and rights."""
        domain, topic = self.rules(name)
        if domain is None or topic is None:
            return Powers()
        clear = [not kind.startswith("ENCRYPT") for kind in (topic.metadata, topic.data, domain.rtps)]
        made = topic.metadata == topic.data == "NONE"
        overhears, forges = all(clear), made and (domain.unauthenticated or domain.rtps == "NONE")
        if who == OUTSIDER or not self.known(who):
            return Powers(attacks and made and domain.unauthenticated, overhears=overhears, forges=forges)
        reads = writes = False
        anything, grants = attacks and self.grants_itself(who), [grant for _document, grant in self._grants(who)]
        if anything or self._joins(who, grants, name.domain, domain):
            anything = anything or (attacks and self._row.trusts_declarations and not self._truthful)
            reads = anything or not topic.read or self._may("subscribe", name, grants)
            writes = anything or not topic.write or self._may("publish", name, grants)
            origin = topic.metadata.endswith("ORIGIN_AUTHENTICATION")
            relays = self._row.honours_default and any(each.allow for each in grants)
            overhears = overhears or anything or (clear[1] and (clear[0] or relays))
            forges = forges or (not origin and (reads or made or (relays and topic.data == "NONE")))
        own_reads = own_writes = False
        if who in self.members:  # by its own document, which its own implementation alone asks
            own = [grant for document, grant in self._grants(who) if document == self._enclaves[who].permissions]
            own_reads = not topic.read or self._may("subscribe", name, own, own=True)
            own_writes = not topic.write or self._may("publish", name, own, own=True)
        return Powers(writes, reads, overhears, forges, writes or own_writes, reads or own_reads)

    def _joins(self, who: str, grants: Sequence[Grant], domain: int, rule: DomainRule) -> bool:
        if not rule.join and (grants or who == CERTIFIED or not self._row.requires_grant):
            return True
        return any(
            (self._row.honours_default and grant.allow)
            or any(each.allow and _within(domain, each.domains) for each in grant.rules)
            for grant in grants
        )

    def _may(self, operation: str, name: Name, grants: Sequence[Grant], *, own: bool = False) -> bool:
        """Whether a grant allows it here, or in a partition that is a pattern and meets this one."""
        binds = self._row.binds_domains or not own
        return any(self._decided(operation, name, each, binds, here)[0] for each in grants for here in (True, False))

    def _decided(
        self, operation: str, name: Name, grant: Grant, binds: bool, default: bool = True
    ) -> tuple[bool, Rule | None]:
        """What the grant decides in the default partition or in any other, and by which rule, if any."""
        for rule in grant.rules:
            if binds and not _within(name.domain, rule.domains):
                continue
            if not any(self._expressions.ends[each] & name.ends for each in getattr(rule, operation)):
                continue
            if default:
                return rule.allow, rule
            if self._row.partitions == "of-the-first-rule" or (
                not rule.allow and self._row.partitions == "of-the-criterion"
            ):
                return False, rule
        return grant.allow and self._row.honours_default, None

    def _chosen(self, document: Permissions, subject: str) -> Iterator[Grant]:
        """The grant of the document that counts for the subject, if any."""
        for grant in document.grants:
            if self._names(grant.subject, subject):
                force = self._in_force(grant)
                if force:
                    yield grant
                if force or not self._row.skips_grants_out_of_date:
                    return

    def _names(self, grant: str, subject: str) -> bool:
        if not self._row.subjects.startswith("pieces-within"):
            return grant == subject
        pieces, wanted = ({each.removesuffix("=") for each in text.split("/")} for text in (grant, subject))
        return wanted <= pieces

    def _in_force(self, grant: Grant) -> bool:
        """Whether it is in force, whatever zone the robot is in."""
        early, late = self._at - _ANY_ZONE, self._at + _ANY_ZONE
        if grant.start <= early and late <= grant.end:
            return True
        if late < grant.start or grant.end < early:
            return False
        raise CannotTell(f"a grant for {grant.subject} begins or ends within 14 hours of the instant")

    def _grants_of(self, who: str) -> list[tuple[Permissions, Grant]]:
        """The grants that count for an enclave, or a subject elsewhere: peers take whatever document it presents."""
        subject = self._enclaves[who].identity.subject if who in self._enclaves else who
        return [(each, grant) for each in self._accepted for grant in self._chosen(each, subject)]

    def _refusals(self, who: str, name: Name, *operations: str) -> tuple[Because, ...]:
        """The lines that refuse somebody the operations there."""
        domain, topic = self.rules(name)
        path = self.first.governance.path
        if topic is None:
            return (self._because("ungoverned", path, domain),)
        protected = tuple(self._because("protection", path, each) for each in (domain, topic))
        if who == OUTSIDER:
            return protected
        if not self.known(who):
            return (*protected, Because("not vouched for", self.first.identity_ca.path, 1))
        found = dict.fromkeys(
            self._because("rule" if rule else "default", document.path, rule or grant)
            for document, grant in self._grants(who)
            for _allows, rule in (self._decided(each, name, grant, binds=True) for each in operations)
        )
        return (*protected, *(found or (self._because("no grant", path, domain),)))

    def _because(self, rule: str, path: str, at: DomainRule | TopicRule | Rule | Grant | None) -> Because:
        return Because(rule, path, at.line if at is not None else 1)


def _within(domain: int, domains: Domains) -> bool:
    return any(low <= domain <= high for low, high in domains)
