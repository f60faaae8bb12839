"""The Python interface: what programs may rely on between versions (docs/python-api.md)."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Annotated, Any, Final
from zoneinfo import ZoneInfo

from msgspec import Meta, Struct, ValidationError, convert
from msgspec.structs import asdict

from keystore_audit.errors import AuditError, NothingToAudit, UsageError
from keystore_audit.findings import Finding, Location, Severity
from keystore_audit.formats import FORMATS
from keystore_audit.formats import render as _render
from keystore_audit.options import (
    DEFAULT_NOTICE,
    ENGINES,
    FIRST_YEAR,
    LAST_DOMAIN,
    LAST_YEAR,
    MAX_DAYS,
    MAX_SECONDS,
    options_of,
)
from keystore_audit.pipeline import audit as _audit
from keystore_audit.report.content import PLAIN, EnclaveEntry, Report, Verdict

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

_File = Annotated[str, Meta(pattern="^[^\0\ud800-\udc7f\udd00-\udfff]*\\Z")]
"""A path that a file can have; bytes that are no UTF-8 are surrogates of their own (PEP 383)."""

_PATHS: Final = (
    "alloy_jar", "baseline", "policy", "policy_include", "environment", "network", "graphs", "launches",
    "alloy_properties", "roots",
)  # fmt: skip
"""Arguments that are files and directories."""


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
    network: PathLike | None = None,
    graphs: Sequence[PathLike] = (),
    launches: Sequence[PathLike] = (),
    launch_arguments: Mapping[str, str] | None = None,
    launch_complete: bool = False,
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
    given = _checked(locals())
    from keystore_audit.model.validity import time_zone as zone_named
    from keystore_audit.rules.registry import rule_code
    from keystore_audit.settings.settings import read_settings

    if given["policy_include"] is not None and policy is None:
        raise UsageError("policy_include is for the files that a policy includes, and there is no policy.")
    keystores = (given["path"],)
    return _audit(
        path,
        options_of(
            given
            | {
                "time_zone": zone_named(time_zone) if isinstance(time_zone, str) else time_zone,
                "select": tuple(map(rule_code, select)),
                "ignore": tuple(map(rule_code, ignore)),
                "identity_cas": given["expect_identity_ca"],
                "permissions_cas": given["expect_permissions_ca"],
                "launch_arguments": dict(launch_arguments or {}),
                "overview": pictures,
                **{name: _paths(given[name]) for name in _PATHS},
            },
            keystores,
            None if settings is None else read_settings(Path(given["settings"]), keystores),
        ),
    )


def render(report: Report, form: str = "json") -> str:
    """Return the report in a format of the command's `--format`; raise UsageError for one that there is not."""
    if form not in FORMATS:
        raise UsageError(f"{form!r} is no format; there are {', '.join(FORMATS)}.")
    return _render(form, [report], PLAIN, several=False)


class _Arguments(Struct, kw_only=True):
    """What the arguments of `audit` have to be, paths as texts; ranges are those of the command line."""

    path: _File
    at: Annotated[datetime, Meta(tz=True)] | None
    profiles: tuple[str, ...]
    domain: Annotated[int, Meta(ge=0, le=LAST_DOMAIN)] | None
    time_zone: Any
    engine: str
    offline: bool
    alloy_jar: _File | None
    timeout: Annotated[float, Meta(gt=0, le=MAX_SECONDS)]
    fail_on: Any
    expires_within: timedelta
    deployed: bool
    select: tuple[str, ...]
    ignore: tuple[str, ...]
    expect_identity_ca: tuple[_File, ...]
    expect_permissions_ca: tuple[_File, ...]
    settings: _File | None
    baseline: _File | None
    policy: _File | None
    policy_include: _File | None
    environment: _File | None
    network: _File | None
    graphs: tuple[_File, ...]
    launches: tuple[_File, ...]
    launch_arguments: dict[str, str] | None
    launch_complete: bool
    alloy_properties: tuple[_File, ...]
    roots: tuple[_File, ...]
    pictures: bool


def _checked(given: Mapping[str, Any]) -> dict[str, Any]:
    """The arguments. Raises UsageError for one that is not what it has to be; a text is no sequence of names.

    The values are not told: who calls knows them.
    """
    texts = {name: _text(each) for name, each in given.items()}
    try:
        found = convert(texts, _Arguments, builtin_types=(datetime, timedelta))
    except ValidationError as error:
        message, _, name = str(error).removesuffix("`").partition(" - at `$.")
        if "regex" in message:
            message = "A path holds a NUL character or half of a surrogate pair: no file can have it"
        raise UsageError(f"{name}: {message}.") from error
    for name, kinds in (("time_zone", str | ZoneInfo | None), ("fail_on", Severity | None)):
        if not isinstance(given[name], kinds):
            raise UsageError(f"{name}: Expected `{kinds}`, got `{type(given[name]).__name__}`.")
    if found.engine not in ENGINES:
        raise UsageError(f"{found.engine!r} is no engine; there are {', '.join(ENGINES)}.")
    if found.at is not None and not FIRST_YEAR <= found.at.year <= LAST_YEAR:
        raise UsageError(f"The instant {found.at} is not between the years {FIRST_YEAR} and {LAST_YEAR}.")
    if not timedelta(0) <= found.expires_within <= timedelta(days=MAX_DAYS):
        raise UsageError(f"A notice of {found.expires_within} is not between 0 and {MAX_DAYS} days.")
    return asdict(found)


def _text(given: Any) -> Any:
    """A path, or those of a collection, as texts; whatever else as it is."""
    if isinstance(given, os.PathLike):
        return os.fspath(given)
    return [*map(_text, given)] if isinstance(given, list | tuple | set | frozenset) else given


def _paths(given: str | tuple[str, ...] | None) -> Path | tuple[Path, ...] | None:
    if given is None:
        return None
    return Path(given) if isinstance(given, str) else tuple(map(Path, given))
