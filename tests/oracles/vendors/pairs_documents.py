"""Pairs of enclaves by what the second one presents: who signed it, which grants and rules it holds, which identity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.x509.oid import NameOID
from msgspec.structs import replace

from tests.keystore.builder import authority, crl, rsa_key, signed_document
from tests.keystore.documents import allow, criterion, deny, ids, pubsub, topic_rule
from tests.oracles.vendors.enclave import Endpoint, publish, subscribe
from tests.oracles.vendors.pairs_case import CAS, FIRST, MAY_ALL, SECOND, Case, plain
from tests.oracles.vendors.pairs_material import (
    EVERYTHING,
    FUTURE,
    PAST,
    Authorities,
    Enclave,
    governance,
    grant,
    permissions,
)

_SUBJECT = "CN=/second"
_PARTITIONED = tuple(
    kind(f"a{number}", *partitions)
    for number, partitions in enumerate(((), ("p",), ("q",), ("p", "q"), ("*",), ("?",), ("p*",)))
    for kind in (publish, subscribe)
)
_AB = tuple(kind(topic) for topic in ("a", "b") for kind in (publish, subscribe))
_A, _B = pubsub("a*"), pubsub("b*")


def _presents(title: str, *grants: str, open_rule: bytes | None = None, endpoints: Sequence[Endpoint] = _AB) -> Case:
    """A compromised second side; `open_rule`: another governance than sros2's, for both."""
    first, second = plain("first"), plain("second")
    if open_rule is not None:
        governed = CAS.sign(open_rule)
        first, second = replace(first, governance=governed), replace(second, governance=governed)
    document = CAS.sign(permissions(*grants))
    return Case(title=title, first=first, second=second, presented=document, endpoints=tuple(endpoints))


def _ruled(title: str, *rules: str, controls: bool = True, default: str = "DENY", **others: Any) -> Case:
    return _presents(title, grant(_SUBJECT, *rules, controls=controls, default=default), **others)


def _honest(title: str, *grants: str) -> Case:
    """The second side keeps to its own document."""
    second = replace(plain("second"), permissions=CAS.sign(permissions(*grants)))
    return Case(title=title, second=second, endpoints=tuple(_AB))


def _signers() -> list[Case]:
    document = permissions(grant(_SUBJECT, EVERYTHING))
    one = Authorities.shared()
    first, second, other = (one.issue(name) for name in ("/first", "/second", "/other"))
    governed = one.sign(governance())
    allowed = {name: one.sign(permissions(grant(f"CN={name}", EVERYTHING))) for name in ("/first", "/second")}
    sides: dict[str, Any] = {
        "first": Enclave(authorities=one, identity=first, governance=governed, permissions=allowed["/first"]),
        "second": Enclave(authorities=one, identity=second, governance=governed, permissions=allowed["/second"]),
    }
    own = signed_document(document, second)
    return [
        Case(title="shared CA", **sides),
        Case(title="shared CA: no right at all", **sides, presented=one.sign(permissions(grant(_SUBJECT)))),
        Case(title="shared CA: signed by its own identity", **sides, presented=own),
        Case(title="shared CA: signed by another leaf", **sides, presented=signed_document(document, other)),
        Case(
            title="shared CA: signed by the first side's identity", **sides, presented=signed_document(document, first)
        ),
        Case(
            title="shared CA: honest, its own signature",
            first=sides["first"],
            second=replace(sides["second"], permissions=own),
        ),
        Case(
            title="no right at all", second=replace(plain("second"), permissions=CAS.sign(permissions(grant(_SUBJECT))))
        ),
        Case(title="signed by its own identity", presented=signed_document(document, SECOND)),
        Case(title="signed by the identity CA", presented=signed_document(document, CAS.identity)),
        Case(
            title="a stranger of the CA's name signed it",
            presented=signed_document(document, authority("permissions CA")),
        ),
        Case(title="not signed", presented=document),
    ]


def _empty_documents() -> list[Case]:
    cases = []
    for join in (True, False):
        for access in (True, False):
            rule = CAS.sign(governance(topic_rule(read=access, write=access), join=join))
            sides = [replace(plain(name), governance=rule) for name in ("first", "second")]
            title = f"an empty document, join control {join}, access control {access}"
            cases.append(Case(title=title, first=sides[0], second=sides[1], presented=b""))
    return cases


def _others_documents() -> list[Case]:
    wide = permissions(grant("CN=/talker", allow(_A)), grant(_SUBJECT, allow(_B)))
    closed = CAS.sign(permissions(grant(_SUBJECT)))
    return [
        Case(
            title="its own document allows nothing", second=replace(plain("second"), permissions=closed), endpoints=_AB
        ),
        Case(title="another's document that holds a grant for it too", presented=CAS.sign(wide), endpoints=_AB),
        Case(
            title="the same, honestly copied",
            second=replace(plain("second"), permissions=CAS.sign(wide)),
            endpoints=_AB,
        ),
        Case(title="another's document without a grant for it", presented=MAY_ALL["first"], endpoints=_AB),
    ]


def _grants() -> list[Case]:
    first, second = allow(_A), allow(_B)
    return [
        _presents("expired grant, then a valid one", grant(_SUBJECT, first, validity=PAST), grant(_SUBJECT, second)),
        _presents("future grant, then a valid one", grant(_SUBJECT, first, validity=FUTURE), grant(_SUBJECT, second)),
        _presents("expired grant", grant(_SUBJECT, first, validity=PAST)),
        _presents("valid grant, then an expired one", grant(_SUBJECT, first), grant(_SUBJECT, second, validity=PAST)),
        _presents("two valid grants", grant(_SUBJECT, first), grant(_SUBJECT, second)),
        _presents("a grant without rules, then a valid one", grant(_SUBJECT, controls=False), grant(_SUBJECT, second)),
        _presents("subject in the one-line form", grant("/CN=/second", first)),
        # To Fast DDS, whose digests of names let the second side begin the handshake here.
        _presents("subject as X509_NAME_oneline prints it", grant("/CN=\\/second", first)),
        _presents("subject in both forms", grant("/CN=\\/second", first), grant(_SUBJECT, second)),
        _presents("subject with blanks round it", grant(" CN=/second ", first)),
        _presents("subject with newlines round it", grant("\nCN=/second\n", first)),
        _presents("subject with more than the certificate", grant("CN=/second,O=More", first)),
        _honest(
            "honest: expired grant, then a valid one", grant(_SUBJECT, first, validity=PAST), grant(_SUBJECT, second)
        ),
        _honest("honest: allowed a alone", grant(_SUBJECT, first)),
    ]


def _rules() -> list[Case]:
    publish_a, subscribe_a = criterion("publish", "a*"), criterion("subscribe", "a*")
    everywhere = _PARTITIONED
    return [
        _ruled("rule of another domain allows", allow(_A, domains=ids(9))),
        _ruled("rule of another domain denies", deny(_A, domains=ids(9)), EVERYTHING),
        replace(_ruled("rule of this domain and others", allow(_A, domains=ids(3, 5))), domains=(5, 5)),
        _ruled("a range with its end alone left open", allow(_A, domains=ids((0, None)))),
        _ruled("default ALLOW", default="ALLOW"),
        _ruled("default ALLOW beside a deny rule", deny(_A), default="ALLOW"),
        _ruled("deny publish, then everything", deny(publish_a), EVERYTHING),
        _ruled("deny subscribe, then everything", deny(subscribe_a), EVERYTHING),
        _ruled("allow publish, deny subscribe, then everything", allow(publish_a), deny(subscribe_a), EVERYTHING),
        _ruled("no partition listed", allow(_A), endpoints=everywhere),
        _ruled("partition p", allow(pubsub("a*", partitions=("p",))), endpoints=everywhere),
        _ruled("partitions p and q", allow(pubsub("a*", partitions=("p", "q"))), endpoints=everywhere),
        _ruled("partition ?", allow(pubsub("a*", partitions=("?",))), endpoints=everywhere),
        _ruled(
            "partition p for a, any for b",
            allow(pubsub("a*", partitions=("p",)), pubsub("b*", partitions=("*",))),
            endpoints=everywhere,
        ),
        _ruled(
            "p by one rule, any by the next",
            allow(pubsub("a*", partitions=("p",))),
            allow(pubsub("a*", partitions=("*",))),
            endpoints=everywhere,
        ),
        _ruled("deny p, then everything", deny(pubsub("a*", partitions=("p",))), EVERYTHING, endpoints=everywhere),
        _ruled("any, then deny p", EVERYTHING, deny(pubsub("a*", partitions=("p",))), endpoints=everywhere),
        _ruled(
            "nothing of the topic, deny p, everything",
            allow(criterion("publish", "a*", partitions=("z",))),
            deny(pubsub("a*", partitions=("p",))),
            EVERYTHING,
            endpoints=everywhere,
        ),
    ]


def _relays() -> list[Case]:
    relay_p = criterion("relay", "a*", partitions=("p",))
    kinds = [
        governance(topic_rule(metadata=one, data=other)) for one, other in (("SIGN", "ENCRYPT"), ("NONE", "ENCRYPT"))
    ]
    return [
        _ruled("relay alone", allow(relay_p), endpoints=_PARTITIONED),
        _ruled("relay alone, metadata SIGN, data ENCRYPT", allow(relay_p), endpoints=_PARTITIONED, open_rule=kinds[0]),
        _ruled("relay alone, metadata NONE, data ENCRYPT", allow(relay_p), endpoints=_PARTITIONED, open_rule=kinds[1]),
        _ruled("relay denied, then everything", deny(relay_p), EVERYTHING, endpoints=_PARTITIONED),
        _ruled(
            "relay in p, subscribe in q",
            allow(relay_p, criterion("subscribe", "a*", partitions=("q",))),
            endpoints=_PARTITIONED,
        ),
    ]


def _joining() -> list[Case]:
    elsewhere = allow(pubsub("*", partitions=("*",)), domains=ids(9))
    cases = []
    for join, read, write in (
        (True, True, True),
        (True, False, False),
        (False, True, True),
        (False, False, True),
        (False, True, False),
    ):
        title = f"join control {join}, read control {read}, write control {write}"
        rule = governance(topic_rule(read=read, write=write), join=join)
        cases.append(_ruled(f"{title}: no rule", controls=False, open_rule=rule))
        cases.append(_ruled(f"{title}: allowed in another domain", elsewhere, controls=False, open_rule=rule))
    cases.append(_ruled("joined by relay alone", allow(criterion("relay", "b*")), controls=False))
    cases.append(_ruled("joined by default ALLOW alone", controls=False, default="ALLOW"))
    one_on = governance(topic_rule(read=True, write=False))
    cases.append(
        _ruled(
            "deny subscribe where write control is off",
            deny(criterion("subscribe", "a*")),
            EVERYTHING,
            open_rule=one_on,
            endpoints=_PARTITIONED,
        )
    )
    return cases


def _identities() -> list[Case]:
    revoked = crl(CAS.identity, [SECOND.certificate.serial_number, FIRST.certificate.serial_number])
    other = Authorities.split()
    of_other = Enclave(
        authorities=other,
        identity=other.issue("/second"),
        governance=other.sign(governance()),
        permissions=other.sign(permissions(grant(_SUBJECT, EVERYTHING))),
    )
    named = Authorities(identity=CAS.identity, permissions=authority("another permissions CA"))
    own_rights = replace(
        of_other,
        authorities=named,
        identity=SECOND,
        governance=named.sign(governance()),
        permissions=named.sign(permissions(grant(_SUBJECT, EVERYTHING))),
    )
    long = x509.Name(
        [x509.NameAttribute(NameOID.ORGANIZATION_NAME, "Org"), x509.NameAttribute(NameOID.COMMON_NAME, "/second")]
    )
    longer = replace(
        plain("second"),
        identity=CAS.issue(long),
        permissions=CAS.sign(permissions(grant("CN=/second,O=Org", EVERYTHING))),
    )
    only_second = crl(CAS.identity, [SECOND.certificate.serial_number])
    return [
        Case(
            title="the first side holds a list that revokes the second", first=replace(plain("first"), crl=only_second)
        ),
        Case(
            title="the second side holds a list that revokes the first",
            second=replace(plain("second"), crl=crl(CAS.identity, [FIRST.certificate.serial_number])),
        ),
        Case(title="a list that revokes nobody", first=replace(plain("first"), crl=crl(CAS.identity))),
        Case(title="a list that revokes both, at the first side", first=replace(plain("first"), crl=revoked)),
        Case(title="another CA of the same name", second=of_other),
        Case(
            title="another permissions CA, and the right document presented",
            second=own_rights,
            presented=MAY_ALL["second"],
        ),
        Case(title="a key of another pair", second=replace(plain("second"), key=CAS.issue("/key").key)),
        Case(title="certificate of two parts", second=longer),
        Case(
            title="certificate of two parts, grant in the other order",
            second=longer,
            presented=CAS.sign(permissions(grant("O=Org,CN=/second", EVERYTHING))),
        ),
        Case(title="certificate of two parts, grant for one of them", second=longer, presented=MAY_ALL["second"]),
    ]


def _told_authorities() -> list[Case]:
    """What the second side tells of its permissions CA: name and kind of signature of what its file begins with."""
    mine, name = CAS.permissions.pem, "permissions CA"
    files = {
        "begins with another one": authority("another permissions CA").pem + mine,
        "ends with another one": mine + authority("another permissions CA").pem,
        "begins with one of its name, of RSA": authority(name, key=rsa_key()).pem + mine,
        "begins with one of its name, of SHA-512": authority(name, digest=hashes.SHA512()).pem + mine,
        "begins with another one, of SHA-512": authority("another", digest=hashes.SHA512()).pem + mine,
    }
    return [
        Case(title=f"the permissions CA file {title}", second=replace(plain("second"), permissions_ca=pem))
        for title, pem in files.items()
    ]


DOCUMENT_CASES = (
    *_signers(),
    *_empty_documents(),
    *_others_documents(),
    *_grants(),
    *_rules(),
    *_relays(),
    *_joining(),
    *_identities(),
    *_told_authorities(),
)
