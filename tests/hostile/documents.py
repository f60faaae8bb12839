"""Facts 4.1: signed XML that parsers read differently, that reaches for other files, or that costs too much."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from typing import Any, Final

from tests.hostile.store import ANY, GOVERNANCE_OF_ALL, PERMISSIONS_OF_VICTIM, Case, Finds, Store, case

P: Final = PERMISSIONS_OF_VICTIM
SUBJECT: Final = b"<subject_name>CN=/victim</subject_name>"
DECLARATION: Final = b'<?xml version="1.0" encoding="UTF-8"?>\n'
RULE: Final = P[P.index(b"<allow_rule>") : P.index(b"</allow_rule>")] + b"</allow_rule>"
GRANT: Final = P[P.index(b"<grant ") : P.index(b"</grant>")] + b"</grant>"
TOPIC: Final = b"<topic>rt/chatter</topic>"
MARK: Final = b"<subject_name>"


def edited(old: bytes, new: bytes) -> Callable[[Store], None]:
    """The victim's permissions with one place changed; `{outside}` and `{url}` in it are where nobody may look."""

    def spoil(store: Store) -> None:
        assert old in P
        text = P.replace(old, new, 1)
        for name, value in ((b"{outside}", str(store.outside).encode()), (b"{url}", store.url.encode())):
            text = text.replace(name, value)
        store.permit(text)

    return spoil


def whole(text: bytes) -> Callable[[Store], None]:
    return lambda store: store.permit(text)


def doctype(declarations: bytes, subject: bytes = SUBJECT) -> Callable[[Store], None]:
    """A document type in front of the root, and something in the grant that uses it."""
    head = DECLARATION + b"<!DOCTYPE dds " + declarations + b">\n"

    def spoil(store: Store) -> None:
        text = head.replace(b"{outside}", str(store.outside).encode()).replace(b"{url}", store.url.encode())
        store.permit(P.replace(DECLARATION, text, 1).replace(SUBJECT, subject, 1))

    return spoil


def typed(name: str, declarations: bytes, subject: bytes = SUBJECT, *secrets: bytes) -> Case:
    return case(name, doctype(declarations, subject), "KA502", at=b"<!DOCTYPE", secrets=secrets)


def ambiguous(
    name: str, spoil: Callable[[Store], None], at: bytes | None = MARK, line: int | None = None, **more: Any
) -> Case:
    return case(name, spoil, "KA502", at=at, line=line, **more)


def invalid(name: str, spoil: Callable[[Store], None], at: bytes = MARK, **more: Any) -> Case:
    """XML that is no permissions document: some implementation refuses it, and of none it is unknown."""
    return case(name, spoil, "KA501", at=at, **{"exit": 1, **more})


def harmless(name: str, spoil: Callable[[Store], None]) -> Case:
    """What only costs time; it is read to the end, and has the one meaning that it says."""
    return case(name, spoil, exit=0)


def _entities(levels: int) -> bytes:
    lines = [b'<!ENTITY e0 "EXPAN"><!ENTITY e1 "&e0;DED">']
    lines += [b'<!ENTITY e%d "%s">' % (level, b"&e%d;" % (level - 1) * 10) for level in range(2, levels)]
    return b"[" + b"\n".join(lines) + b"]"


def _default(attribute: bytes, count: int) -> bytes:
    return b"<default " + b" ".join(attribute % number for number in range(count)) + b">"


XINCLUDE: Final = (
    b'<xi:include xmlns:xi="http://www.w3.org/2001/XInclude" href="file://{outside}/secret" parse="text"/>'
)
USES: Final = b"<subject_name>CN=/&x;</subject_name>"
EXPANDED: Final = (b"EXPANDED",)

TYPES: Final = (
    typed("an external entity that names a file", b'[<!ENTITY x SYSTEM "file://{outside}/secret">]', USES),
    typed("an external entity that names a server", b'[<!ENTITY x SYSTEM "{url}/x">]', USES),
    typed("an external entity that names a device", b'[<!ENTITY x SYSTEM "file:///dev/zero">]', USES),
    typed("a parameter entity that names a file", b'[<!ENTITY % p SYSTEM "file://{outside}/evil.dtd"> %p;]', USES),
    typed(
        "an external document type in a file",
        b'SYSTEM "{outside}/evil.dtd"',
        b"<subject_name>CN=&canary;</subject_name>",
    ),
    typed("an external document type on a server", b'PUBLIC "-//x//y" "{url}/evil.dtd"'),
    typed("a document type without anything in it", b""),
    typed("an internal entity in text", b'[<!ENTITY y "EXPAN"><!ENTITY x "&y;DED">]', USES, *EXPANDED),
    case(
        "an internal entity in an attribute",
        lambda store: store.permit(
            P.replace(DECLARATION, DECLARATION + b'<!DOCTYPE dds [<!ENTITY y "EXPAN"><!ENTITY x "&y;DED">]>\n').replace(
                b'grant name="/victim"', b'grant name="&x;"'
            )
        ),
        "KA502",
        at=b"<!DOCTYPE",
        secrets=EXPANDED,
    ),
    typed("an attribute that the document type sets", b'[<!ATTLIST grant name CDATA "injected">]'),
    typed("a billion laughs", _entities(12), b"<subject_name>&e11;</subject_name>", *EXPANDED),
    typed(
        "a quadratic blow-up",
        b'[<!ENTITY x "' + b"EXPANDED" * 12_000 + b'">]',
        b"<subject_name>" + b"&x;" * 50_000 + b"</subject_name>",
        b"EXPANDED" * 2,
    ),
    ambiguous("an entity that nobody declared", edited(SUBJECT, USES)),
)

VALUES: Final = (
    ambiguous("a comment in a value", edited(SUBJECT, b"<subject_name>CN=/vic<!-- x -->tim</subject_name>"), exit=1),
    ambiguous("an instruction in a value", edited(SUBJECT, b"<subject_name>CN=/vic<?x y?>tim</subject_name>")),
    ambiguous("a CDATA section in a value", edited(SUBJECT, b"<subject_name>CN=/<![CDATA[victim]]></subject_name>")),
    ambiguous("a C1 control character", edited(SUBJECT, "<subject_name>CN=/vic\u009btim</subject_name>".encode())),
    ambiguous(
        "a character that turns the line around",
        edited(SUBJECT, "<subject_name>CN=/\u202emitciv</subject_name>".encode()),
    ),
    ambiguous("blanks around a value", edited(SUBJECT, b"<subject_name> CN=/victim </subject_name>"), exit=1),
    invalid("an element in no place for one", edited(SUBJECT, SUBJECT + XINCLUDE), at=SUBJECT, exit=4),
    invalid(
        "a value that declares another type", edited(b"<default>", b'<default xsi:type="xsi:string">'), at=b"<default"
    ),
    invalid("a value that declares itself nil", edited(b"<default>", b'<default xsi:nil="true">'), at=b"<default"),
    case("an empty topic", edited(TOPIC, b"<topic/>"), "KA517", at=b"<topic/>"),
    *(
        ambiguous(f"the domain {shown}", edited(b"<id>0</id>", b"<id>%b</id>" % shown.encode()), at=b"<id>", exit=code)
        for shown, code in (("+0", 0), ("00", 0), (" 0 ", 0), ("-0", 4), ("1" + "0" * 22, 4), ("233", 1))
    ),
    *(
        ambiguous(f"the date {date}", edited(b"2034-01-01T00:00:00", date.encode()), at=b"<not_after>")
        for date in ("99999-01-01T00:00:00", "-0001-01-01T00:00:00")
    ),
    # Cyclone DDS: beyond 63 bits of nanoseconds.
    case(
        "the date that has no second after it",
        edited(b"2034-01-01T00:00:00", b"9999-12-31T23:59:59"),
        "KA612",
        at=b"<not_after>",
        exit=1,
    ),
    invalid("a date that there is not", edited(b"2034-01-01T00:00:00", b"2034-02-30T00:00:00"), at=b"<not_after>"),
    invalid("a date of words", edited(b"2034-01-01T00:00:00", b"for ever"), at=b"<not_after>"),
)

ENCODINGS: Final = (
    case("UTF-16", whole(P.decode().replace("UTF-8", "UTF-16").encode("utf-16")), "KA305", at=b"\xff\xfe<"),
    case("UTF-16 that says UTF-8", whole(P.decode().encode("utf-16-be")), "KA305", at=b"\x00<\x00?"),
    ambiguous(
        "ISO-8859-1", whole(P.replace(b"UTF-8", b"ISO-8859-1").replace(b"CN=/victim", b"CN=/v\xefctim")), at=b"<?xml"
    ),
    ambiguous("UTF-7", whole(P.replace(b"UTF-8", b"UTF-7")), at=b"<?xml"),
    ambiguous("an encoding that there is not", whole(P.replace(b"UTF-8", b"x-" + b"no" * 2_000)), at=b"<?xml"),
    ambiguous("EBCDIC", whole(P.replace(b"UTF-8", b"cp500").decode().encode("cp500")), line=9, at=None),
    ambiguous("a byte order mark", whole(b"\xef\xbb\xbf" + P), at=b"<?xml"),
    ambiguous("two byte order marks", whole(b"\xef\xbb\xbf" * 2 + P), at=b"<?xml"),
    ambiguous("bytes that are no UTF-8", edited(SUBJECT, b"<subject_name>CN=/v\xffctim</subject_name>")),
    ambiguous("UTF-8 that is too long", edited(SUBJECT, b"<subject_name>CN=/v\xc0\xafctim</subject_name>")),
    ambiguous("half of a surrogate pair", edited(SUBJECT, b"<subject_name>CN=/\xed\xa0\x80</subject_name>")),
    ambiguous("XML 9.9 in small letters", edited(b'version="1.0"', b"version='9'"), at=b"<?xml"),
    ambiguous("an escape byte", edited(SUBJECT, b"<subject_name>CN=/\x1b[31m</subject_name>")),
    ambiguous("a reference to an escape byte", edited(SUBJECT, b"<subject_name>CN=/&#27;</subject_name>")),
    ambiguous("a reference to NUL", edited(SUBJECT, b"<subject_name>CN=/&#0;</subject_name>")),
    case("a NUL in a value", edited(SUBJECT, b"<subject_name>CN=/vic\x00tim</subject_name>"), "KA305", at=MARK),
    case("a NUL behind the root", whole(P + b"\x00<dds/>"), "KA305", at=b"\x00<dds/>"),
)

STRUCTURE: Final = (
    ambiguous("a second root", whole(P + b"<dds>two</dds>\n"), at=b"<dds>two"),
    ambiguous("no root", whole(b"<!-- nothing -->"), at=b"<!-- nothing -->"),
    case("an empty document", whole(b""), "KA521", line=9),
    ambiguous("a document cut off", whole(P[: P.index(b"</validity>")]), at=b"<validity>"),
    ambiguous("a namespace", edited(b"<permissions>", b'<permissions xmlns="urn:x">'), at=b"<permissions", exit=1),
    invalid("another root", whole(re.sub(rb"(?s)<dds .*</dds>", b"<DDS/>", P)), at=b"<DDS/>", exit=4),
    case(
        "a schema of the attacker's in a file",
        edited(
            b"http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_permissions.xsd", b"file://{outside}/evil.xsd"
        ),
        exit=0,
    ),
    case(
        "a schema of the attacker's on a server, and a document that is invalid",
        edited(
            P[P.index(b"http://www.omg.org") : P.index(b"<validity>")],
            b'{url}/evil.xsd" xsi:schemaLocation="urn:x {url}/evil.xsd">\n<permissions><grant name="x">',
        ),
        "KA501",
        at=b"<grant",
        exit=1,
    ),
    invalid("a doubled element", edited(SUBJECT, SUBJECT + b"\n" + SUBJECT), at=b"\n" + SUBJECT),
    Case(
        "a rule without its domains",
        edited(b"<domains><id>0</id></domains>", b""),
        (Finds("KA518", at=b"<allow_rule>"), Finds("KA501", at=b"<publish>")),
    ),
)

COSTS: Final = (
    case("a text of 11 MB", edited(TOPIC, b"<topic>" + b"x" * (11 << 20) + b"</topic>"), "KA106"),
    harmless("a text of 3 MB", edited(TOPIC, b"<topic>" + b"x" * (3 << 20) + b"</topic>")),
    harmless("an attribute of 3 MB", edited(b'name="/victim"', b'name="' + b"x" * (3 << 20) + b'"')),
    ambiguous("300 elements in one another", edited(TOPIC, b"<topic>" * 300 + b"</topic>" * 300), at=b"<topic>"),
    ambiguous("300,000 elements in one another", edited(TOPIC, b"<a>" * 300_000), line=9, at=None),
    ambiguous("a million elements", edited(TOPIC, b"<a/>" * 1_000_000), line=9, at=None),
    invalid("90,000 elements that the schema does not know", edited(TOPIC, b"<a/>" * 90_000), at=b"<a/>"),
    ambiguous("100,000 attributes", edited(b"<default>", _default(b'a%d=""', 100_000)), line=9, at=None),
    ambiguous("30,000 namespaces", edited(b"<default>", _default(b'xmlns:a%d="u"', 30_000)), at=b"<default", exit=1),
    harmless("80,000 comments", edited(b"<permissions>", b"<permissions>" + b"<!-- -->" * 80_000)),
    ambiguous(
        "400,000 CDATA sections",
        edited(SUBJECT, b"<subject_name>" + b"<![CDATA[" * 400_000 + b"]]></subject_name>"),
        line=9,
        at=None,
    ),
    ambiguous("a tag that is never closed, of 3 MB", edited(TOPIC, b"<" + b"x" * (3 << 20)), at=b"<publish>"),
    harmless(
        "10,000 topics of one grant", edited(TOPIC, b"".join(b"<topic>rt/t%d</topic>\n" % i for i in range(10_000)))
    ),
    case(
        "95,000 topics of one grant",
        edited(TOPIC, b"".join(b"<topic>rt/t%d</topic>\n" % i for i in range(95_000))),
        "KA502",
        at=b"<topic>rt/t10000<",
    ),
)


def _topics(*topics: str) -> Callable[[Store], None]:
    return edited(TOPIC, b"".join(b"<topic>%s</topic>\n" % topic.encode() for topic in topics))


def _partitions(text: bytes, count: int) -> Callable[[Store], None]:
    listed = b"".join(b"<partition>%s</partition>\n" % (text % number) for number in range(count))
    return edited(b"</topics>", b"</topics><partitions>" + listed + b"</partitions>")


def _criteria(count: int) -> bytes:
    """A topic and a partition each."""
    return b"".join(
        b"<publish><topics><topic>rt/t%d</topic></topics><partitions><partition>p%d</partition></partitions></publish>\n"
        % (number, number)
        for number in range(count)
    )


def _denials(count: int) -> Callable[[Store], None]:
    """Rules that deny a topic each, with a default that allows."""
    deny = RULE.replace(b"allow_rule", b"deny_rule")
    rules = b"\n".join(deny.replace(b"chatter", b"t%d" % number) for number in range(count))
    return whole(P.replace(RULE, rules, 1).replace(b"<default>DENY", b"<default>ALLOW"))


def _in_domains(domains: int, each: int) -> Callable[[Store], None]:
    """A rule for each of so many topics of its own in each domain, below a governance for all domains."""
    rules = b"\n".join(
        RULE.replace(b"<id>0", b"<id>%d" % domain).replace(b"chatter", b"t%d_%d" % (domain, number))
        for domain in range(domains)
        for number in range(each)
    )

    def spoil(store: Store) -> None:
        store.permit(P.replace(RULE, rules, 1))
        every = b"<id_range><min>0</min><max>232</max></id_range>"
        store.govern(re.sub(rb"(<domains>).*?(</domains>)", rb"\g<1>%s\2" % every, GOVERNANCE_OF_ALL, flags=re.DOTALL))

    return spoil


PUBLISH: Final = P[P.index(b"<publish>") : P.index(b"</publish>")] + b"</publish>"
EXPRESSIONS: Final = (
    case(
        "20 topics that multiply the states of the automaton",
        _topics(*("*".join(("", *random.Random(number).choices("abc", k=12), "")) for number in range(20))),
        bystander_changes=True,
    ),
    harmless("199 topics of 1 to 199 question marks", _topics(*("?" * length for length in range(1, 200)))),
    case("a topic of 3,000,000 question marks", _topics("?" * 3_000_000), "KA502", at=b"<topic>?"),
    case("300 topics of 1,000 sets of characters", _topics(*["[!a-z]" * 1_000] * 300), "KA502", line=ANY),
    harmless("a topic of 500 stars", _topics("*a" * 500)),
    harmless("1,000 rules", edited(RULE, RULE * 1_000)),
    # More than are read: undecided.
    case(
        "1,001 rules",
        edited(RULE, RULE * 1_000 + b"\n" + RULE.replace(b"allow_rule", b"deny_rule")),
        "KA502",
        at=b"<deny_rule>",
    ),
    # Was killed after ten seconds.
    case("14,000 rules that deny, below a default that allows", _denials(14_000), "KA502", line=ANY),
    case("1,000 rules that deny, below a default that allows", _denials(1_000), "KA637", line=ANY, exit=1),
    case(
        "1,000 rules about relaying",
        edited(
            RULE,
            b"\n".join(
                RULE.replace(b"publish>", b"relay>").replace(b"chatter", b"t%d" % number) for number in range(1_000)
            ),
        ),
        "KA609",
        line=ANY,
        exit=1,
    ),
    harmless("1,500 topics that begin differently", _topics(*(f"rt/t{number}*" for number in range(1_500)))),
    harmless("1,500 topics that end differently", _topics(*(f"rt/*{number}" for number in range(1_500)))),
    harmless(
        "1,000 rules that allow and deny in turn",
        edited(
            RULE,
            b"\n".join(
                (RULE if number % 2 else RULE.replace(b"allow_rule", b"deny_rule")).replace(b"chatter", b"t%d" % number)
                for number in range(1_000)
            ),
        ),
    ),
    harmless(
        "half of 5,000 services",  # was killed after ten seconds
        _topics(*(name for number in range(5_000) for name in (f"rq/s{number}Request", f"rr/s{number}Reply"))),
    ),
    harmless("10,000 partitions", _partitions(b"p%d", 10_000)),
    case("20,000 partitions", _partitions(b"p%d", 20_000), "KA502", at=b"<partition>p10000<"),
    harmless("1,500 partitions that begin differently", _partitions(b"p%d*", 1_500)),
    case("3,000 partitions that begin differently", _partitions(b"p%d*", 3_000), "KA502", at=b"<partition>p1500*"),
    harmless(
        "900 topics in 900 partitions",
        edited(
            PUBLISH,
            b"<publish><topics>"
            + b"".join(b"<topic>rt/t%d</topic>\n" % number for number in range(900))
            + b"</topics><partitions>"
            + b"".join(b"<partition>p%d</partition>\n" % number for number in range(900))
            + b"</partitions></publish>",
        ),
    ),
    # More pairs than are told apart: undecided.
    case("900 topics, each in a partition of its own", edited(PUBLISH, _criteria(900)), bystander_changes=True),
    case("1,000 grants for one subject", edited(GRANT, (GRANT + b"\n") * 1_000), "KA504", line=ANY, exit=1),
    case("1,001 grants for one subject", edited(GRANT, (GRANT + b"\n") * 1_001), "KA502", line=ANY),
    case(
        "1,000 rules for 26 domains",
        _in_domains(26, 38),
        "KA416",
        "enclaves/victim/governance.p7s",
        exit=1,
        bystander_changes=True,
    ),
    # Undecided.
    case("1,000 rules for 100 domains", _in_domains(100, 10), bystander_changes=True),  # undecided
)

GOVERNANCES: Final = tuple(
    case(
        f"a governance with {what}",
        lambda store, text=text: store.govern(text),
        code,
        "enclaves/victim/governance.p7s",
        at=at,
        exit=4 if b"<!DOCTYPE" in text or b"two</dds>" in text else 1,
    )
    for what, text, code, at in (
        (
            "an external entity",
            GOVERNANCE_OF_ALL.replace(b"<dds ", b'<!DOCTYPE dds [<!ENTITY x SYSTEM "file:///dev/zero">]>\n<dds ', 1),
            "KA402",
            b"<!DOCTYPE",
        ),
        ("a comment in a value", GOVERNANCE_OF_ALL.replace(b">SIGN<", b">SI<!-- -->GN<"), "KA402", b">SI<!--"),
        ("a second root", GOVERNANCE_OF_ALL + b"<dds>two</dds>", "KA402", b"<dds>two"),
        (
            "another order",
            re.sub(rb"( *<rtps.*\n)(?s:(.*)</domain_rule>)", rb"\2\1</domain_rule>", GOVERNANCE_OF_ALL),
            "KA401",
            b"<topic_access_rules>",
        ),
        ("a kind that there is not", GOVERNANCE_OF_ALL.replace(b">SIGN<", b">SIGNED<"), "KA401", b">SIGNED<"),
    )
)


def _domain_rule(number: int) -> bytes:
    return DOMAIN_RULE.replace(b"<id>0", b"<id>%d" % (number % 233))


DOMAIN_RULE: Final = GOVERNANCE_OF_ALL[GOVERNANCE_OF_ALL.index(b"<domain_rule>") :].partition(b"</domain_rule>")[0]


def _domain_rules(count: int) -> Callable[[Store], None]:
    rules = b"</domain_rule>".join(_domain_rule(number) for number in range(count))
    return lambda store: store.govern(GOVERNANCE_OF_ALL.replace(DOMAIN_RULE, rules, 1))


DOMAIN_RULES: Final = (
    *(
        case(
            f"a governance of {count:,} domain rules",
            _domain_rules(count),
            "KA416",
            "enclaves/victim/governance.p7s",
            exit=1,
            bystander_changes=True,
        )
        for count in (200, 1_000)
    ),
    case(
        "a governance of 4,000 domain rules", _domain_rules(4_000), "KA402", "enclaves/victim/governance.p7s", line=ANY
    ),
)

TOPIC_RULE: Final = DOMAIN_RULE[DOMAIN_RULE.index(b"<topic_rule>") :].partition(b"</topic_rule>")[0] + b"</topic_rule>"
TOPIC_RULES: Final = case(
    "a governance of 1,000 topic rules that begin differently",
    lambda store: store.govern(
        GOVERNANCE_OF_ALL.replace(
            TOPIC_RULE,
            b"".join(
                re.sub(rb"(<topic_expression>)[^<]*", rb"\g<1>rt/t%d*" % number, TOPIC_RULE) for number in range(1_000)
            ),
            1,
        )
    ),
    "KA418",
    "enclaves/victim/governance.p7s",
    line=ANY,
    exit=1,
    bystander_changes=True,
)
# Undecided.
TOPIC_RULES_EVERYWHERE: Final = case(
    "a governance of 4 topic rules for each of 230 domains",
    lambda store: store.govern(
        GOVERNANCE_OF_ALL.replace(
            DOMAIN_RULE,
            b"</domain_rule>".join(
                _domain_rule(domain).replace(
                    TOPIC_RULE,
                    b"".join(
                        re.sub(rb"(<topic_expression>)[^<]*", rb"\g<1>rt/t%d_%d*" % (domain, number), TOPIC_RULE)
                        for number in range(4)
                    ),
                )
                for domain in range(230)
            ),
            1,
        )
    ),
    bystander_changes=True,
)
LATE_DOMAINS: Final = case(
    "a governance of 770 rules for one domain, then one for each other",
    lambda store: store.govern(
        GOVERNANCE_OF_ALL.replace(
            DOMAIN_RULE, b"</domain_rule>".join([DOMAIN_RULE] * 770 + [_domain_rule(n) for n in range(1, 230)]), 1
        )
    ),
    "KA416",
    "enclaves/victim/governance.p7s",
    exit=1,
    bystander_changes=True,
)


CASES: Final = (
    TYPES
    + VALUES
    + ENCODINGS
    + STRUCTURE
    + COSTS
    + EXPRESSIONS
    + GOVERNANCES
    + DOMAIN_RULES
    + (TOPIC_RULES, TOPIC_RULES_EVERYWHERE, LATE_DOMAINS)
)
