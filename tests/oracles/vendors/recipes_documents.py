"""What the form of permissions may be, also where a signed file crashes an implementation."""

from __future__ import annotations

from tests.keystore.documents import allow, criterion, domain_rule, governance, permissions, pub, sub
from tests.oracles.vendors.recipe import Recipe, grant, of_rules

PLAIN = of_rules(allow(pub("rt/chatter"), sub("rt/chatter")))


def altered(title: str, old: str, new: str, count: int = 1) -> Recipe:
    """The plain permissions with a text replaced."""
    assert old in PLAIN, old
    return Recipe(title=f"permissions {title}", permissions=PLAIN.replace(old, new, count))


def without(element: str) -> Recipe:
    """The plain permissions without an element (the first of its kind)."""
    start = PLAIN.index(f"<{element} " if f"<{element} " in PLAIN else f"<{element}>")
    end = PLAIN.index(f"</{element}>") + len(element) + 3
    return Recipe(title=f"permissions without {element}", permissions=PLAIN[:start] + PLAIN[end:])


def written(title: str, text: str) -> Recipe:
    """Permissions as they stand."""
    return Recipe(title=f"permissions {title}", permissions=text)


def containers(title: str, first: str, second: str) -> Recipe:
    """Permissions in two containers."""
    end = "</permissions>"
    return written(title, permissions(first).replace(end, f"{end}<permissions>{second}{end}"))


TOPICS = "<topics><topic>rt/chatter</topic></topics>"
PUBLISH = f"<publish>{TOPICS}</publish>"
SUBSCRIBE = f"<subscribe>{TOPICS}</subscribe>"
DOMAINS = "<domains><id>0</id></domains>"
MINE, HALF = grant(allow(pub("rt/chatter"), sub("rt/chatter"))), grant(allow(pub("rt/chatter")))
OTHERS = grant(allow(pub("*")), subject="CN=/listener")
TAGS = "<data_tags><tag><name>n</name><value>v</value></tag></data_tags>"
PARTITION = "<partitions><partition></partition></partitions>"

NO_BREAK = PLAIN.replace("<topic>", "<topic>\u00a0").replace("<default>DENY", "<default> DENY")

MISSING = tuple(
    map(
        without,
        (
            "permissions",
            "grant",
            "subject_name",
            "validity",
            "not_before",
            "not_after",
            "allow_rule",
            "domains",
            "id",
            "publish",
            "subscribe",
            "topics",
            "topic",
            "default",
        ),
    )
)
ORDER = (
    altered("with subscribe before publish", PUBLISH + SUBSCRIBE, SUBSCRIBE + PUBLISH),
    altered(
        "with publish, subscribe, publish", PUBLISH + SUBSCRIBE, PUBLISH + SUBSCRIBE + criterion("publish", "rt/b")
    ),
    altered("with domains last", DOMAINS + PUBLISH, PUBLISH + DOMAINS),
    altered("with domains twice", DOMAINS, "<domains><id>9</id></domains>" + DOMAINS),
    altered("with partitions before topics", TOPICS, PARTITION + TOPICS),
    altered("with partitions", TOPICS, TOPICS + PARTITION),
    altered("with partitions twice", TOPICS, TOPICS + PARTITION + "<partitions><partition>p</partition></partitions>"),
    altered("with topics twice", TOPICS, TOPICS + "<topics><topic>rt/other</topic></topics>"),
    altered("with other topics first", TOPICS, "<topics><topic>rt/other</topic></topics>" + TOPICS),
    altered("with data tags", TOPICS, TOPICS + TAGS),
    altered("with partitions and data tags", TOPICS, TOPICS + PARTITION + TAGS),
    altered("with validity in a criterion", TOPICS, TOPICS + "<validity></validity>"),
    altered(
        "with subjects twice", "<subject_name>CN=/talker", "<subject_name>CN=/x</subject_name><subject_name>CN=/talker"
    ),
    written(
        "with the default before the rules",
        PLAIN.replace("<default>DENY</default>", "").replace("<allow_rule>", "<default>DENY</default><allow_rule>"),
    ),
    written(
        "with the subject after the validity",
        PLAIN.replace("<subject_name>CN=/talker</subject_name>", "").replace(
            "</validity>", "</validity><subject_name>CN=/talker</subject_name>"
        ),
    ),
    containers("with an empty container behind", MINE, ""),
    containers("with a grant in the second container", OTHERS, MINE),
    containers("with a grant in the first container", MINE, OTHERS),
    containers("with a grant in each container", HALF, MINE),
    written("with a first empty container", PLAIN.replace("<permissions>", "<permissions></permissions><permissions>")),
)
FOREIGN = (
    altered("with an unknown element in the grant", "<default>", "<note>x</note><default>"),
    altered("with an unknown element in the rule", DOMAINS, DOMAINS + "<note>x</note>"),
    altered("with an unknown element in the criterion", TOPICS, TOPICS + "<note>x</note>"),
    altered("with an unknown attribute", "<allow_rule>", '<allow_rule id="1">'),
    altered("with another attribute of the grant", "<grant ", '<grant id="1" '),
    written("with a space of no break before topics, out of form", NO_BREAK),
    altered("with a default namespace", "<dds>", '<dds xmlns="http://www.omg.org/spec/DDS-SECURITY">'),
    altered("with a prefix", "<dds>", '<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance">'),
    altered("with another root", "dds>", "permissions_document>", 2),
    altered("with names in capitals", "topic>", "TOPIC>", 4),
    altered("with a comment in a topic", "<topic>rt/", "<topic>rt/<!-- -->"),
    altered("with a comment before a topic", "<topic>rt/", "<topic><!-- -->rt/"),
    altered("with a comment among rules", "<allow_rule>", "<!-- rule --><allow_rule>"),
    altered("with a comment among domains", "<id>0</id>", "<!-- id --><id>0</id>"),
    altered("with a comment among topics", "<topic>", "<!-- topic --><topic>"),
    altered("with a comment before the end", "</permissions>", "<!-- end --></permissions>"),
    altered("with a comment after the permissions", "</permissions>", "</permissions><!-- end -->"),
    altered("with CDATA", "<topic>rt/chatter", "<topic><![CDATA[rt/chatter]]>"),
    altered("with a reference to a character", "<topic>rt/chatter", "<topic>rt&#47;chatter"),
    altered("with an entity", "<dds>", '<!DOCTYPE dds [<!ENTITY t "rt/chatter">]><dds>'),
    altered("with a DOCTYPE", "<dds>", "<!DOCTYPE dds><dds>"),
    altered("with a processing instruction", "<allow_rule>", "<?pi x?><allow_rule>"),
    altered("with text among elements", "<allow_rule>", "text<allow_rule>"),
    altered("without declaration", '<?xml version="1.0" encoding="UTF-8"?>\n', ""),
    altered("of another encoding", "UTF-8", "ISO-8859-1"),
    altered("cut off", "</dds>", ""),
    written("empty", ""),
    written("of blanks", "  \n"),
    written("no XML", "hello"),
    written("of an empty root", "<dds></dds>"),
    written("of a closed root", "<dds/>"),
    written("of no grants", permissions()),
    written("is a governance", governance(domain_rule())),
)
EMPTY = (
    altered("with an empty topic", "<topic>rt/chatter</topic>", "<topic></topic>"),
    altered("with a closed topic", "<topic>rt/chatter</topic>", "<topic/>"),
    altered(
        "with an empty topic beside a good one",
        "<topic>rt/chatter</topic>",
        "<topic>rt/chatter</topic><topic></topic>",
        2,
    ),
    altered("with empty topics", "<topic>rt/chatter</topic>", ""),
    altered("with empty partitions", TOPICS, TOPICS + "<partitions></partitions>"),
    altered("with an empty publish", TOPICS, ""),
    altered("with validity in validity", "<not_before>", "<validity></validity><not_before>"),
    altered("with an empty rule", "<default>", "<deny_rule></deny_rule><default>"),
    written(
        "with a deny rule without domains", PLAIN.replace("<default>", f"<deny_rule>{PUBLISH}</deny_rule><default>")
    ),
)

RECIPES = (*MISSING, *ORDER, *FOREIGN, *EMPTY)
