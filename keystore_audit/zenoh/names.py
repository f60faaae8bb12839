"""The rights that are asked about one by one: of the names that permissions and the rules of processes write out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from msgspec import Struct

from keystore_audit.intent.intent import is_ros_name
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.typed import PermissionsFile
from keystore_audit.model.matching.expression import has_wildcard
from keystore_audit.model.names import DISCOVERY_TOPIC, SUFFIX_OF, TOPIC_PREFIX, is_ros_dds_name
from keystore_audit.zenoh.access_control import Kind, Rule
from keystore_audit.zenoh.network import Network, Process

MAX_RIGHTS: Final = 2_000
"""Rights that are asked one by one: some 15 seconds among 40 processes."""

OTHER_SIDE: Final = {"publish": "subscribe", "subscribe": "publish", "request": "reply", "reply": "request"}
"""By operation that of whom it reaches."""

_OF_TOPICS: Final = ("publish", "subscribe")
_OF_SERVICES: Final = ("request", "reply")
_ANY: Final = "any"
_SERVING: Final = frozenset(each.value for each in (Kind.QUERY, Kind.REPLY, Kind.SERVE))
_SENDING: Final = frozenset(each.value for each in (Kind.PUT, Kind.DELETE, Kind.SUBSCRIBE))


class Named(Struct, frozen=True):
    """`rights`: operation and name of ROS 2, of topics and services (an action is several).

    `patterns`: expressions that stand for more names than one, which are not compared with each other. Of those of
    rules one name is asked, with `any` for wildcards; of those of permissions the names that others write out.
    """

    rights: tuple[tuple[str, str], ...]
    patterns: tuple[str, ...]


def written_names(keystore: Keystore, network: Network, domain: int) -> Named:
    """What permissions name in any domain, and the rules of processes that start in this one."""
    documents = (each.permissions for each in keystore.enclaves if each.permissions is not None)
    rights: dict[tuple[str, str], None] = {}
    patterns: dict[str, None] = {}
    for text, name, operations in (*_in_documents(documents), *_in_rules(network, domain)):
        if name is None:
            patterns[text] = None
        else:
            rights |= {(operation, name): None for operation in operations}
    return Named(tuple(sorted(rights, key=lambda each: each[1])), tuple(patterns))


def names_in(documents: Iterable[PermissionsFile]) -> tuple[tuple[str, str], ...]:
    """Operation and name of ROS 2 of all that documents write out, in any domain."""
    written = ((name, operations) for _text, name, operations in _in_documents(documents) if name is not None)
    return tuple(dict.fromkeys((operation, name) for name, operations in written for operation in operations))


_Written = tuple[str, str | None, tuple[str, ...]]
"""An expression, the one name that it is (None: it is a pattern), and what can be done with it."""


def _in_documents(documents: Iterable[PermissionsFile]) -> Iterator[_Written]:
    grants = (grant for file in documents for read in file.readings.distinct for grant in read.grants)
    criteria = (criterion for grant in grants for rule in grant.rules for criterion in rule.criteria)
    for text in dict.fromkeys(topic.text for criterion in criteria for topic in criterion.topics):
        if has_wildcard(text):
            yield text, None, ()
        elif is_ros_dds_name(text) and text != DISCOVERY_TOPIC:
            is_topic = text.startswith(f"{TOPIC_PREFIX}/")
            yield text, text[2:].removesuffix(SUFFIX_OF[text[:3]]), _OF_TOPICS if is_topic else _OF_SERVICES


def _in_rules(network: Network, domain: int) -> Iterator[_Written]:
    for process in network.started:
        for rule in process.says.rules:
            operations = operations_of(rule)
            for text, _line in rule.keys if operations else ():
                named_in, name = name_in(text)
                if named_in in (domain, None) and not text.startswith("@"):  # verbatim: never a name of ROS 2
                    yield text, name, operations
                    if name is None and "*" in text:
                        yield text, _example(text), operations


def names_of(process: Process) -> Iterator[tuple[str, str]]:
    """Operation and name of ROS 2 of all that its rules write out, in any domain."""
    for rule in process.says.rules:
        for _domain, name in (name_in(text) for text, _line in rule.keys):
            yield from ((operation, name) for operation in operations_of(rule) if name is not None)


def operations_of(rule: Rule) -> tuple[str, ...]:
    """What can be done with a name that a rule is about."""
    topics, services = (bool(kinds & rule.kinds) for kinds in (_SENDING, _SERVING))
    return *_OF_TOPICS * topics, *_OF_SERVICES * services


def name_in(key: str) -> tuple[int | None, str | None]:
    """The domain and the name of ROS 2 that an expression of a rule is about, whatever the type.

    None: it is about more than one, or about something else.
    """
    begin = key.partition("/")[0]
    name = _without_type(key)
    return int(begin) if begin.isdecimal() else None, name if is_ros_name(name) else None


def _without_type(key: str) -> str:
    rest = f"/{key.partition('/')[2]}"
    return rest.removesuffix("/**") if rest.endswith("/**") else rest.rpartition("/")[0].rpartition("/")[0]


def _example(key: str) -> str:
    """A name that a pattern of a rule stands for."""
    name = _without_type(key).replace("**", "*").replace("$*", "*").replace("*", _ANY)
    return name if is_ros_name(name) else f"/{_ANY}"


def rule_domains(network: Network) -> tuple[int, ...]:
    """The domains that rules of processes name, 0 where they name none."""
    found = {each for process in network.started for each in domains_in(process) if each is not None}
    return tuple(sorted(found)) or (0,)


def domains_in(process: Process) -> frozenset[int | None]:
    """The domains that its rules about data name; None: any."""
    keys = (text for rule in process.says.rules for text, _line in rule.keys if not text.startswith("@"))
    return frozenset(domain for domain, _name in map(name_in, keys))
