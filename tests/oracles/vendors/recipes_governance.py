"""Governance: which domain and topic rule counts, ranges of ids, values, and what its form may be."""

from __future__ import annotations

from tests.keystore.documents import allow, deny, domain_rule, governance, ids, pub, pubsub, sub, topic_rule
from tests.oracles.vendors.enclave import Endpoint, publish, subscribe
from tests.oracles.vendors.recipe import CHATTER, Recipe, of_rules, of_topics

A, B = "rt/a", "rt/b"
TOPICS = (publish(A), subscribe(A), publish(B), subscribe(B))
OPEN = topic_rule(read=False, write=False)
JOINS = of_rules(allow(pub("rt/z")))
DENIED = of_rules(deny(pubsub("*")), allow(sub("z")))
ALL_BY_DEFAULT = of_rules(default="ALLOW")
EVERYTHING = of_rules(allow(pubsub("*")))


def governed(
    title: str, document: str, rights: str = JOINS, *, domain: int = 0, endpoints: tuple[Endpoint, ...] = TOPICS
) -> Recipe:
    """A keystore with this governance."""
    return Recipe(title=title, governance=document, permissions=rights, domain=domain, endpoints=endpoints)


DOMAIN_RULES = (
    governed("first domain rule counts", governance(domain_rule(), domain_rule(OPEN))),
    governed("first domain rule counts, open", governance(domain_rule(OPEN), domain_rule())),
    governed("first domain rule of another domain", governance(domain_rule(domains=ids(3)), domain_rule(OPEN))),
    governed("no rule for the domain", governance(domain_rule(domains=ids(3))), EVERYTHING),
    governed("no rule for the domain, default allow", governance(domain_rule(domains=ids(3))), ALL_BY_DEFAULT),
    governed("no rule for the domain, open elsewhere", governance(domain_rule(OPEN, domains=ids(3)))),
    governed("no fall-through to a second domain rule", governance(domain_rule(topic_rule("rt/b")), domain_rule(OPEN))),
    governed("two ids", governance(domain_rule(OPEN, domains=ids(3, 0)))),
)

RANGES = tuple(
    Recipe(
        title=f"range {low}..{high} in domain {domain}, {part}",
        governance=governance(domain_rule(domains=entry if part == "governance" else ids((0, 230)))),
        permissions=of_rules(allow(pubsub("*"), domains=entry if part == "permissions" else ids((0, 230)))),
        domain=domain,
        endpoints=CHATTER,
    )
    for low, high, asked in (
        (0, 230, (0, 230)),
        (2, 4, (1, 2, 3, 4, 5)),
        (2, None, (1, 2, 3)),
        (0, None, (0, 1)),
        (None, 4, (0, 4, 5)),
        (5, 0, (0, 3, 5)),
        (5, 2, (3, 5)),
        (3, 3, (3,)),
        (0, 231, (0,)),
        (0, 232, (0,)),
    )
    for entry in (ids((low, high)),)
    for domain in asked
    for part in ("governance", "permissions")
)


def of_ids(title: str, text: str, *, domain: int = 0) -> Recipe:
    """A keystore with this set of domains."""
    return Recipe(
        title=f"domains {title}",
        governance=governance(domain_rule(domains=text)),
        permissions=of_rules(allow(pubsub("*"), domains=text)),
        domain=domain,
    )


IDS = (
    of_ids("of id 230", "<id>230</id>", domain=230),
    of_ids("of id 231", "<id>231</id>", domain=231),
    of_ids("of id 0 and 231", "<id>0</id><id>231</id>"),
    of_ids("of id 232", "<id>0</id><id>232</id>", domain=232),
    of_ids("of id 0 and a range of 5 to 0", "<id>0</id><id_range><min>5</min><max>0</max></id_range>"),
    of_ids("of id 0 and 430", "<id>0</id><id>430</id>"),
    of_ids("of a range to 430", "<id_range><min>0</min><max>430</max></id_range>", domain=9),
    of_ids("of id 231 by a range from 0", "<id_range><min>0</min><max>230</max></id_range>", domain=231),
    of_ids("with leading zeros", "<id>00</id>"),
    of_ids("with a sign", "<id>+0</id>"),
    of_ids("negative", "<id>-1</id>"),
    of_ids("with blanks", "<id> 0 </id>"),
    of_ids("in hexadecimal", "<id>0x0</id>"),
    of_ids("with an empty id", "<id></id>"),
    of_ids("empty", ""),
    of_ids("as an empty range", "<id_range></id_range>"),
    of_ids("as a range of maximum first", "<id_range><max>4</max><min>0</min></id_range>"),
    of_ids("beyond 32 bits", "<id>4294967296</id>"),
    of_ids("with a word", "<id>zero</id>"),
    of_ids("range, then id", "<id_range><min>3</min><max>4</max></id_range><id>0</id>"),
)


def topics(title: str, *rules: str, rights: str = JOINS) -> Recipe:
    """A keystore with these topic rules."""
    return governed(f"topic rules: {title}", of_topics(*rules), rights)


TOPIC_RULES = (
    topics("first counts", topic_rule("rt/a"), OPEN, rights=JOINS),
    topics("wildcard first", topic_rule("rt/*"), OPEN),
    topics("open literal before closed", topic_rule("rt/a", read=False, write=False), topic_rule()),
    topics("open read and write by different rules", topic_rule("rt/a", read=False), topic_rule("rt/a", write=False)),
    topics("none matches", topic_rule("rt/z"), rights=EVERYTHING),
    topics("topic as expression, open", topic_rule("rt/a", read=False, write=False), topic_rule(), rights=JOINS),
    topics("topic as expression, closed", topic_rule("rt/a"), OPEN),
    topics("set against a wildcard topic", topic_rule("rt/[ab]", read=False, write=False), topic_rule()),
    topics("blanks round the expression", topic_rule(" rt/a ", read=False, write=False), topic_rule()),
    topics("negated set", topic_rule("rt/[!a]", read=False, write=False), topic_rule()),
    topics("question mark", topic_rule("rt/?", read=False, write=False), topic_rule()),
    topics("read open, permissions deny", topic_rule(read=False), rights=DENIED),
    topics("write open, permissions deny", topic_rule(write=False), rights=DENIED),
    topics("all open, permissions deny", OPEN, rights=DENIED),
)

BY_ORIGIN = ("SIGN_WITH_ORIGIN_AUTHENTICATION", "ENCRYPT_WITH_ORIGIN_AUTHENTICATION")
KINDS = tuple(
    Recipe(
        title=f"{kind} kind {value}",
        governance=governance(rule),
        permissions=JOINS.replace("rt/z", A),
        endpoints=TOPICS[:2],
    )
    for kind, value, rule in (
        *(("rtps", v, domain_rule(rtps=v)) for v in ("NONE", "ENCRYPT", "sign", "", " SIGN ", *BY_ORIGIN)),
        *(("rtps", v, domain_rule(rtps=v)) for v in ("SIGNED",)),
        *(("discovery", v, domain_rule(discovery=v)) for v in ("NONE", "SIGN", "Encrypt", "")),
        *(("liveliness", v, domain_rule(liveliness=v)) for v in ("NONE", "SIGN", "ALL", "")),
        *(("metadata", v, domain_rule(topic_rule(metadata=v))) for v in ("NONE", "SIGN", "none", "")),
        *(("data", v, domain_rule(topic_rule(data=v))) for v in ("NONE", "SIGN", "", *BY_ORIGIN)),
    )
)

FLAGS = tuple(
    Recipe(title=f"{name} {value!r}", governance=governance(rule), permissions=JOINS, endpoints=TOPICS[:2])
    for value in ("TRUE", "True", "tRuE", "1", "FALSE", "0", " true ", "yes", "", "2")
    for name, rule in (
        ("join access control", domain_rule(join=value)),
        ("read access control", domain_rule(topic_rule(read=value))),
        ("write access control", domain_rule(topic_rule(write=value))),
        ("unauthenticated", domain_rule(unauthenticated=value, rtps="NONE")),
    )
)

UNAUTHENTICATED = tuple(
    Recipe(
        title=f"unauthenticated allowed beside rtps {kind}",
        governance=governance(domain_rule(unauthenticated=True, rtps=kind)),
    )
    for kind in ("NONE", "SIGN", "ENCRYPT", *BY_ORIGIN)
)

PLAIN = governance()
CLOSING = "</domain_access_rules>"
SECOND = domain_rule(domains=ids(9))


def altered(title: str, old: str, new: str, count: int = 1) -> Recipe:
    """The stock governance with a text replaced."""
    assert old in PLAIN, old
    return Recipe(title=f"governance {title}", governance=PLAIN.replace(old, new, count))


def without(element: str) -> Recipe:
    """The stock governance without an element."""
    start, end = PLAIN.index(f"<{element}>"), PLAIN.index(f"</{element}>") + len(element) + 3
    return Recipe(title=f"governance without {element}", governance=PLAIN[:start] + PLAIN[end:])


READ = "<enable_read_access_control>true</enable_read_access_control>"
OPEN_READ = READ.replace("true", "false")
WRITE = "<enable_write_access_control>true</enable_write_access_control>"
FORM = (
    *map(
        without,
        (
            "domain_access_rules",
            "domain_rule",
            "domains",
            "allow_unauthenticated_participants",
            "enable_join_access_control",
            "discovery_protection_kind",
            "liveliness_protection_kind",
            "rtps_protection_kind",
            "topic_access_rules",
            "topic_rule",
            "topic_expression",
            "enable_discovery_protection",
            "enable_liveliness_protection",
            "enable_read_access_control",
            "enable_write_access_control",
            "metadata_protection_kind",
            "data_protection_kind",
        ),
    ),
    altered("with controls swapped", READ + WRITE, WRITE + READ),
    altered("with an element twice", READ, READ + READ),
    governed("governance with contradicting elements, closed first", PLAIN.replace(READ, READ + OPEN_READ)),
    governed("governance with contradicting elements, open first", PLAIN.replace(READ, OPEN_READ + READ)),
    altered("with an unknown element", READ, READ + "<enable_key_revision>true</enable_key_revision>"),
    altered("with an attribute", "<domain_rule>", '<domain_rule id="x">'),
    altered("with a default namespace", "<dds>", '<dds xmlns="http://www.omg.org/spec/DDS-SECURITY">'),
    altered("with a schema", "<dds>", '<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance">'),
    altered("with another root", "dds>", "DDS>", 2),
    altered("with names in capitals", "topic_rule>", "Topic_Rule>", 2),
    altered("with a comment in a rule", READ, "<!-- read -->" + READ),
    altered("with a comment at the end", "</domain_access_rules>", "</domain_access_rules><!-- end -->"),
    altered("with a comment before the rules", "<domain_access_rules>", "<!-- rules --><domain_access_rules>"),
    altered("with a comment in a value", "<topic_expression>*", "<topic_expression>rt/<!-- -->*"),
    altered("with CDATA", "<topic_expression>*", "<topic_expression><![CDATA[*]]>"),
    altered("with a DOCTYPE", "<dds>", "<!DOCTYPE dds><dds>"),
    altered("with a processing instruction", "<domain_rule>", "<?pi x?><domain_rule>"),
    altered("with text among elements", "<domain_rule>", "text<domain_rule>"),
    altered(
        "with two containers",
        "</domain_access_rules>",
        f"</domain_access_rules><domain_access_rules>{SECOND}</domain_access_rules>",
    ),
    altered(
        "with an empty container behind",
        "</domain_access_rules>",
        "</domain_access_rules><domain_access_rules></domain_access_rules>",
    ),
    altered(
        "with an empty container first",
        "<domain_access_rules>",
        "<domain_access_rules></domain_access_rules><domain_access_rules>",
    ),
    governed(
        "governance with the domain in the second container",
        governance(SECOND).replace(CLOSING, f"{CLOSING}<domain_access_rules>{domain_rule()}{CLOSING}"),
        of_rules(allow(pub(A))),
    ),
    altered("with an empty topic expression", "<topic_expression>*", "<topic_expression>"),
    altered("cut off", "</dds>", ""),
    Recipe(title="governance empty", governance=""),
    Recipe(title="governance is permissions", governance=of_rules(allow(pub(A)))),
)

RECIPES = (*DOMAIN_RULES, *RANGES, *IDS, *TOPIC_RULES, *KINDS, *FLAGS, *UNAUTHENTICATED, *FORM)
