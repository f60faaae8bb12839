"""What a rule may look at beside its subject."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, TypeVar

from msgspec import Struct

from keystore_audit.intent.environment import Environment
from keystore_audit.keystore.identity import Beside
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.model.meaning import Meaning
from keystore_audit.model.trust.authorities import Authorities
from keystore_audit.profiles import Profile
from keystore_audit.properties.result import EngineRun, PropertyResult
from keystore_audit.settings.suppressions import Acceptance

if TYPE_CHECKING:  # an audit without a policy, a graph or a launch file needs none of it
    from keystore_audit.model.intended.drift import Drift
    from keystore_audit.model.intended.observed import Observation


_T = TypeVar("_T")


def given(value: _T | None) -> _T:
    """What an option gave; only rules that apply where it did ask for it."""
    if value is None:
        raise ValueError("a rule asks for what was not given")
    return value


class Context(Struct, frozen=True, kw_only=True):
    """The evidence, its meaning, the engines' answers and the options of this audit.

    `at` is the audit instant (aware UTC), `expires_within` the notice for coming expiry, `deployed` whether
    the tree goes on a robot. `profiles` are the chosen ones; findings about signers are judged under every
    known variant (`model.profiles.VARIANTS`). `observed`: graphs and launch files compared with the keystore, None
    where none were named.
    """

    keystore: Keystore
    meaning: Meaning
    results: tuple[PropertyResult, ...]
    engines: tuple[EngineRun, ...]
    at: datetime
    expires_within: timedelta
    deployed: bool
    profiles: tuple[Profile, ...]
    beside: Beside | None = None
    """The other keystores of this run; None: there are none."""
    environment: Environment | None = None
    """What the robots' processes start with; None where no file says so."""
    drift: Drift | None = None
    """The keystore compared with the policy; None where none was named."""
    observed: Observation | None = None
    authorities: Authorities = Authorities()
    """Those that settings or options declare."""
    acceptances: tuple[Acceptance, ...] = ()
    """Findings that settings and a baseline accept, in the order in which they are looked for."""

    def chose(self, profiles: Iterable[Profile]) -> bool:
        """Whether some of them are among the chosen ones."""
        return not {*self.profiles}.isdisjoint(profiles)

    def unless_all(self, names: Collection[str]) -> tuple[str, ...]:
        """Those of the chosen profiles with these names; none where it is all of them, as violations have it."""
        found = tuple(profile.name for profile in self.profiles if profile.name in names)
        return () if len(found) == len(self.profiles) else found

    def refused(self, enclaves: Iterable[Enclave], vendor: str = "") -> bool:
        """Whether one of them does not start under a chosen profile (of this vendor), whatever the reason."""
        chosen = [profile.name for profile in self.profiles if profile.name.startswith(vendor)]
        known = (self.meaning.usability.get((each.files.directory, name)) for each in enclaves for name in chosen)
        return any(usability is not None and usability.usable is False for usability in known)
