"""Small pieces that rules share: places, enclave names and defects as violations."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.defect import Defect, Kind
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.model.profiles import VARIANTS, Profile
from keystore_audit.model.trust import Verdict, document_verdict
from keystore_audit.rules.registry import Violation
from keystore_audit.rules.subjects import DocumentUse


def sole(enclaves: tuple[Enclave, ...]) -> str | None:
    """The enclave's path where only one is concerned."""
    return enclaves[0].path if len(enclaves) == 1 else None


def of_kinds(defects: tuple[Defect, ...], kinds: Collection[Kind]) -> Iterator[Defect]:
    """The defects of these kinds, in order."""
    return (defect for defect in defects if defect.kind in kinds)


def from_defect(
    defect: Defect, enclaves: tuple[Enclave, ...], *, undecided: bool, severity: Severity | None = None
) -> Violation:
    """The violation that a defect of a file used by `enclaves` is."""
    return Violation(
        message=defect.detail,
        locations=(Location(path=defect.path, line=defect.line),),
        enclave=sole(enclaves),
        severity=severity,
        undecided=undecided,
        key=f"{defect.kind.value} {defect.detail}",
    )


def acceptable(use: DocumentUse) -> bool:
    """Whether some known implementation may accept the document in some enclave that carries it.

    Where none may, what its XML says is of no consequence: nobody reads it.
    """
    return any(
        document_verdict(use.signed, enclave.permissions_ca, pins_signer=pins_signer) is not Verdict.REFUSED
        for enclave in use.enclaves
        for pins_signer in (True, False)
    )


def implementations(profiles: Collection[Profile]) -> str:
    """`Cyclone DDS 0.10 (humble, jazzy, kilted)`: for people."""
    return ", ".join(
        f"{profile.title} ({', '.join(profile.distributions)})" if profile.distributions else profile.title
        for profile in profiles
    )


def unpinned() -> tuple[Profile, ...]:
    """Every known variant that takes documents from any signer that chains to the permissions CA."""
    return tuple(profile for profile in VARIANTS.values() if not profile.pins_signer)


def pinned() -> tuple[Profile, ...]:
    """Every known variant that takes documents from the permissions CA alone."""
    return tuple(profile for profile in VARIANTS.values() if profile.pins_signer)
