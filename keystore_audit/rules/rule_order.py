"""KA6: rules of one grant that implementations read and order differently (`model.divergence.find`)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from keystore_audit.findings import Severity
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.divergence.substitution import Cause
from keystore_audit.profiles import contrasted, facts
from keystore_audit.rules.divergence import MEASURED, said
from keystore_audit.rules.registry import Context, Violation, rule
from keystore_audit.rules.remedies import in_permissions

_NO_DENIAL: Final = (
    "Take the deny rule out, since what no rule allows is denied by every implementation, and name the topics and "
    "partitions that are needed in the allow rules"
)


@rule(
    "KA604",
    Severity.MEDIUM,
    clause=f"DDS-Security 1.1, 9.4.1.3.2.3 (partitions of a criterion); {MEASURED}",
    remedy=in_permissions(_NO_DENIAL),
)
def deny_rule_with_partitions(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A deny rule lists partitions, and Fast DDS denies its topics in every partition.

    Later rules that allow the topic elsewhere are not reached there.
    """
    yield from said(context, Cause.DENY_IN_PARTITION)


@rule(
    "KA605",
    Severity.MEDIUM,
    clause=f"DDS-Security 1.1, 9.4.1.3.2.3 (a deny rule without partitions denies in all); {MEASURED}",
    remedy=in_permissions(_NO_DENIAL),
)
def deny_rule_without_partitions(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A deny rule lists no partitions: the specification denies in all, Cyclone DDS in the default partition alone.

    A later rule that allows the topic in a partition counts there. ROS 2 nodes use the default partition; whoever
    controls a node chooses.
    """
    yield from said(context, Cause.DENY_WITHOUT_PARTITION)


@rule(
    "KA606",
    Severity.MEDIUM,
    clause=f"DDS-Security 1.1, 9.4.1.3.2.3 (partitions of a criterion); {MEASURED}",
    remedy=in_permissions("Give each set of partitions an <allow_rule> of its own"),
)
def partitions_of_several_criteria(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """An allow rule has several criteria with partitions: Fast DDS allows the topics of each in those of all.

    Peers on Fast DDS accept it too, so that what was meant for one partition reaches another.
    """
    yield from said(context, Cause.CROSSED_PARTITIONS)


@rule(
    "KA607",
    Severity.MEDIUM,
    clause=f"DDS-Security 1.1, 9.4.1.3 (rules in order); {MEASURED}",
    remedy=in_permissions("List a topic in one rule, with all its partitions"),
)
def later_rule_for_other_partitions(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Two rules list a topic in different partitions, and Fast DDS stops at the first.

    It asks no later rule once one lists the topic, in whatever partition; others go on.
    """
    yield from said(context, Cause.FINAL_RULE)


@rule(
    "KA608",
    Severity.MEDIUM,
    clause=f"DDS-Security 1.1, 9.4.1.3 (deny_rule); {MEASURED}",
    remedy=in_permissions(_NO_DENIAL),
)
def deny_rule_blocks_topic(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A deny rule for one operation, or one partition, takes the whole topic away on Cyclone DDS 0.10.

    Where read and write access control are on, the first rule that lists a topic decides there whether it can be
    created; so denying to publish denies to subscribe. Cyclone DDS 11 does it right.
    """
    yield from said(context, Cause.TOPIC_DENIED)


_RELAY: Final = f"What <relay> gives differs ({contrasted('relay')})"


@rule(
    "KA609",
    Severity.MEDIUM,
    clause=f"DDS-Security 1.1, 9.4.1.3.2.3 (relay); {facts.RELAY_MEASURED}",
    remedy=in_permissions("Take the <relay> criteria out; no ROS 2 implementation relays"),
)
def relay_read_differently(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A rule is about relaying: on Fast DDS peers give a reader by it what they give a subscriber, plain data.

    High where that lets somebody read. Cyclone DDS and OpenDDS pass the element over, so that nothing relays there.
    """
    yield from said(context, Cause.RELAY, _RELAY)


@rule(
    "KA610",
    Severity.MEDIUM,
    clause="DDS-Security 1.1, 9.4.1.2.6 and 9.4.1.3.2.3 (expressions as of POSIX fnmatch); "
    f"{facts.EXPRESSIONS_MEASURED}",
    remedy=in_permissions("Name each topic, or use one * at the end and neither brackets nor backslashes"),
)
def expression_read_differently(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """An expression matches names under one implementation that it does not match under another.

    Brackets with ^, classes or a ] first, and backslashes, are read in four ways. Found by comparing the sets of all
    names, not by the text; names beyond ASCII are matched by character here and by octet on Cyclone DDS.
    """
    yield from said(context, Cause.EXPRESSION, "An expression matches different names")
