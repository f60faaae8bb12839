"""Which domains the governances of a keystore cover."""

from __future__ import annotations

from collections.abc import Iterable

from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.domains import Interval, merged
from keystore_audit.model.inventory import Typed
from keystore_audit.model.profiles import Profile


def governed_domains(
    files: Iterable[Typed], profiles: Iterable[Profile], accesses: AccessViews
) -> tuple[Interval, ...]:
    """The domains that some governance among the files covers as one of the profiles reads it, ascending and apart."""
    rows = dict.fromkeys(accesses.row(profile.access) for profile in profiles)
    read = [accesses.read(file, row) for file in files for row in rows]
    return merged({each for document in read for rule in document.domain_rules or () for each in rule.domains})


def default_domain(governed: tuple[Interval, ...]) -> int:
    """The one that is shown where none is named: the lowest of these, 0 where there is none."""
    return governed[0][0] if governed else 0
