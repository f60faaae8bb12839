"""Whether a grant has an effect: who accepts a finding about one that has none does not accept that it gets one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from functools import cached_property
from hashlib import sha256

from keystore_audit.keystore.governance import Text
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.permissions import Grant
from keystore_audit.model.domains import HIGHEST_DOMAIN, covered, domain_bits
from keystore_audit.model.permission import union
from keystore_audit.model.validity import DateReading, read_date
from keystore_audit.rules.subjects import governance_uses


def instant_of(date: Text) -> datetime | None:
    """The instant that a date of a grant names to the specification, None for years that nobody reads.

    Where implementations read another one, date-read-differently and date-not-portable say so.
    """
    dated = read_date(date.text, DateReading.XSD, None)
    return dated.instant if dated is not None else None


class Effects:
    """What the effect of grants rests on besides what they say, in one keystore `at` an instant (aware UTC)."""

    def __init__(self, keystore: Keystore, at: datetime) -> None:
        self._keystore = keystore
        self._at = at

    def of(self, grants: Sequence[Grant]) -> Iterator[str]:
        """For each grant of a document: whether it is in force, in which governed domains it allows anything, and
        which grants stand before it, since the first that names somebody may be the only one that counts.
        """
        before = ""
        for grant in grants:
            in_force = self._in_force(grant)
            yield f"{in_force} {self._allowed(grant) & self._governed:x} {before}"
            before = sha256(
                f"{before}\0{in_force}\0{grant.subject_name.text}".encode("utf-8", "surrogatepass")
            ).hexdigest()

    def _in_force(self, grant: Grant) -> bool:
        start, end = instant_of(grant.not_before), instant_of(grant.not_after)
        return start is not None and end is not None and start <= self._at <= end

    @staticmethod
    def _allowed(grant: Grant) -> int:
        """The domains in which it allows anything, as a bit set."""
        if grant.default_allow:
            return domain_bits([(0, HIGHEST_DOMAIN)])
        return union(domain_bits(covered(rule.domains)) for rule in grant.rules if rule.allow)

    @cached_property
    def _governed(self) -> int:
        """The domains that a governance covers which an enclave carries and somebody may take."""
        taken = (use.document.governance for use in governance_uses(self._keystore) if use.may_be_taken)
        rules = (rule for governance in taken if governance is not None for rule in governance.domain_rules)
        return union(domain_bits(covered(rule.domains)) for rule in rules)
