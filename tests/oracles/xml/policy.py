"""Governance and permissions documents in which rules compete for the topics that the plugin is asked about."""

from __future__ import annotations

from hypothesis import strategies as st

from tests.keystore import documents
from tests.keystore.documents import criterion, domain_rule, grant, rule, topic_rule

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


_CRITERIA = st.builds(
    lambda kind, topics, partitions: criterion(kind, *topics, partitions=partitions),
    st.sampled_from(("publish", "subscribe")),
    st.lists(_EXPRESSIONS, min_size=1, max_size=2),
    _PARTITIONS,
)
_RULES = st.builds(
    lambda tag, domains, criteria: rule(*sorted(criteria), allow=tag == "allow_rule", domains=domains),
    st.sampled_from(("allow_rule", "deny_rule")),
    _DOMAINS,
    st.lists(_CRITERIA, max_size=3),
)
_BOOLEANS = st.sampled_from(("true", "false", "1", "0"))
_KINDS = st.sampled_from(("NONE", "SIGN", "ENCRYPT"))
_TOPIC_RULES = st.builds(
    topic_rule,
    _EXPRESSIONS,
    **dict.fromkeys(("discovery", "liveliness", "read", "write"), _BOOLEANS),
    **dict.fromkeys(("metadata", "data"), _KINDS),
)
_DOMAIN_RULES = st.builds(
    lambda domains, topics: domain_rule(*topics, domains=domains),
    _DOMAINS,
    st.lists(_TOPIC_RULES, min_size=1, max_size=4),
)


def permissions() -> st.SearchStrategy[bytes]:
    """Permissions of /talker with up to four rules."""
    return st.builds(
        lambda rules, default: documents.permissions(grant("/talker", *rules, default=default)).encode(),
        st.lists(_RULES, max_size=4),
        st.sampled_from(("DENY", "DENY", "ALLOW")),
    )


def governance() -> st.SearchStrategy[bytes]:
    """A governance with up to three domain rules of up to four topic rules each."""
    return st.lists(_DOMAIN_RULES, min_size=1, max_size=3).map(lambda rules: documents.governance(*rules).encode())
