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
    in_permissions("Let the rule name the domains of the governance, or take it out"),
    applies=speaks,
)
def rule_in_no_governed_domain(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """No governance of the keystore covers a domain of the rule, while other rules of the grant are for such domains.

    Of a grant none of whose allow rules is for a governed domain, grant-outside-governance-domains speaks; where Fast
    DDS applies the rule to a governed domain all the same and that changes something, rule-of-another-domain does.
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
    in_permissions("Write the expression as it was meant, or name each topic"),
    applies=speaks,
)
def expression_matches_nothing(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """An expression matches no name, or is malformed and matches none of ROS 2, under all chosen implementations.

    High in a deny rule, which denies nothing then. Found by its meaning; how implementations come to it is said by
    expression-malformed, and of expressions that some of them do take for names, that rule alone speaks.
    """
    yield from all_odd(
        use,
        context,
        AnomalyKind.MATCHES_NOTHING,
        lambda first, more: (
            f"The expression {quoted(first.texts[0])}{more} matches no topic of ROS 2, as every "
            f"implementation reads it: nothing is {'allowed' if first.allow else 'denied'} by it."
        ),
    )


@rule(
    "KA625",
    Severity.MEDIUM,
    "ROS 2 design, topic and service names to DDS (rt/, rq/…Request, rr/…Reply)",
    in_permissions("Write the name as DDS has it, rt/chatter for /chatter"),
    applies=speaks,
)
def expression_matches_no_ros_name(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """No endpoint of ROS 2 is meant: a prefix is missing, a / too many is there, or it is for partitions alone.

    High where a deny rule has it and the topic that was most likely meant is allowed. A grant without any expression of
    ROS 2, ros_discovery_info among them, is one of a plain DDS application, and no finding; where one enclave speaks
    both, the tool cannot know which names are meant for DDS.
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
        f"The expression {quoted(first.texts[0])}{more} matches no name of ROS 2, so that it "
        f"{'allows' if first.allow else 'denies'} nothing to a ROS 2 node; perhaps {quoted(first.other_text)} was "
        f"meant{rest}."
    )


@rule(
    "KA626",
    Severity.LOW,
    "DDS-Security 1.1, 9.4.1.3 (least privilege: a right that nothing can use)",
    in_permissions("Take the right out, or give the enclave at the other end its own"),
    applies=speaks,
)
def grant_without_counterpart(use: PermissionsUse, context: Context) -> Iterator[Violation]:
    """A topic that the grant names may be written, and no grant of the keystore lets anybody read it; or the reverse.

    Most often a misspelt name or a right left over. Looked at are names without wildcards; partitions are not. Left out
    are topics that every node has (/rosout, /parameter_events, /clock), services and actions, which tools call too, and
    topics that a governance does not control. A keystore of one enclave has its peers elsewhere; of several, too, some
    may be elsewhere.
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
    outside("Write fewer expressions with several wildcards and fewer rules; look at each of the rules until then."),
    applies=taken,
)
def rules_not_compared(use: DocumentUse, context: Context) -> Iterator[Violation]:
    """There is too much in the document to find all rules that never decide, overlap or change nothing.

    What the rules allow is decided exactly all the same; whether that is what their author meant is not looked at to
    the end. The audit is incomplete for it where a finding of high severity could be missing: where the document
    denies anything, or is a governance.
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
    in_governance("Put the rule before the one that applies in its place, or take it out"),
    applies=speaks,
)
def topic_rule_shadowed(use: GovernanceUse, context: Context) -> Iterator[Violation]:
    """Earlier rules match every topic that a topic_rule names: it protects nothing.

    High where it asks for a protection that the rule before it does not give: that protection is not there. On OpenDDS
    it can still switch access control off (KA615).
    """
    yield from all_odd(
        use,
        context,
        AnomalyKind.TOPIC_RULE_SHADOWED,
        _topics_shadowed,
        "the rule that applies instead",
    )


def _topics_shadowed(first: Anomaly, more: str) -> str:
    topic = f", as to {ros_name(first.point.topic)}" if first.point is not None else ""
    weaker = ", which protects less" if first.serious else ""
    return (
        f"The rule for topics {quoted(first.texts[0])}{more} protects nothing: the one for "
        f"{quoted(first.other_text)} comes first{topic}{weaker}."
    )


@rule(
    "KA423",
    Severity.LOW,
    "DDS-Security 1.1, 9.4.1.2.4 (the first domain_rule that covers the domain)",
    in_governance("Let each domain be covered by one rule"),
    applies=speaks,
)
def domain_rule_shadowed(use: GovernanceUse, context: Context) -> Iterator[Violation]:
    """Earlier rules cover every domain of a domain_rule: it protects nothing.

    High where it, or one of its topic rules, asks for a protection that the rule before it does not give. On OpenDDS
    it can still switch access control off, that of joining too (KA615).
    """
    yield from all_odd(
        use,
        context,
        AnomalyKind.DOMAIN_RULE_SHADOWED,
        lambda first, more: (
            f"The rule for domain {first.other_text}{more} protects nothing: an earlier one covers it"
            f"{', which protects less' if first.serious else ''}."
        ),
        "the rule that applies instead",
    )
