"""KA742: what the engines said of labels."""

from __future__ import annotations

from msgspec.structs import replace

from keystore_audit.engine.engines import with_label_answers
from keystore_audit.findings import Location, Severity
from keystore_audit.model.claims.globs import Globs
from keystore_audit.model.claims.stated import Claim, Labelled, Labelling, LabelPair, chain
from keystore_audit.model.formal.asked import Attacker, ClaimKind
from keystore_audit.properties import BY_ID, Status
from keystore_audit.properties.result import AssertedResult, Counterexample, LabelResult, ProfileResult, Step
from tests.rules.evidence import findings, judged

LATTICE = Location(path="keystore-audit.toml", line=1, beside=True)
EXAMPLE = Counterexample(
    text="/a -> /x (topic) -> /b.",
    steps=(Step(enclave="/a", channel="domain 0", witness="rt/x", path="enclaves/a/permissions.p7s", line=9),),
)
VIOLATED = ProfileResult(status=Status.VIOLATED, engines={"native": Status.VIOLATED}, counterexample=EXAMPLE)
HOLDS = ProfileResult(status=Status.HOLDS, engines={"native": Status.HOLDS}, counterexample=None)
UNKNOWN = ProfileResult(status=Status.UNKNOWN, engines={"native": Status.UNKNOWN}, counterexample=EXAMPLE)


def labels(*answers: ProfileResult, breaches: tuple[tuple[str, ...] | None, ...] = ()) -> LabelResult:
    """What becomes of the answers about the parts of one pair of labels, and of one property beside it.

    `breaches`: what violates each part, parallel to them where it is given.
    """
    lattice = chain(("low", "high"))
    given = Labelling(
        lattice=lattice,
        labelled=(
            Labelled(label="low", enclaves=("/b",), place=""),
            Labelled(label="high", enclaves=("/a",), place=""),
        ),
        location=LATTICE,
        place="keystore-audit.toml:1:1",
    )
    pair = LabelPair(id="label-high-to-low", source="high", target="low", labelling=given)
    claims = [_claim(f"part-{number}", pair) for number in range(len(answers))]
    violating = breaches or ((),) * len(answers)
    results = [
        replace(_result(claim, answer), breaches=each)
        for claim, answer, each in zip(claims, answers, violating, strict=True)
    ]
    alone = _claim("mine", None)
    told = with_label_answers([claims[0], alone, *claims[1:]], [results[0], _result(alone, HOLDS), *results[1:]])
    assert [one.prop.id for one in told] == ["mine", "label-high-to-low"]
    joint = told[1]
    assert isinstance(joint, LabelResult)
    return joint


def _claim(name: str, pair: LabelPair | None) -> Claim:
    return Claim(
        id=name,
        statement="Nothing gets there.",
        kind=ClaimKind.NO_FLOW,
        attacker=Attacker.RELAYS,
        source=Globs(enclaves=("/a",)),
        target=Globs(enclaves=("/b",)),
        location=LATTICE,
        place="",
        labels=pair,
    )


def _result(claim: Claim, answer: ProfileResult) -> AssertedResult:
    return AssertedResult(
        prop=replace(BY_ID["outsiders-cannot-read"], id=claim.id),
        profiles={"spec": answer, "fastdds-3.6": HOLDS if answer is not UNKNOWN else UNKNOWN},
        severity=Severity.CRITICAL,
        location=LATTICE,
    )


def test_labels_that_hold_say_nothing_and_undecided_ones_leave_it_open() -> None:
    assert judged(results=(labels(HOLDS, HOLDS),)).findings == ()
    assert {found.code for found in judged(results=(labels(HOLDS, UNKNOWN),)).findings} == {"KA906"}
    assert labels(UNKNOWN, VIOLATED).profiles["spec"].status is Status.VIOLATED


def test_engines_that_contradict_each_other_about_one_part_are_not_outvoted() -> None:
    disputed = ProfileResult(
        status=Status.UNKNOWN, engines={"native": Status.HOLDS, "alloy": Status.VIOLATED}, counterexample=None
    )
    both = {"native": Status.VIOLATED, "alloy": Status.VIOLATED}
    result = labels(replace(VIOLATED, engines=both), disputed)
    assert result.status is Status.UNKNOWN
    assert not result.engines_agree
    assert findings("KA904", judged(results=(result,)))
