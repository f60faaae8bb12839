"""KA741: what users assert in Alloy, violated and undecided."""

from __future__ import annotations

from msgspec.structs import replace

from keystore_audit.findings import Location, Severity
from keystore_audit.model.formal.system import NodeAtom
from keystore_audit.properties import BY_ID, Status
from keystore_audit.properties.result import AlloyResult, Counterexample, ProfileResult, Step
from keystore_audit.rules import RULES
from keystore_audit.rules.judge import judge
from tests.engine.systems import healthy as built
from tests.rules.evidence import allow, context, findings, grant, healthy, judged, meaning, permissions, talker

EXAMPLE = Counterexample(
    text="With enclave: /listener.",
    steps=(Step(enclave="/listener", channel=None, witness="/listener", path="enclaves/listener", line=None),),
)

ASSERTED = AlloyResult(
    meaning="",
    prop=replace(BY_ID["outsiders-cannot-read"], id="chatter-nobody-else", statement="Nobody else. (Alloy alone.)"),
    profiles={
        "spec": ProfileResult(status=Status.VIOLATED, engines={"alloy": Status.VIOLATED}, counterexample=EXAMPLE)
    },
    severity=Severity.LOW,
    location=Location(path="chatter.als", line=15, beside=True),
)


def test_what_holds_is_no_finding_and_what_is_unknown_is_open_with_its_reason() -> None:
    def told(status: Status, reason: str = "") -> list[tuple[str, str]]:
        answer = ProfileResult(status=status, engines={}, counterexample=None)
        result = replace(ASSERTED, profiles={"spec": answer}, reason=reason)
        return [(finding.code, finding.message) for finding in judged(results=(result,)).findings]

    assert told(Status.HOLDS) == []
    ((code, message),) = told(Status.UNKNOWN, "Alloy was ended")
    assert code == "KA906"
    assert message == "Undecided, since Alloy was ended: Nobody else. (Alloy alone.)"


def test_who_accepts_it_accepts_this_text_about_this_keystore() -> None:
    """Alloy tells one example of many, and another may be worse."""
    store = healthy()
    wider = permissions("enclaves/talker/permissions.p7s", grant("/talker", allow(["rt/chatter", "rt/map"])))
    other = talker(permissions=wider)(store)
    asked = ((store, ASSERTED), (store, replace(ASSERTED, meaning="check { no Enclave }")), (other, ASSERTED))
    found = [findings("KA741", judged(keystore, results=(result,)))[0] for keystore, result in asked]
    assert len({each.fingerprint for each in found}) == 1
    assert len({each.meaning for each in found}) == 3


def test_who_accepts_it_accepts_the_nodes_that_it_is_about() -> None:
    system = built()

    def found(channel: int) -> str:
        node = NodeAtom(
            label="/n",
            location=system.enclaves[0].location,
            enclave=0,
            publishes=frozenset({channel}),
            subscribes=frozenset(),
        )
        about = context(meaning=meaning(systems=(replace(system, nodes=(node,)),)), results=(ASSERTED,))
        return findings("KA741", judge(about, RULES))[0].meaning

    assert found(0) == found(0)
    assert found(0) != found(1)
