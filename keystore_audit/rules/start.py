"""KA1: enclaves that do not start, for reasons that no other rule has spoken of."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from keystore_audit.findings import Location, Severity
from keystore_audit.model.participants.joining import UNGRANTED
from keystore_audit.model.participants.sight import UNLOADED
from keystore_audit.model.participants.usability import UNGOVERNED
from keystore_audit.profiles import VARIANTS, implementations
from keystore_audit.remedy import decision
from keystore_audit.rules.context import Context
from keystore_audit.rules.governance import COVER_DOMAIN
from keystore_audit.rules.permissions import ALLOW_DOMAINS
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.remedies import RENEW_AUTHORITY
from keystore_audit.rules.subjects import Refusal


@rule(
    "KA117",
    Severity.HIGH,
    clause="DDS-Security 1.1, 8.2.1 and 9.4.3 (a participant is created only with valid credentials); measured",
    remedy=decision(
        "Make of what the message names what every implementation takes, and sros2 makes: keys on "
        "prime256v1, certificates and documents signed over SHA-256, one self-signed certificate in each CA "
        "file."
    ),
)
def enclave_does_not_start(refusal: Refusal, _context: Context) -> Iterator[Violation]:
    """An implementation creates no participant for the enclave, and no finding of high severity says why.

    The last net: what other rules call medium, or have no words for, is no pass where a robot would stand still. The
    reasons are those of the report's table of enclaves.
    """
    for reasons, names in refusal.profiles.items():
        who = implementations(VARIANTS[name] for name in names)
        yield Violation(
            message=f"{refusal.enclave.path} does not start under {who}: {'; '.join(reasons)}.",
            locations=(Location(path=refusal.enclave.files.directory),),
            enclave=refusal.enclave.path,
            profiles=names,
            key="\0".join(reasons),
            remedy=next((_BY_REASON[begins] for begins in _BY_REASON if _all_begin(reasons, begins)), None),
        )


_BY_REASON: Final = {UNGOVERNED: COVER_DOMAIN, (UNGRANTED,): ALLOW_DOMAINS, UNLOADED: RENEW_AUTHORITY}


def _all_begin(reasons: Sequence[str], begins: tuple[str, ...]) -> bool:
    return all(reason.startswith(begins) for reason in reasons)
