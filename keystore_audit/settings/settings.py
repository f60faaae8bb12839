"""Users' settings, `keystore-audit.toml`: what they assert of their keystore (docs/settings.md)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final

from msgspec import Struct, field

from keystore_audit.assumptions import Assumption, Declaration
from keystore_audit.errors import UsageError
from keystore_audit.given import GivenFile
from keystore_audit.keystore.foreign import DeclaredFiles
from keystore_audit.model.claims.forwards import Declared, Determinism
from keystore_audit.model.claims.stated import Claim, Labelling
from keystore_audit.model.trust.authorities import Authorities
from keystore_audit.profiles import in_scope
from keystore_audit.settings.acceptances import read_accepted, read_suppressions
from keystore_audit.settings.authorities import read_authorities
from keystore_audit.settings.claims import read_properties
from keystore_audit.settings.files import read_files
from keystore_audit.settings.labels import KEYS as LABEL_KEYS
from keystore_audit.settings.labels import read_labels, read_single_writers
from keystore_audit.settings.suppressions import MAX_DAYS, Acceptance
from keystore_audit.settings.table import Table, read_table
from keystore_audit.text import meant

MAX_BYTES: Final = 1_000_000
"""A settings file is written by people."""

MAX_BASELINE_BYTES: Final = 10_000_000
"""Of a baseline, which is written by this program: 20,000 findings."""

MOST_DAYS: Final = 3650
"""Of `max_suppression_days`: ten years, after which nobody knows why."""


class Settings(Struct, frozen=True, kw_only=True):
    """What a settings file says.

    `claims`: all that it asserts, what `labels` and single writers come to among it.
    `acceptances` may last so many days from the audit instant.
    """

    file: GivenFile
    authorities: Authorities = Authorities()
    claims: tuple[Claim, ...] = ()
    labels: Labelling | None = None
    declared: Declared = field(default_factory=Declared)
    acceptances: tuple[Acceptance, ...] = ()
    max_suppression_days: int = MAX_DAYS
    files: DeclaredFiles = DeclaredFiles()
    assumptions: Mapping[Assumption, Declaration] = field(default_factory=dict)
    """What somebody declared of what is taken for granted."""

    scope: tuple[str, ...] = ()
    """The variants that a gate is to judge under, by name; none: it does not say."""

    @property
    def lasting(self) -> tuple[str, ...]:
        """The properties that are about a time, by id."""
        return tuple(claim.id for claim in self.claims if claim.until is not None)

    @property
    def asserted(self) -> tuple[Claim | Determinism, ...]:
        """All properties, each with an id of its own."""
        return (*self.claims, *self.declared.claims)


class Baseline(Struct, frozen=True, kw_only=True):
    """Findings that were accepted one by one."""

    file: GivenFile
    acceptances: tuple[Acceptance, ...] = ()


def read_settings(path: Path, keystores: Iterable[str | Path]) -> Settings:
    """The settings in the file at `path`.

    Raises errors.UsageError, with line and column, for what is no settings file; and for one that lies in one of the
    `keystores`, which could then absolve itself.
    """
    file = read_table(path, keystores, MAX_BYTES)
    root = file.root
    keys = ("property", "forward", *LABEL_KEYS, "suppression", "max_suppression_days")
    root.only(*keys, "assumption", "authorities", "files", "scope")
    labels = read_labels(root)
    claims, declared = read_properties(root)
    return Settings(
        file=file.given,
        authorities=read_authorities(root),
        claims=_unique((*claims, *(labels.claims() if labels else ()), *read_single_writers(root)), declared),
        labels=labels,
        declared=declared,
        acceptances=read_suppressions(root),
        files=read_files(root),
        scope=_scope(root),
        max_suppression_days=root.number("max_suppression_days", MAX_DAYS, 1, MOST_DAYS),
        assumptions=dict(_assumptions(root)),
    )


def _scope(root: Table) -> tuple[str, ...]:
    """The variants of `[scope]`, by what the distributions ship and the middleware runs on."""
    if "scope" not in root.values:
        return ()
    table = root.table("scope")
    table.only("distro", "rmw")
    distributions, middleware = (table.texts(key) if key in table.values else () for key in ("distro", "rmw"))
    try:
        return in_scope(distributions, middleware, ())
    except UsageError as error:
        table.wrong(None, error.message)


def _assumptions(root: Table) -> Iterator[tuple[Assumption, Declaration]]:
    """What somebody takes upon himself; nothing that is not assumed anyhow."""
    names = [each.value for each in Assumption]
    for table in root.tables("assumption"):
        table.only("name", "owner", "reason")
        name = table.text("name")
        if name not in names:
            table.wrong("name", f"expected one of {', '.join(names)}{meant(name, names, '; did you mean {!r}')}")
        yield Assumption(name), Declaration(owner=table.text("owner"), reason=table.text("reason"))


def read_baseline(path: Path, keystores: Iterable[str | Path]) -> Baseline:
    """The baseline in the file at `path`; raises errors.UsageError as `read_settings` does."""
    file = read_table(path, keystores, MAX_BASELINE_BYTES)
    root = file.root
    root.only("accepted")
    return Baseline(file=file.given, acceptances=read_accepted(root))


def _unique(claims: tuple[Claim, ...], declared: Declared) -> tuple[Claim, ...]:
    """The claims; raises errors.UsageError where two have one name, as labels may make them.

    What two labels make has a name of its own in reports, beside those of the claims.
    """
    seen: dict[str, tuple[object, str]] = {claim.id: (claim.id, claim.place) for claim in declared.claims}
    for number, claim in enumerate(claims):
        names: list[tuple[str, object]] = [(claim.id, number)]
        if claim.labels is not None:
            names.append((claim.labels.id, (claim.labels.source, claim.labels.target)))
        for name, what in names:
            other, at = seen.setdefault(name, (what, claim.place))
            if other != what:
                raise UsageError(f"{claim.place}: this makes the property {name!r}, which is at {at} too.")
    return claims
