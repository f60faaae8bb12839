"""A main file about time: what ends and what begins with the dates of a keystore, and which claims hold always.

For the Analyzer's window, and for the tests: the audit itself asks about each later moment with static facts
(`moments`), which is cheaper. Measured on a talker, a listener and a third enclave: 1.8 s for five checks of nine
moments each, against 0.3 s for an audit of one moment.
"""

from __future__ import annotations

from typing import Final

from msgspec.structs import replace

from keystore_audit.engine.alloy import claims, moments
from keystore_audit.model.formal.claim import ClaimKind
from keystore_audit.model.formal.system import System

MODULE: Final = "expiry.als"
"""The hand-written module, which opens those of the claims."""

MAIN: Final = "expiry_audit.als"
"""The generated main file."""

ASSERTIONS: Final = (
    "AuthoritiesOutliveIdentities",
    "IdentitiesStayVouchedFor",
    "SignersStayInForce",
    "NoRightBegins",
    "NoRightEnds",
)
"""The assertions of the module, in its order."""

EXERCISED: Final = "TimeIsExercised"
"""The run that must have an instance: with too few steps there is no trace, and every check holds."""


def timed(system: System) -> System:
    """Return what the clock goes through: the system with all moments from the audit on, and its claims about flows."""
    flows = tuple(claim for claim in system.claims if claim.kind is ClaimKind.NO_FLOW)
    return replace(moments.every(system), claims=flows)


def write_expiry(system: System) -> str:
    """Return the main file for a system as `timed` gives it; its facts are written with a moving audit instant."""
    steps = len(system.instants) - system.now
    lines = ["/** What time makes of the keystore. */", "module expiry_audit", "open expiry", ""]
    lines += [f"run {EXERCISED} for 0 but {steps}..{steps} steps", ""]
    lines += [f"check {name} for 0 but {steps}..{steps} steps" for name in ASSERTIONS]
    lines += ["", claims.write_places(system, range(len(system.claims)))]
    for number, claim in enumerate(system.claims):
        condition = claims.compartment(claim, number, "Compartment.inside")
        lines.append(f"run Claim{number}Always {{\n\talways {condition}\n}} for 0 but {steps}..{steps} steps")
    return "\n".join(lines).rstrip("\n") + "\n"
