"""Governance and permissions documents in which rules compete for the topics that the plugin is asked about."""

from __future__ import annotations

from hypothesis import strategies as st

from tests.keystore.builder import GOVERNANCE
from tests.keystore.documents import PERMISSIONS

_EXPRESSIONS = st.sampled_from(
    ("rt/chatter", "rt/x", "*", "rt/*", "rt/c*r", "r?/x", "rt/?", "*x", "other", "rt/chatte")
)
_DOMAINS = st.sampled_from(
    (
        *("<id>0</id>", "<id>1</id>", "<id>1</id><id>0</id>", "<id_range><min>0</min><max>3</max></id_range>"),
        *("<id_range><min>1</min><max>230</max></id_range>", "<id>7</id><id_range><min>0</min><max>0</max></id_range>"),
    )
)
_PARTITIONS = st.sampled_from(((), (), (), ("",), ("A",), ("*",), ("A", ""), ("A", "B"), ("?",)))


def _listed(tag: str, values: list[str] | tuple[str, ...]) -> str:
    return f"<{tag}s>{''.join(f'<{tag}>{value}</{tag}>' for value in values)}</{tag}s>" if values else ""


_CRITERIA = st.builds(
    lambda operation, topics, partitions: (
        f"<{operation}>{_listed('topic', topics)}{_listed('partition', partitions)}</{operation}>"
    ),
    st.sampled_from(("publish", "subscribe")),
    st.lists(_EXPRESSIONS, min_size=1, max_size=2),
    _PARTITIONS,
)
_RULES = st.builds(
    lambda tag, domains, criteria: f"<{tag}><domains>{domains}</domains>{''.join(sorted(criteria))}</{tag}>",
    st.sampled_from(("allow_rule", "deny_rule")),
    _DOMAINS,
    st.lists(_CRITERIA, max_size=3),
)
_FLAGS = ("discovery_protection", "liveliness_protection", "read_access_control", "write_access_control")
_KINDS = ("metadata", "data")
_BOOLEANS = st.sampled_from(("true", "false", "1", "0"))
_TOPIC_RULES = st.builds(
    lambda expression, flags, kinds: (
        f"<topic_rule><topic_expression>{expression}</topic_expression>"
        + "".join(f"<enable_{name}>{flag}</enable_{name}>" for name, flag in zip(_FLAGS, flags, strict=True))
        + "".join(
            f"<{name}_protection_kind>{kind}</{name}_protection_kind>" for name, kind in zip(_KINDS, kinds, strict=True)
        )
        + "</topic_rule>"
    ),
    _EXPRESSIONS,
    st.tuples(_BOOLEANS, _BOOLEANS, _BOOLEANS, _BOOLEANS),
    st.tuples(st.sampled_from(("NONE", "SIGN", "ENCRYPT")), st.sampled_from(("NONE", "SIGN", "ENCRYPT"))),
)


def _between(document: bytes, start: bytes, end: bytes, instead: str) -> bytes:
    before, _, rest = document.partition(start)
    _, _, behind = rest.partition(end)
    return before + instead.encode() + behind


def permissions() -> st.SearchStrategy[bytes]:
    """Permissions of /talker with up to four rules."""
    return st.builds(
        lambda rules, default: _between(
            PERMISSIONS, b"<allow_rule>", b"</default>", f"{''.join(rules)}<default>{default}</default>"
        ),
        st.lists(_RULES, max_size=4),
        st.sampled_from(("DENY", "DENY", "ALLOW")),
    )


def governance() -> st.SearchStrategy[bytes]:
    """A governance with up to three domain rules of up to four topic rules each."""
    rule = st.builds(
        lambda domains, topics: _between(
            _between(_DOMAIN_RULE, b"<domains>", b"</domains>", f"<domains>{domains}</domains>"),
            b"<topic_access_rules>",
            b"</topic_access_rules>",
            f"<topic_access_rules>{''.join(topics)}</topic_access_rules>",
        ),
        _DOMAINS,
        st.lists(_TOPIC_RULES, min_size=1, max_size=4),
    )
    return st.lists(rule, min_size=1, max_size=3).map(
        lambda rules: _between(GOVERNANCE, b"<domain_rule>", b"</domain_rule>", b"".join(rules).decode())
    )


_DOMAIN_RULE = GOVERNANCE[GOVERNANCE.index(b"<domain_rule>") : GOVERNANCE.index(b"</domain_access_rules>")]
