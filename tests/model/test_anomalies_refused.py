"""Documents that none of the chosen implementations reads."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

from keystore_audit import audit
from tests.keystore.documents import criterion, grant, permissions, rule
from tests.model.comparing import Member, Store


def test_nothing_is_said_of_names_that_no_chosen_implementation_reads(tmp_path: Path) -> None:
    """Cyclone DDS refuses a document with a domain id above 230; it alone would ask how its names match."""
    denial = rule(criterion("publish", "?t/odd"), allow=False)
    own = permissions(grant("/e", denial, rule(criterion("publish", "rt/a"), domains="<id>232</id>")))
    store = Store(members={"/e": Member(permissions=own)}).write(tmp_path / "k")
    at = datetime(2026, 11, 21, tzinfo=timezone.utc)
    report = audit(store, at=at, engine="native", profiles=["cyclonedds-11"])
    codes = {each.code for each in report.findings}
    assert "KA420" in codes, "it is refused, and that is said"
    assert not codes & {"KA624", "KA625", "KA905"}
