"""What is known of implementations beyond the rows of quirks.toml, as findings say it, and the evidence of clauses.

How they read faulty XML, certificate files and sessions is no peculiarity for verdicts: what differs there is a defect,
never a guess. Measured, unless said otherwise, on what `TESTED_ON` names.
"""

from __future__ import annotations

from typing import Final

from keystore_audit.profiles.table import VARIANTS

# --- XML (tests/oracles/xml): tinyxml2, a parser of its own, Xerces-C

CANNOT_READ: Final = "which Fast DDS and Cyclone DDS cannot read"
ACCEPT_CONTROLS: Final = "Fast DDS and Cyclone DDS accept it, others refuse the text"
END_AT_NUL: Final = "Fast DDS and Cyclone DDS ignore everything behind it, others refuse the text"
IGNORE_ENCODING: Final = "which Fast DDS and Cyclone DDS ignore"
BLANK_IN_END_TAG: Final = "a blank in an end tag, which Cyclone DDS refuses"
REFERENCE_TO_BLANK: Final = "a character reference to a blank, which Cyclone DDS does not take for one"
BYTE_ORDER_MARK: Final = "a byte order mark, which Cyclone DDS refuses and Fast DDS skips"
SECOND_ROOT: Final = "text behind the end of the document: Fast DDS reads the first root alone, other parsers refuse it"
CDATA: Final = "a CDATA section: Fast DDS reads only the first piece of a value, others the whole"
NAMESPACE_DECLARED: Final = "Cyclone DDS refuses it, Fast DDS ignores it"
NAMESPACE_OF_ELEMENT: Final = "Fast DDS and Cyclone DDS go by the name alone"
ATTRIBUTE: Final = "which Cyclone DDS refuses and Fast DDS ignores"
COMMENT_AT_END: Final = "a comment behind </domain_access_rules>: Fast DDS refuses the document"
BLANKS_AROUND: Final = "Cyclone DDS trims them, Fast DDS does not"
QUOTE_AT_START: Final = "Cyclone DDS refuses the document"
PIECES: Final = "Fast DDS reads only the first piece, {first}, Cyclone DDS and OpenDDS {joined}"
ELEMENT_TWICE: Final = "Cyclone DDS takes the last or joins them, Fast DDS takes the first or refuses the document"
ORDER_OF_1_0: Final = "which Fast DDS and Cyclone DDS read (measured) and who validates by 1.1 refuses"
XML_PARSERS: Final = "measured on tinyxml2, Cyclone DDS and libxml2"

# --- files and certificates

CERTIFICATES_OF_A_FILE: Final = "Fast DDS takes all of it, Cyclone DDS the first certificate"
TWO_SIGNERS: Final = "Fast DDS may take it where Cyclone DDS refuses."
PKCS11_FIRST: Final = tuple(profile.name for profile in VARIANTS.values() if profile.family == "fastdds")
"""The variants that take a .p11 file before the .pem file."""
READS_PKCS11: Final = "Fast DDS reads"
PKCS11: Final = "a PKCS#11 reference, which Fast DDS reads in place of the .pem file"
DIES_OF_NO_SUBJECT: Final = PKCS11_FIRST
"""The variants that read an empty subject and die of it."""
NO_SUBJECT: Final = "Fast DDS crashes on it"
NO_SUBJECT_MEASURED: Final = "measured: Fast DDS 2.6 to 3.6 crash"
CHAINS_MEASURED: Final = "measured on Fast DDS, Cyclone DDS and libcrypto (X509_verify_cert)"
MESSAGES_MEASURED: Final = "measured on Cyclone DDS, Fast DDS and libcrypto (PKCS7_verify)"
SUBJECTS_SOURCES: Final = "DistinguishedName.cpp of Fast DDS, access_control_utils.c of Cyclone DDS; measured"

# --- governance and permissions

RTPS_CONTRADICTION: Final = "Fast DDS from 2.6.5 and 2.10.2 on does not start"
NO_DOMAINS_MEASURED: Final = "Measured on Cyclone DDS 0.10.2, read in 11.0.1 (access_control_parser.c); schema-invalid"
EMPTY_TOPIC_MEASURED: Final = (
    "Measured on Cyclone DDS 0.10.2 and Fast DDS 2.9.1; the XSD of DDS-Security 1.1 lets it pass"
)
EMPTY_ELEMENT_MEASURED: Final = "Measured: Fast DDS 2.9.1 and 2.14.6 crash; schema-invalid"
HANDSHAKE_MEASURED: Final = "Measured on Fast DDS 2.9.1; ros2/sros2#228"
DIES_OF_LARGE_PERMISSIONS: Final = "fastdds-2.9"
"""The variant whose process ends where certificate and permissions do not fit in a handshake."""
DOMAINS_MEASURED: Final = "measured on Cyclone DDS"
OPEN_RANGE_KILLS: Final = "Cyclone DDS 0.10 dies when it comes to the rule (measured)."
OTHERS_GRANTS_MEASURED: Final = "measured on Cyclone DDS 0.10.2 and 11.0.1 and on Fast DDS 2.9.1"
RELAY_MEASURED: Final = "measured on Fast DDS 2.9.1: a reader that may relay alone receives plain data"
EXPRESSIONS_MEASURED: Final = "measured on libc, ACE and Cyclone DDS 0.10.2"
ANY_RULE_READ: Final = "read in the source of OpenDDS (AccessControlBuiltInImpl.cpp)"

FORGED_SOURCE: Final = "measured: Cyclone DDS and Fast DDS take such samples"
NO_ORIGIN: Final = "OpenDDS authenticates no origin (read in its guide)"
RELAY_READS: Final = "Fast DDS takes a relay grant for a right to read"

# --- sessions and middleware

RUNNING_SESSIONS: Final = "Running sessions may go on: Fast DDS does not end a session when its grant ends."
"""Read; Cyclone DDS and OpenDDS have timers."""
CONFIGURATION_VARIABLES: Final = "[A-Z_]{0,20}(?:DDS|RTPS|ZENOH)_[A-Z_]+"
"""A regular expression of environment variables that configure a middleware."""
UNENFORCING: Final = "rmw_zenoh_cpp"
"""What RMW_IMPLEMENTATION says of a middleware that enforces neither governance nor permissions."""
OWN_ACCESS_CONTROL: Final = "rmw_zenoh reads its access control from its own configuration"
AUDIT_ITS_CONFIGURATION: Final = "With rmw_zenoh, audit the configuration of its routers and sessions."
NETWORK_OPTION: Final = "--zenoh"
NETWORK_FORM: Final = "zenoh"
SUGGESTED_FORMS: Final = "An SROS2 policy, permissions ready to be signed, or the files of Zenoh sessions."
EXPECTED_FILES: Final = "expected the folder of the session and router files of Zenoh"
OVERRIDE_OF_CONFIGURATION: Final = "ZENOH_CONFIG_OVERRIDE"
"""The variable that replaces values of every configuration, after the file (measured)."""
ROUTED_STATED: Final = (
    "In rmw_zenoh, governance and permissions have no effect: findings KA801 to KA899 judge it. They assume that every "
    "process but an attacker's starts with its file in {}, and that no other takes part."
)
ROUTED_SCOPE: Final = "rmw_zenoh with the files in {}"
ROUTED_IF: Final = "every process but an attacker's starts with its Zenoh file, and no other takes part"
ROUTED_BY_FILES: Final = "the Zenoh files alone"
ROUTED_STOLEN: Final = "In Zenoh, a router's key can open more: `keystore-audit flow --from-compromised`."
ROUTED_VIOLATE_NONE: Final = "; the Zenoh files violate none that is asked of them"
ROUTED_ENFORCES_NONE: Final = "in DDS; rmw_zenoh enforces none of them"
ROUTED_NAMED: Final = "the Zenoh files"
ROUTED_TITLE: Final = "Who can do what in Zenoh"
ROUTED_PAGE: Final = "keystore-audit, docs/zenoh.md"
ROUTED_TLS: Final = "Zenoh, zenoh-link-tls, utils.rs and unicast.rs (read); measured on 1.10.2"
ROUTED_LINKS: Final = "Zenoh, net/routing/hat and net/runtime/orchestrator.rs (read); measured on 1.10.2"
ROUTED_ACCESS: Final = "Zenoh, net/routing/interceptor/authorization.rs (read); measured on 1.4.0 to 1.10.2"
ROUTED_FILES: Final = "Zenoh, commons/zenoh-config (read); measured on 1.4.0, 1.6.2, 1.7.2 and 1.10.2"
ENFORCING: Final = "Use rmw_fastrtps_cpp or rmw_cyclonedds_cpp"
EXAMPLE_PROFILE: Final = "fastdds-3.6"
EXAMPLE_MIDDLEWARE: Final = "fastdds"
