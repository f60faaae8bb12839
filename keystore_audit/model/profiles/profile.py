"""One row of the semantics tables."""

from __future__ import annotations

from enum import Enum

from msgspec import Struct

from keystore_audit.model.profiles.access import Access, Local


class SubjectComparison(str, Enum):
    """How the subject_name of a grant is compared with the subject of a certificate (`model.subjects.comparison`)."""

    EXACT = "exact"
    FASTDDS_ORDERED = "fastdds-ordered"
    FASTDDS_PARSED = "fastdds-parsed"
    CYCLONEDDS = "cyclonedds"
    CYCLONEDDS_TRIMMED = "cyclonedds-trimmed"
    OPENDDS = "opendds"


class RevocationLists(str, Enum):
    """Where revocation lists of identities are read from."""

    NONE = "none"
    CRL_FILE = "crl.pem"
    CRL_AND_CA_FILE = "crl.pem and the identity CA file"


class Trust(Struct, frozen=True, kw_only=True, eq=False):
    """Whom an implementation trusts. Profiles with one row read a keystore alike; equal rows are one object.

    `pins_signer`: a document must be signed by a certificate of the permissions CA file itself; otherwise any
    certificate that chains to one and is fit for S/MIME signing will do (CVE-2023-24010, -24011, -24012).
    `first_authority_only`: of a CA file the first certificate counts alone. `needs_root`: a chain has to end at a
    self-signed certificate of the CA file (OpenSSL without X509_V_FLAG_PARTIAL_CHAIN), `checks_root_signature`: whose
    signature is checked too (X509_V_FLAG_CHECK_SS_SIGNATURE). `checks_permissions_ca`: the permissions CA has to be in
    force and to chain to a root. `strict_authorities`: the first certificate of each CA file is verified when it is
    loaded (X509_V_FLAG_X509_STRICT). `ca_algorithms`, `identity_algorithms`: signature algorithms, as OpenSSL names
    them, of the first certificate of each CA file and of the identity (None: all). `identity_keys`: kinds of key of the
    identity and of the identity CA (None: all). `compares_key`: whether a private key of another certificate keeps the
    participant from being created. `compares_permissions_ca`: a participant refuses peers that tell another name, or
    kind of signature, of their permissions CA, the first certificate of the file, than its own. `trusts_declarations`:
    the permissions of a peer are asked only for endpoints that it announces as under access control, which an attacker
    leaves out (measured on Cyclone DDS 0.10.2); no verdict goes by it, reports say so.
    """

    pins_signer: bool
    first_authority_only: bool
    needs_root: bool
    checks_root_signature: bool
    checks_permissions_ca: bool
    strict_authorities: bool
    revocation: RevocationLists
    subjects: SubjectComparison
    ca_algorithms: frozenset[str] | None
    identity_algorithms: frozenset[str] | None
    identity_keys: frozenset[str] | None
    compares_key: bool
    compares_permissions_ca: bool
    trusts_declarations: bool


class Evidence(str, Enum):
    """How the rows of a profile are known (docs/profiles.md tells row by row).

    TESTED: this project's tests ask the real implementation. MEASURED: on the real implementation, for the project's
    tables; the tests do not ask it again. READ: in its source, or in the specification.
    """

    TESTED = "tested"
    MEASURED = "measured"
    READ = "read"


class Profile(Struct, frozen=True, kw_only=True):
    """What one implementation does; its versions stand in docs/profiles.md.

    `distributions`: ROS 2 distributions that ship it. `trust`: whom it trusts; `access`: what documents mean to it;
    `local`: what it asks of its own participant. `evidence`: how the rows are known.
    """

    name: str
    title: str
    distributions: tuple[str, ...]
    trust: Trust
    access: Access
    local: Local
    evidence: Evidence
