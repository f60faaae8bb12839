"""The Python interface: what programs may rely on between versions (docs/python-api.md)."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta, timezone
from pathlib import Path
from zoneinfo import ZoneInfo

from keystore_audit.arguments import check_arguments, check_ranges
from keystore_audit.errors import AuditError, NothingToAudit, UsageError
from keystore_audit.findings import Finding, Location, Severity
from keystore_audit.formats import FORMATS
from keystore_audit.formats import render as _render
from keystore_audit.model.trust.authorities import Authorities
from keystore_audit.options import DEFAULT_NOTICE, ENGINES, Options, user_files
from keystore_audit.pipeline import audit as _audit
from keystore_audit.report.content import EnclaveEntry, Report, Verdict

__all__ = [
    "AuditError",
    "EnclaveEntry",
    "Finding",
    "Location",
    "NothingToAudit",
    "Report",
    "Severity",
    "UsageError",
    "Verdict",
    "audit",
    "render",
]

PathLike = str | os.PathLike[str]


def audit(
    path: PathLike,
    *,
    at: datetime | None = None,
    profiles: Sequence[str] = (),
    domain: int | None = None,
    time_zone: str | ZoneInfo | None = None,
    engine: str = "auto",
    offline: bool = False,
    alloy_jar: PathLike | None = None,
    timeout: float = 120.0,
    fail_on: Severity | None = Severity.HIGH,
    expires_within: timedelta = DEFAULT_NOTICE,
    deployed: bool = False,
    select: Sequence[str] = (),
    ignore: Sequence[str] = (),
    expect_identity_ca: Sequence[PathLike] = (),
    expect_permissions_ca: Sequence[PathLike] = (),
    settings: PathLike | None = None,
    baseline: PathLike | None = None,
    policy: PathLike | None = None,
    policy_include: PathLike | None = None,
    environment: PathLike | None = None,
    graphs: Sequence[PathLike] = (),
    launches: Sequence[PathLike] = (),
    launch_arguments: Mapping[str, str] | None = None,
    alloy_properties: Sequence[PathLike] = (),
    roots: Sequence[PathLike] = (),
    pictures: bool = False,
) -> Report:
    """Audit the keystore at `path`, as `keystore-audit path` does; the arguments are its options.

    `at`: an aware instant, now if None; given at all, the report lists it as weakening the gate. `timeout`: seconds.
    `fail_on` None: never. No settings are looked for: `settings` names a file or there are none. `pictures`: work out
    what `render(report, "html")` draws.

    Whatever is wrong with the keystore or an engine is in the report: `report.verdict` is what to go by. Raises
    NothingToAudit where there is no keystore, UsageError for arguments or files that make no sense, and AuditError for
    a damaged installation.
    """
    check_arguments(locals())
    from keystore_audit.model.local_time import time_zone as zone_named
    from keystore_audit.rules.registry import rule_code
    from keystore_audit.settings.authorities import expected
    from keystore_audit.settings.settings import read_baseline, read_settings

    if engine not in ENGINES:
        raise UsageError(f"{engine!r} is no engine; there are {', '.join(ENGINES)}.")
    if at is not None and at.tzinfo is None:
        raise UsageError(f"The instant {at} has no time zone: give it one, e.g. timezone.utc.")
    check_ranges(at, timeout, expires_within, domain)
    if policy_include is not None and policy is None:
        raise UsageError("policy_include is for the files that a policy includes, and there is no policy.")
    asserted = None if settings is None else read_settings(Path(settings), (os.fspath(path),))
    options = Options(
        at=(at or datetime.now(timezone.utc)).astimezone(timezone.utc).replace(microsecond=0),
        at_given=at is not None,
        profiles=tuple(profiles),
        domain=domain,
        time_zone=zone_named(time_zone) if isinstance(time_zone, str) else time_zone,
        engine=engine,
        offline=offline,
        alloy_jar=_path(alloy_jar),
        timeout=timeout,
        fail_on=fail_on,
        expires_within=expires_within,
        deployed=deployed,
        select=tuple(map(rule_code, select)),
        ignore=tuple(map(rule_code, ignore)),
        authorities=expected(
            asserted.authorities if asserted is not None else Authorities(),
            [os.fspath(each) for each in expect_identity_ca],
            [os.fspath(each) for each in expect_permissions_ca],
            (os.fspath(path),),
        ),
        settings=asserted,
        baseline=None if baseline is None else read_baseline(Path(baseline), (os.fspath(path),)),
        policy=_path(policy),
        policy_include=_path(policy_include),
        environment=_path(environment),
        graphs=tuple(map(Path, graphs)),
        launches=tuple(map(Path, launches)),
        launch_arguments=dict(launch_arguments or {}),
        alloy_properties=user_files(tuple(map(Path, alloy_properties)), asserted, (os.fspath(path),)),
        roots=tuple(map(Path, roots)),
        overview=pictures,
    )
    return _audit(path, options)


def render(report: Report, form: str = "json") -> str:
    """Return the report in a format of the command's `--format`; raise UsageError for one that there is not."""
    from keystore_audit.report.text import PLAIN

    if form not in FORMATS:
        raise UsageError(f"{form!r} is no format; there are {', '.join(FORMATS)}.")
    return _render(form, [report], PLAIN, several=False)


def _path(given: PathLike | None) -> Path | None:
    return None if given is None else Path(given)
