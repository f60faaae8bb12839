"""Keystores exactly as `ros2 security` (sros2, Rolling) makes them: one authority for both roles, ten
years, pyca's signatures.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timedelta, timezone

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.serialization import Encoding, pkcs7

from .certificates import Certificate
from .documents import Permissions
from .healthy import TALKER_LISTENER, TURTLESIM
from .keys import Key
from .policy import Node, grant
from .store import Enclave, Seal, Store
from .story import Story

MADE_AT = datetime(2026, 11, 1, 9, 0, 0, tzinfo=timezone.utc)
LIFETIME = timedelta(days=3650)  # sros2/_utilities.py, build_key_and_cert: hard-coded there

SAMPLE_POLICY = {
    # sros2's test/policies/sample.policy.xml with its three includes, restated.
    "/talker_listener/talker": Node(name="talker", publish=("chatter",)),
    "/talker_listener/listener": Node(name="listener", subscribe=("chatter",)),
    "/add_two_ints/add_two_ints_server": Node(name="add_two_ints_server", reply=("add_two_ints",)),
    "/add_two_ints/add_two_ints_client": Node(name="add_two_ints_client", request=("add_two_ints",)),
    "/minimal_action/minimal_action_server": Node(name="minimal_action_server", execute=("fibonacci",)),
    "/minimal_action/minimal_action_client": Node(name="minimal_action_client", call=("fibonacci",)),
    "/sample_policy/admin": Node(
        name="admin",
        publish=("chatter",),
        subscribe=("chatter",),
        request=("add_two_ints",),
        reply=("add_two_ints",),
        call=("fibonacci",),
        execute=("fibonacci",),
    ),
}


def by_pyca(signer: Certificate) -> Seal:
    """The signature that sros2 makes: PKCS7SignatureBuilder with the options Text and DetachedSignature."""

    def seal(document: bytes) -> bytes:
        certificate = x509.load_der_x509_certificate(signer.der())
        builder = pkcs7.PKCS7SignatureBuilder().set_data(document)
        builder = builder.add_signer(certificate, signer.key.private(), hashes.SHA256())
        options = [pkcs7.PKCS7Options.Text, pkcs7.PKCS7Options.DetachedSignature]
        return builder.sign(Encoding.SMIME, options)

    return seal


def stock(name: str, nodes: dict[str, Node], *, apart: timedelta = timedelta(0), zone: str = "+00:00") -> Store:
    """What sros2 makes of `nodes`: the authority at MADE_AT, then an enclave every `apart`.

    `zone` ends the dates of permissions: `+00:00` in Rolling, nothing up to Jazzy.
    """
    authority = _issued("sros2CA", Key(label=f"stock {name} CA"), MADE_AT, None)
    enclaves = []
    for number, (path, node) in enumerate(nodes.items(), start=1):
        certificate = _issued(path, Key(label=f"stock {name} {path}"), MADE_AT + number * apart, authority)
        dates = [f"{date:%Y-%m-%dT%H:%M:%S}{zone}" for date in (certificate.not_before, certificate.not_after)]
        rights = grant(path, node, not_before=dates[0], not_after=dates[1])
        enclaves.append(
            Enclave(
                path=path,
                certificate=certificate,
                permissions=Permissions(grants=(rights,)),
                seal=by_pyca(authority),
            )
        )
    return Store(
        identity_ca=authority,
        permissions_ca=authority,
        enclaves=tuple(enclaves),
        governance_seal=by_pyca(authority),
        private_keys=True,
        unsigned=True,
    )


def stories() -> Iterator[Story]:
    """All stock samples."""
    as_made = (
        "One authority, sros2CA, issues identities and signs documents. Cyclone DDS up to 0.10 does not pin the "
        "signer, so there every enclave can sign itself any right."
    )
    yield Story(
        directory="stock/talker_listener",
        text=f"Talker and listener as `ros2 security generate_artifacts` makes them up to Jazzy. {as_made}",
        tree=stock("talker_listener", TALKER_LISTENER, zone="").tree(),
        key_mode=0o644,
        by_meaning=True,
    )
    yield Story(
        directory="stock/turtlesim",
        text="The TurtleSim as `ros2 security create_keystore`, `create_enclave` and "
        "`create_permission` make it in Rolling. Each identity was issued some seconds after the "
        f"authority, and outlives it by these. {as_made}",
        tree=stock("turtlesim", TURTLESIM, apart=timedelta(seconds=2)).tree(),
        key_mode=0o644,
        by_meaning=True,
    )
    yield Story(
        directory="stock/sample_policy",
        text="The seven enclaves of sros2's sample policy as `ros2 security generate_artifacts` makes "
        "them in Rolling: talker, listener, service, action, and an administrator with all their "
        f"rights. {as_made}",
        tree=stock("sample_policy", SAMPLE_POLICY).tree(),
        key_mode=0o644,
        by_meaning=True,
    )


def _issued(subject: str, key: Key, at: datetime, issuer: Certificate | None) -> Certificate:
    authority = issuer is None
    return Certificate(
        key=key,
        subject=subject,
        issuer=issuer,
        not_before=at,
        not_after=at + LIFETIME,
        ca=authority,
        path_length=1 if authority else None,
    )
