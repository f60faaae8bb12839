"""KA4 and KA6: rules and expressions about nothing, or with nobody at the other end (`model.anomalies.find`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from keystore_audit.findings import Severity, outside
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.anomalies.anomaly import Anomaly, AnomalyKind
from keystore_audit.model.divergence.substitution import Cause
from keystore_audit.model.names import ros_name
from keystore_audit.rules.anomaly import all_odd, folded, named, odd
from keystore_audit.rules.divergence import spoken_of
from keystore_audit.rules.registry import MAX_LISTED, Context, Violation, listed, quoted, rule
from keystore_audit.rules.remedies import in_governance, in_permissions
from keystore_audit.rules.restrictions import of_no_node
from keystore_audit.rules.subjects import DocumentUse, GovernanceUse, PermissionsUse, speaks, taken

_EXPRESSIONS: Final = "DDS-Security 1.1, 9.4.1.2.6 and 9.4.1.3.2.3 (expressions as of POSIX fnmatch)"


@rule(
    "KA623",
    Severity.MEDIUM,
    "DDS-Security 1.1, 9.4.1.2.4 and 9.4.1.3 (domains)",
    in_permissions("Let the rule name governed domains, or remove it"),
    applies=speaks,
)
def rule_in_no_governed_domain(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """A rule is for a domain that no governance covers, while other rules of its grant are for governed domains.

    If no allow rule is for a governed domain, see grant-outside-governance-domains. If Fast DDS still applies the rule
    in a governed domain and that changes something, see rule-of-another-domain.
    """
    spoken = spoken_of(use, context, Cause.RULE_DOMAINS)
    yield from folded(
        use,
        (each for each in odd(use, context, AnomalyKind.UNGOVERNED_DOMAIN) if each.line not in spoken),
        lambda first, more: (
            f"{named(first)}{more} is for domain {first.other_text}, which no governance of the "
            "keystore covers: nobody can take part in it."
        ),
    )


@rule(
    "KA624",
    Severity.MEDIUM,
    f"{_EXPRESSIONS}; POSIX 1003.1, 2.13.1 (bracket expressions)",
    in_permissions("Correct the expression, or name each topic"),
    applies=speaks,
)
def expression_matches_nothing(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """An expression matches no name, or is malformed and matches no ROS 2 name, under all chosen implementations.

    High in a deny rule, which then denies nothing. Decided by meaning, not by text. For expressions that some
    implementations take for names, see expression-malformed.
    """
    yield from all_odd(
        use,
        context,
        AnomalyKind.MATCHES_NOTHING,
        lambda first, more: (
            f"The expression {quoted(first.texts[0])}{more} matches no ROS 2 topic under any "
            f"chosen implementation: nothing is {'allowed' if first.allow else 'denied'} by it."
        ),
    )


@rule(
    "KA625",
    Severity.MEDIUM,
    "ROS 2 design, topic and service names to DDS (rt/, rq/…Request, rr/…Reply)",
    in_permissions("Write the DDS name, for example rt/chatter for /chatter"),
    applies=speaks,
)
def expression_matches_no_ros_name(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """An expression matches no ROS 2 endpoint: a prefix is missing, a / is too many, or it is for partitions alone.

    High in a deny rule if the topic most likely meant is allowed. A grant without any ROS 2 expression
    (ros_discovery_info is one) is for plain DDS, and no finding. If an enclave uses both, names meant for DDS cannot be
    told.
    """
    yield from all_odd(
        use,
        context,
        AnomalyKind.NOT_ROS,
        _not_ros,
    )
    yield from of_no_node(use)


def _not_ros(first: Anomaly, more: str) -> str:
    rest = f", which {quoted(first.subject)} may use" if first.serious else ""
    return (
        f"The expression {quoted(first.texts[0])}{more} matches no ROS 2 name, so it "
        f"{'allows' if first.allow else 'denies'} nothing to a ROS 2 node; perhaps {quoted(first.other_text)} was "
        f"meant{rest}."
    )


@rule(
    "KA626",
    Severity.LOW,
    "DDS-Security 1.1, 9.4.1.3 (least privilege: a right that nothing can use)",
    in_permissions("Remove the right, or give the enclave at the other end its right"),
    applies=speaks,
)
def grant_without_counterpart(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """A grant lets its enclave write a topic that no grant lets anybody read, or the reverse.

    Usually a misspelt name or a leftover right. Only names without wildcards are compared, and no partitions. Left out:
    topics of every node (/rosout, /parameter_events, /clock), services, actions, and topics without access control. A
    keystore of one enclave has its peers elsewhere, and so may others.
    """
    found = odd(use, context, AnomalyKind.NO_COUNTERPART)
    yield from folded(use, found, lambda _first, _more: _without_counterpart(found))


def _without_counterpart(found: Sequence[Anomaly]) -> str:
    by_operation = {
        operation: [anomaly.texts[0] for anomaly in found if anomaly.other_text == operation.value]
        for operation in (Operation.PUBLISH, Operation.SUBSCRIBE)
    }
    said = []
    if names := by_operation[Operation.PUBLISH]:
        said.append(f"may publish {_topics(names)}, which nobody may subscribe to")
    if names := by_operation[Operation.SUBSCRIBE]:
        said.append(f"may subscribe to {_topics(names)}, which nobody may publish")
    return f"{quoted(found[0].subject)} {'; it '.join(said)} in this keystore."


def _topics(names: Sequence[str]) -> str:
    """Listed as users of ROS 2 call them; the names that only count may be thousands."""
    return listed([*map(ros_name, names[:MAX_LISTED]), *names[MAX_LISTED:]])


@rule(
    "KA627",
    Severity.INFO,
    "docs/model.md, anomalies of rules",
    outside("Use fewer rules, and fewer expressions with several wildcards. Until then, review each rule."),
    applies=taken,
)
def rules_not_compared(use: DocumentUse, context: Context) -> Iterator[Violation]:
    """The document has too much in it to find all rules that never decide, overlap or change nothing.

    What the rules allow is still decided exactly. The audit is incomplete if a high finding could be missing: if the
    document denies anything, or is a governance.
    """
    for anomaly in odd(use, context, AnomalyKind.NOT_WORKED_OUT):
        undecided = anomaly.serious and _denies(use)
        yield Violation(
            f"Not all rules could be compared with each other: {anomaly.other_text}.",
            (use.at(None),),
            profiles=anomaly.profiles,
            severity=Severity.MEDIUM if undecided else None,
            undecided=undecided,
            key=anomaly.other_text,
        )


def _denies(use: DocumentUse) -> bool:
    permissions = use.document.permissions if isinstance(use, PermissionsUse) else None
    return permissions is None or any(not each.allow for grant in permissions.grants for each in grant.rules)


@rule(
    "KA422",
    Severity.LOW,
    "DDS-Security 1.1, 9.4.1.2.5 (the first topic_rule that matches)",
    in_governance("Move the rule before the one that applies in its place, or remove it"),
    applies=speaks,
)
def topic_rule_shadowed(use: GovernanceUse, context: Context) -> Iterator[Violation]:
    """A topic_rule protects nothing: earlier rules match every topic that it names.

    High if it asks for a protection that the earlier rule does not give: that protection is missing. On OpenDDS it can
    still switch access control off (KA615).
    """
    yield from all_odd(
        use,
        context,
        AnomalyKind.TOPIC_RULE_SHADOWED,
        _topics_shadowed,
        "the rule that applies instead",
    )


def _topics_shadowed(first: Anomaly, more: str) -> str:
    topic = f" (for example for {ros_name(first.point.topic)})" if first.point is not None else ""
    weaker = " and protects less" if first.serious else ""
    return (
        f"The rule for topics {quoted(first.texts[0])}{more} protects nothing: the one for "
        f"{quoted(first.other_text)} comes first{topic}{weaker}."
    )


@rule(
    "KA423",
    Severity.LOW,
    "DDS-Security 1.1, 9.4.1.2.4 (the first domain_rule that covers the domain)",
    in_governance("Cover each domain by one rule"),
    applies=speaks,
)
def domain_rule_shadowed(use: GovernanceUse, context: Context) -> Iterator[Violation]:
    """A domain_rule protects nothing: earlier rules cover all its domains.

    High if it, or one of its topic rules, asks for a protection that the earlier rule does not give. On OpenDDS it can
    still switch access control off, also for joining (KA615).
    """
    yield from all_odd(
        use,
        context,
        AnomalyKind.DOMAIN_RULE_SHADOWED,
        lambda first, more: (
            f"The rule for domain {first.other_text}{more} protects nothing: an earlier one covers it"
            f"{' and protects less' if first.serious else ''}."
        ),
        "the rule that applies instead",
    )
