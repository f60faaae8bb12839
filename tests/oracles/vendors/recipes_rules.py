"""Rules of permissions: their order, domains, partitions and default, what a topic needs, who may join."""

from __future__ import annotations

from tests.keystore.documents import allow, deny, domain_rule, governance, ids, pub, pubsub, sub, topic_rule
from tests.keystore.documents import criterion as criteria
from tests.oracles.vendors.enclave import Endpoint, publish, subscribe
from tests.oracles.vendors.recipe import CHATTER, Recipe, of_rules, of_topics

A, B = "rt/a", "rt/b"
ENDPOINTS = (publish(A), subscribe(A), publish(B), subscribe(B), publish("rt/c"), subscribe("rt/c"))
ELSEWHERE = ids(9)


def rules(
    title: str, *listed: str, default: str | None = "DENY", endpoints: tuple[Endpoint, ...] = ENDPOINTS
) -> Recipe:
    """A keystore whose one grant has these rules."""
    return Recipe(title=title, permissions=of_rules(*listed, default=default), endpoints=endpoints)


JOINS = allow(pub("rt/z"))
"""Lets a participant start and says nothing of the topics that are asked about."""

ORDER = (
    rules("plain", allow(pubsub("rt/chatter")), endpoints=CHATTER),
    rules("allow before deny", allow(pubsub(A)), deny(pubsub(A))),
    rules("deny before allow", deny(pubsub(A)), allow(pubsub(A))),
    rules("deny of everything before allow", deny(pubsub("*")), allow(pubsub(A))),
    rules("allow of everything before deny", allow(pubsub("*")), deny(pubsub(A))),
    rules("deny a, then allow everything", deny(pubsub(A)), allow(pubsub("*"))),
    rules("deny publish, then allow everything", deny(pub(A)), allow(pubsub("*"))),
    rules("deny subscribe, then allow everything", deny(sub(A)), allow(pubsub("*"))),
    rules("allow everything, then deny publish", allow(pubsub("*")), deny(pub(A))),
    rules("allow publish, deny publish, allow subscribe", allow(pub(A)), deny(pub(A)), allow(sub(A))),
    rules("deny publish between", allow(sub(B)), deny(pub(A)), allow(pubsub(A, B))),
    rules("allow subscribe, then deny publish, then allow", allow(sub(A)), deny(pub(A)), allow(pubsub("*"))),
    rules("three rules of one topic", deny(sub(A)), allow(pub(A)), deny(pubsub("*"))),
    rules("publish only", allow(pub(A))),
    rules("subscribe only", allow(sub(A))),
    rules("two topics in one criterion", allow(pub(A, B))),
    rules("two criteria of one kind", allow(pub(A), pub(B), sub("rt/c"))),
    rules("relay is no right of its own", allow(pub("rt/z"), criteria("relay", A))),
    rules("relay denied", deny(criteria("relay", A)), allow(pubsub(A))),
    rules("relay beside subscribe", allow(sub(A), criteria("relay", A))),
    rules("allow without criteria", allow()),
    rules("allow without criteria, default allow", allow(), default="ALLOW"),
    rules("only a deny rule", deny(pub(A))),
    rules("only a deny rule, default allow", deny(pub(A)), default="ALLOW"),
    rules("no rules"),
    rules("no rules, default allow", default="ALLOW"),
)

DEFAULTS = (
    rules("default allow beside a rule", JOINS, default="ALLOW"),
    rules("default allow after a deny", JOINS, deny(pubsub(A)), default="ALLOW"),
    rules("default allow after a deny of publish", JOINS, deny(pub(A)), default="ALLOW"),
    rules("default allow after an allow of publish", allow(pub(A)), default="ALLOW"),
    rules("no default", JOINS, default=None),
    rules("default in small letters", JOINS, default="allow"),
    rules("default of another word", JOINS, default="PERMIT"),
    rules("default with blanks", JOINS, default=" ALLOW "),
    rules("default empty", JOINS, default=""),
    Recipe(
        title="default twice, allow last",
        permissions=of_rules(JOINS, default="DENY").replace("</default>", "</default><default>ALLOW</default>"),
        endpoints=ENDPOINTS,
    ),
    Recipe(
        title="default twice, deny last",
        permissions=of_rules(JOINS, default="ALLOW").replace("</default>", "</default><default>DENY</default>"),
        endpoints=ENDPOINTS,
    ),
)

RULE_DOMAINS = (
    rules("allow in another domain", JOINS, allow(pubsub(A), domains=ELSEWHERE)),
    rules("only an allow in another domain", allow(pubsub(A), domains=ELSEWHERE)),
    rules("only an allow in another domain, default allow", allow(pubsub(A), domains=ELSEWHERE), default="ALLOW"),
    rules("deny in another domain first", deny(pubsub(A), domains=ELSEWHERE), allow(pubsub(A, B))),
    rules("allow in another domain, then deny", JOINS, allow(pubsub(A), domains=ELSEWHERE), deny(pubsub(A))),
    rules("deny publish in another domain", deny(pub(A), domains=ELSEWHERE), allow(pubsub("*"))),
    rules("deny of the domain before its allow", deny(pubsub("*")), JOINS),
    rules("rule of two domains", allow(pubsub(A), domains=ids(9, 0))),
    rules("rule of a range and an id", allow(pubsub(A), domains=ids((5, 9), 0))),
    rules("rule without any domain in its set", JOINS, allow(pubsub(A), domains="")),
)

P, Q, BOTH = ("p",), ("q",), ("p", "q")
IN_PARTITIONS = (
    publish(A),
    publish(A, "p"),
    publish(A, "q"),
    publish(A, "p", "q"),
    publish(A, "pq"),
    publish(A, "*"),
    publish(A, "p*"),
    publish(A, ""),
    subscribe(A),
    subscribe(A, "p"),
)


def partitioned(title: str, *listed: str, default: str = "DENY") -> Recipe:
    """A keystore asked about one topic in many partitions."""
    return rules(title, *listed, default=default, endpoints=IN_PARTITIONS)


PARTITIONS = (
    partitioned("allow without partitions", allow(pubsub(A))),
    partitioned("allow in p", allow(pubsub(A, partitions=P))),
    partitioned("allow in p and q", allow(pubsub(A, partitions=BOTH))),
    partitioned("allow in the empty partition", allow(pubsub(A, partitions=("",)))),
    partitioned("allow in p and the empty one", allow(pubsub(A, partitions=("p", "")))),
    partitioned("allow in every partition", allow(pubsub(A, partitions=("*",)))),
    partitioned("allow in p*", allow(pubsub(A, partitions=("p*",)))),
    partitioned("allow in ?", allow(pubsub(A, partitions=("?",)))),
    partitioned("allow in [pq]", allow(pubsub(A, partitions=("[pq]",)))),
    partitioned("allow in \\*", allow(pubsub(A, partitions=("\\*",)))),
    partitioned("allow in [*]", allow(pubsub(A, partitions=("[*]",)))),
    partitioned("allow in p by one rule, in q by the next", allow(pub(A, partitions=P)), allow(pub(A, partitions=Q))),
    partitioned("allow in p by one criterion, in q by the next", allow(pub(A, partitions=P), pub(A, partitions=Q))),
    partitioned("another topic's partition", allow(pub(A, partitions=P), pub(B, partitions=Q))),
    partitioned("another topic without partitions", allow(pub(A, partitions=P), pub(B))),
    partitioned("without partitions beside another topic's", allow(pub(A), pub(B, partitions=P))),
    partitioned("partitions of the other kind", allow(pub(A), sub(A, partitions=P))),
    partitioned("wrong partition, then a rule without", allow(pub(A, partitions=Q)), allow(pubsub(A))),
    partitioned("wrong partition, then a deny", allow(pub(A, partitions=Q)), deny(pub(A)), allow(pubsub(A))),
    partitioned("wrong partition, default allow", allow(pub(A, partitions=Q)), default="ALLOW"),
    partitioned("all in one rule", allow(pub(A, partitions=P)), allow(pub(A, partitions=("q", "p")))),
    partitioned("deny in p", deny(pub(A, partitions=P)), allow(pub(A, partitions=("*",)))),
    partitioned("deny in p after the allow", allow(pub(A, partitions=("*",))), deny(pub(A, partitions=P))),
    partitioned("deny without partitions", deny(pub(A)), allow(pub(A, partitions=("*",)))),
    partitioned("deny in every partition", deny(pub(A, partitions=("*",))), allow(pub(A, partitions=("*",)))),
    partitioned("deny in p*", deny(pub(A, partitions=("p*",))), allow(pub(A, partitions=("*",)))),
    partitioned("deny in the empty one", deny(pub(A, partitions=("",))), allow(pub(A, partitions=("*",)))),
    partitioned(
        "deny in p behind an allow of another partition",
        allow(pub(A, partitions=Q)),
        deny(pub(A, partitions=P)),
        allow(pub(A, partitions=("*",))),
    ),
    partitioned(
        "deny publish in p behind a subscribe",
        allow(sub(A)),
        deny(pub(A, partitions=P)),
        allow(pubsub(A, partitions=("*",))),
    ),
    partitioned("deny in p, default allow", JOINS, deny(pub(A, partitions=P)), default="ALLOW"),
    partitioned("deny subscribe in p", deny(sub(A, partitions=P)), allow(pubsub(A, partitions=("*",)))),
    partitioned("deny of another kind in p", deny(pub(B, partitions=P)), allow(pubsub("*", partitions=("*",)))),
    partitioned("partition in capitals", allow(pub(A, partitions=("P",)))),
    partitioned("partition with blanks", allow(pub(A, partitions=(" p ",)))),
    partitioned(
        "no partition in the element", allow(pub(A).replace("</topics>", "</topics><partitions></partitions>"))
    ),
    rules(
        "semicolons in partitions",
        allow(pub(A, partitions=BOTH)),
        endpoints=(publish(A, "p;q"), publish(A, "p;x"), publish(A, ";"), publish(A, "p;")),
    ),
)

OPEN_READ = topic_rule("rt/a", read=False)
OPEN_WRITE = topic_rule("rt/a", write=False)
OPEN_BOTH = topic_rule("rt/a", read=False, write=False)


def governed(title: str, *topic_rules: str, rules: tuple[str, ...] = (JOINS,), default: str = "DENY") -> Recipe:
    """A keystore with these topic rules."""
    listed = of_rules(*rules, default=default)
    return Recipe(title=title, governance=of_topics(*topic_rules), permissions=listed, endpoints=ENDPOINTS)


TOPIC_CREATION = (
    governed("read access open", OPEN_READ, topic_rule()),
    governed("write access open", OPEN_WRITE, topic_rule()),
    governed("both open", OPEN_BOTH, topic_rule()),
    governed("read open, publish denied", OPEN_READ, topic_rule(), rules=(deny(pub(A)), JOINS)),
    governed("read open, subscribe denied", OPEN_READ, topic_rule(), rules=(deny(sub(A)), JOINS)),
    governed("write open, publish denied", OPEN_WRITE, topic_rule(), rules=(deny(pubsub(A)), JOINS)),
    governed("read open, publish allowed", OPEN_READ, topic_rule(), rules=(allow(pub(A)),)),
    governed("write open, subscribe allowed", OPEN_WRITE, topic_rule(), rules=(allow(sub(A)),)),
    governed("both open, partitions denied", OPEN_BOTH, rules=(deny(pubsub("*", partitions=("*",))), JOINS)),
    governed("topic without rule", topic_rule("rt/b"), rules=(allow(pubsub("*")),)),
    governed("topic without rule, default allow", topic_rule("rt/b"), default="ALLOW"),
    governed("first topic rule counts", topic_rule(), OPEN_BOTH),
    governed("open before closed", OPEN_BOTH, topic_rule("rt/a"), topic_rule()),
)

CLOSED = domain_rule()
JOINS_FREELY = domain_rule(join=False)
ONE_OPEN = domain_rule(topic_rule("rt/never", write=False), topic_rule())
NO_ALLOW = of_rules(deny(pub("rt/z")))
NO_ALLOW_HERE = of_rules(allow(pubsub("*"), domains=ELSEWHERE))
NO_ALLOW_BY_DEFAULT = of_rules(deny(pub("rt/z")), default="ALLOW")
DENY_ALL_THEN_ALLOW = of_rules(deny(pubsub("*")), allow(pub("rt/z")))

JOIN = tuple(
    Recipe(
        title=f"join: {of_governance}, {of_rules_}", governance=governance(rule), permissions=text, endpoints=ENDPOINTS
    )
    for of_governance, rule in {
        "closed": CLOSED,
        "join control off": JOINS_FREELY,
        "one topic open": ONE_OPEN,
        "join control off and one topic open": domain_rule(
            topic_rule("rt/never", read=False), topic_rule(), join=False
        ),
        "all open": domain_rule(topic_rule(read=False, write=False)),
    }.items()
    for of_rules_, text in {
        "no allow rule": NO_ALLOW,
        "no allow rule for the domain": NO_ALLOW_HERE,
        "no allow rule, default allow": NO_ALLOW_BY_DEFAULT,
        "deny before allow": DENY_ALL_THEN_ALLOW,
    }.items()
)

RECIPES = (*ORDER, *DEFAULTS, *RULE_DOMAINS, *PARTITIONS, *TOPIC_CREATION, *JOIN)
