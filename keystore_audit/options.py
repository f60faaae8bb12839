"""What an audit is asked, and who is told how far it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

from msgspec import Struct, field
from msgspec.structs import replace

from keystore_audit.assumptions import Assumption
from keystore_audit.findings import Severity

if TYPE_CHECKING:
    from zoneinfo import ZoneInfo

    from keystore_audit.engine.alloy.user_file import UserFile
    from keystore_audit.keystore.foreign import DeclaredFiles
    from keystore_audit.model.trust.chain import Authorities
    from keystore_audit.settings.settings import Baseline, Settings

ENGINES: Final = ("auto", "both", "alloy", "native")
"""Who may decide: `engine.engines`."""

LAST_DOMAIN: Final = 232
"""DDS domains are 0 to 232: beyond, the port number of RTPS 2.2 (9.6.1.1) does not fit into 16 bits."""

FIRST_YEAR: Final = 1950
"""X.509's first (RFC 5280, 4.1.2.5.1)."""

LAST_YEAR: Final = 9800
"""X.509's last is 9999 (RFC 5280, 4.1.2.5); the notice for expiry must stay within what a date can hold."""

MAX_DAYS: Final = 36500
"""Of notice for expiry: 100 years, as long as the certificates of a robot that is meant to outlive its makers."""

MAX_SECONDS: Final = 86400.0
"""For the solver: a day."""

DEFAULT_NOTICE = timedelta(days=30)
"""How long before it ends a validity is a finding."""


def user_files(paths: Sequence[Path], settings: Settings | None, keystores: Sequence[str]) -> tuple[UserFile, ...]:
    """The users' files in Alloy, whose ids differ from those of the settings. Raises errors.UsageError."""
    if not paths:
        return ()
    from keystore_audit.engine.alloy.user_file import read_user_files

    return read_user_files(paths, settings.asserted if settings else (), keystores)


def declared_files(settings: Settings | None, roots: Sequence[Path]) -> DeclaredFiles:
    """What settings declare of a keystore's files, with further directories that links may lead into."""
    from keystore_audit.keystore.foreign import NOTHING_DECLARED  # with what reads keystores: `--help` needs none

    declared = settings.files if settings is not None else NOTHING_DECLARED
    return replace(declared, roots=tuple(map(str, roots)))


def options_of(given: Mapping[str, Any], keystores: Sequence[str], settings: Settings | None) -> Options:
    """What is asked of the keystores: `given` has, by the names of `Options`, what users say.

    Beside those, `identity_cas` and `permissions_cas` as users write authorities; `baseline` and `alloy_properties` are
    paths there. Raises errors.UsageError for files that are none.
    """
    from keystore_audit.model.trust.chain import Authorities

    authorities, baseline = settings.authorities if settings is not None else Authorities(), None
    if given["identity_cas"] or given["permissions_cas"] or given["baseline"] is not None:
        from keystore_audit.settings.settings import expected, read_baseline  # most audits have none of these

        authorities = expected(authorities, given["identity_cas"], given["permissions_cas"], keystores)
        baseline = None if given["baseline"] is None else read_baseline(given["baseline"], keystores)
    made = {
        "at": (given["at"] or now()).astimezone(timezone.utc).replace(microsecond=0),
        "at_given": given["at"] is not None,
        "authorities": authorities,
        "settings": settings,
        "baseline": baseline,
        "alloy_properties": user_files(given["alloy_properties"], settings, keystores),
    }
    return Options(**{name: given[name] for name in Options.__struct_fields__ if name in given} | made)


def now() -> datetime:
    """Return this instant, whole seconds, UTC: the one place where the program asks the clock."""
    return datetime.now(timezone.utc).replace(microsecond=0)


class Progress(Protocol):
    """Told how far an audit is."""

    def stage(self, name: str) -> None:
        """A new stage begins."""

    def enclaves(self, done: int, total: int) -> None:
        """So many enclaves are read."""


class Options(Struct, frozen=True, kw_only=True):
    """What an audit is asked (interface contract: docs/reference.md).

    `at` is aware UTC; `fail_on` None: never. `launch_arguments`: values of arguments of the launch files.
    `launch_complete`: whether what these leave open leaves the audit open. `overview`: whether the report is to hold
    what pictures show.
    """

    at: datetime
    at_given: bool = False
    profiles: tuple[str, ...] = ()
    domain: int | None = None
    time_zone: ZoneInfo | None = None
    not_assumed: tuple[Assumption, ...] = ()
    policy: Path | None = None
    policy_include: Path | None = None
    """The directory below which the policy may include files; None: its own."""
    engine: str = "auto"
    offline: bool = False
    alloy_jar: Path | None = None
    timeout: float = 120.0
    fail_on: Severity | None = Severity.HIGH
    expires_within: timedelta = DEFAULT_NOTICE
    deployed: bool = False
    select: tuple[str, ...] = ()
    ignore: tuple[str, ...] = ()
    authorities: Authorities | None = None
    """Those that settings or options declare."""
    settings: Settings | None = None
    settings_passed_over: str = ""
    """That settings lay where they are looked for and were not used, and why."""
    baseline: Baseline | None = None
    network: Path | None = None
    """The folder of the files that processes of the middleware that routes start with."""
    environment: Path | None = None
    """The file of variables that the robots start with: profile and domain are taken from it where not given."""
    graphs: tuple[Path, ...] = ()
    launches: tuple[Path, ...] = ()
    launch_arguments: Mapping[str, str] = field(default_factory=dict)
    launch_complete: bool = False
    alloy_properties: tuple[UserFile, ...] = ()
    overview: bool = False
    roots: tuple[Path, ...] = ()
    """Further directories that links of the keystore may lead into."""

    @property
    def files(self) -> DeclaredFiles:
        """What is declared of the keystore's files, with further directories."""
        return declared_files(self.settings, self.roots)
