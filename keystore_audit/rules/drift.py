"""KA6: what an SROS2 policy says (`--policy`) and what the keystore grants (`model.intended.drift`).

One finding for each enclave and direction, not one for each name. Only the grants are compared: that a grant is out of
date, in no governed domain or refused is said by the rules about permissions.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Final

from msgspec.structs import replace

from keystore_audit.findings import Location, Severity, decision
from keystore_audit.grouped import grouped
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.model.names import ros_name
from keystore_audit.profiles import facts
from keystore_audit.rules.registry import MAX_QUOTED, VERBS, Context, Violation, listed, more, quoted, rule
from keystore_audit.rules.remedies import CREATE_ENCLAVE, CREATE_PERMISSION
from keystore_audit.text import shorten

if TYPE_CHECKING:  # an audit without a policy needs none of it
    from keystore_audit.model.intended.drift import Drift, EnclaveDrift
    from keystore_audit.model.intended.drift_rights import DriftedRight

DESIGN: Final = "ROS 2 design, SROS2 access control policies; ros2/sros2, policy/templates/dds/permissions.xsl"


def _drift(_keystore: Keystore, context: Context) -> Drift | None:
    return context.drift


def _alike(rights: Iterable[DriftedRight]) -> Iterator[list[DriftedRight]]:
    """The rights that drift under the same profiles together."""
    yield from grouped(rights, lambda right: right.profiles).values()


def _key(rights: Iterable[DriftedRight]) -> str:
    """What drifts is part of it: another right is not hidden by one that was accepted before."""
    return "\n".join(sorted({f"{right.operation.value} {right.topic} {right.partition}" for right in rights}))


def _more(count: int) -> str:
    return f" ({count} more are not listed)" if count > 0 else ""


@rule(
    "KA640",
    Severity.HIGH,
    DESIGN,
    decision(f"Sign what the policy says ({CREATE_PERMISSION}), or remove the right from the policy."),
    of=_drift,
)
def policy_right_not_granted(drift: Drift) -> Iterator[Violation]:
    """The policy gives an enclave a right that its permissions do not.

    Under Enforce, a node that needs the right fails at start, or when it uses the name. Compared by meaning, in the
    domains that governance and grant share (or `--domain`).
    """
    for found in drift.enclaves:
        for rights in _alike(found.lacking.rights):
            yield Violation(
                _lacking_message(found, rights),
                [*_both_lines(rights, "the policy allows it")],
                enclave=found.enclave,
                profiles=rights[0].profiles,
                key=_key(rights),
            )


def _lacking_message(found: EnclaveDrift, rights: Sequence[DriftedRight]) -> str:
    meant = {(right.right.action.value, right.right.name): right for right in rights if right.right is not None}
    names = listed(_meant(action, name, right) for (action, name), right in meant.items())
    why = "its permissions do not"
    if found.granted is None:
        why = "it has no permissions"
    elif not found.granted:
        why = "its permissions hold no grant for it"
    return f"The policy lets {found.enclave} {names}, but {why}{_more(found.lacking.more)}."


def _meant(action: str, name: str, right: DriftedRight) -> str:
    """The right in the words of the policy, with a name that is concerned where those have wildcards."""
    preposition = "to " if action == "subscribe" else ""
    example = f" (for one, {ros_name(right.topic)})" if right.endless else ""
    return f"{action} {preposition}{quoted(name)}{example}"


def _both_lines(rights: Iterable[DriftedRight], says: str) -> Iterator[Location]:
    """For each right the line of the signed document, and that of the policy."""
    for right in rights:
        yield right.keystore
        if right.right is not None:
            yield replace(right.right.location, message=says)


@rule(
    "KA641",
    Severity.HIGH,
    DESIGN,
    decision(
        f"Sign what the policy says ({CREATE_PERMISSION}), or add the right to the policy. Documents "
        "signed before stay valid until their dates end: peers accept any valid document."
    ),
    of=_drift,
)
def right_beyond_policy(drift: Drift) -> Iterator[Violation]:
    """Signed permissions give an enclave a right that the policy does not.

    Compared are its own permissions and every other document of the keystore that it can present to a peer.
    """
    for (enclave, own), found in grouped(drift.enclaves, lambda each: (each.enclave, each.own)).items():
        left = sum(each.exceeding.more for each in found)
        for rights in _alike(right for each in found for right in each.exceeding.rights):
            documents = list(dict.fromkeys(right.keystore.path for right in rights))
            whose = "its permissions" if own else f"{quoted(documents[0])}{more(len(documents))}, which it can present,"
            verb = "let" if own or documents[1:] else "lets"
            yield Violation(
                f"The policy does not let {enclave} {listed(_exceeding(rights))}, but {whose} {verb} it{_more(left)}.",
                (*_both_lines(rights, "the policy denies it"), _introduced(found[0])),
                enclave=enclave,
                profiles=rights[0].profiles,
                key=_key(rights),
            )


def _introduced(found: EnclaveDrift) -> Location:
    return replace(found.policy, message="what the policy says of the enclave")


def _exceeding(rights: Iterable[DriftedRight]) -> Iterable[str]:
    """What is granted, once however many documents grant it."""
    told: dict[str, None] = {}
    for right in rights:
        what = f"{VERBS[right.operation]} {'names like ' if right.endless else ''}{ros_name(right.topic)}"
        told[what + (f" in partition {quoted(right.partition)}" if right.partition else "")] = None
    return told


@rule(
    "KA642",
    Severity.HIGH,
    f"{DESIGN}; DDS-Security 1.1, 9.4.1.3 (grants)",
    decision(f"Put every <profile> of an enclave into one <profiles>, then sign the policy: {CREATE_PERMISSION}."),
    of=_drift,
)
def policy_profiles_lost(drift: Drift) -> Iterator[Violation]:
    """The policy has several <profiles> for an enclave, and only the first counts.

    `ros2 security` makes a grant of each, with one subject, and implementations use the first in force. Of several
    <enclave> elements with one path it translates only the first. The others' nodes have no rights.
    """
    for enclave, lost in grouped(drift.lost, lambda profiles: profiles.enclave).items():
        nodes = listed(dict.fromkeys(node.name for profiles in lost for node in profiles.nodes))
        yield Violation(
            f"This part of the policy for {enclave} is lost, with the rights of {nodes}: {lost[0].lost}.",
            [profiles.location for profiles in lost],
            enclave=enclave,
            key="\n".join(sorted({node.name for profiles in lost for node in profiles.nodes})),
        )


@rule(
    "KA643",
    Severity.HIGH,
    DESIGN,
    decision(f"Remove the enclave from the policy, or create it: {CREATE_ENCLAVE}."),
    of=_drift,
)
def policy_enclave_missing(drift: Drift) -> Iterator[Violation]:
    """The policy describes an enclave that the keystore does not have: its nodes do not start under Enforce.

    The keystore of one robot, audited with the policy of many robots, rightly has this finding.
    """
    missing = drift.missing
    if missing:
        yield Violation(
            f"The policy describes {listed(each.enclave for each in missing)}, but the keystore has no such enclave.",
            [each.location for each in missing],
            enclave=missing[0].enclave if len(missing) == 1 else None,
            key="\n".join(sorted(each.enclave for each in missing)),
        )


@rule(
    "KA644",
    Severity.HIGH,
    DESIGN,
    decision("Describe the enclave in the policy. Or remove the enclave and revoke its identity."),
    of=_drift,
)
def enclave_not_in_policy(drift: Drift) -> Iterator[Violation]:
    """The keystore has an enclave that the policy does not mention, so nobody can tell what it is meant to do.

    Nobody reviewed this participant, whatever its permissions say today.
    """
    unnamed = drift.unnamed
    if unnamed:
        yield Violation(
            f"The policy does not mention {listed(enclave.path for enclave in unnamed)}.",
            [Location(enclave.files.files[Role.PERMISSIONS].place) for enclave in unnamed],
            enclave=unnamed[0].path if len(unnamed) == 1 else None,
            key="\n".join(sorted(enclave.path for enclave in unnamed)),
        )


@rule(
    "KA645",
    Severity.MEDIUM,
    DESIGN,
    decision("Correct the document at the place named, so that every implementation reads it alike, and sign it."),
    of=_drift,
)
def drift_undecided(drift: Drift) -> Iterator[Violation]:
    """What an enclave is granted, or what the policy means, is unknown: it may be more or less than was meant."""
    for doubt in drift.undecided:
        yield Violation(
            f"It is unknown whether {doubt.enclave} is granted what the policy says "
            f"({shorten(doubt.reason, MAX_QUOTED)}).",
            (doubt.location,),
            enclave=doubt.enclave,
            undecided=True,
        )


@rule(
    "KA646",
    Severity.INFO,
    f"ROS 2 design, SROS2 access control policies; {facts.OWN_ACCESS_CONTROL}",
    decision(f"Create permissions if a DDS implementation runs: {CREATE_PERMISSION}. {facts.AUDIT_ITS_CONFIGURATION}"),
    of=_drift,
)
def policy_not_enforced_by_permissions(drift: Drift) -> Iterator[Violation]:
    """No enclave has a permissions.p7s, as where only rmw_zenoh runs: this audit cannot say that the policy holds.

    rmw_zenoh takes identities from the enclaves and never reads permissions. Its own configuration, outside the
    keystore, says what its nodes may do.
    """
    if drift.unenforced:
        yield Violation(
            "No enclave has a permissions.p7s, so nothing here enforces the policy, and it was not compared.",
            (Location(drift.policy.path, beside=True),),
        )
