"""The vendors' own plugins find the grants that we say they find, and no others.

A participant starts if a grant of its permissions names its identity: Cyclone DDS 0.10.2 and Fast DDS 2.9.1 are asked
with real certificates and signatures. The comparison of Fast DDS since 2.14 and of OpenDDS is read, not measured.
"""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from functools import partial
from html import escape
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import NameOID
from hypothesis import given, settings
from hypothesis import strategies as st

from keystore_audit.keystore.certificate import Certificate
from keystore_audit.model.subjects.attributes import compact, oneline
from keystore_audit.model.subjects.comparison import names, printed
from keystore_audit.model.subjects.told import same_meaning
from keystore_audit.profiles import SubjectComparison
from tests.amount import tried
from tests.keystore.builder import certificate, evidence
from tests.keystore.documents import PERMISSIONS
from tests.oracles.xml.ours import DocumentKind
from tests.oracles.xml.plugins import Plugin
from tests.second_reader.openssl import certificates_in

pytestmark = pytest.mark.xdist_group("xml-oracle")

CN, OU, ORG = NameOID.COMMON_NAME, NameOID.ORGANIZATIONAL_UNIT_NAME, NameOID.ORGANIZATION_NAME

SUBJECTS: dict[str, tuple[tuple[x509.ObjectIdentifier, str], ...]] = {
    "as sros2 writes it": ((CN, "/talker"),),
    "nested": ((CN, "/robot/arm"),),
    "organisation": ((ORG, "Org"), (CN, "/talker")),
    "repeated type": ((OU, "a"), (OU, "b"), (CN, "/t")),
    "beyond ASCII": ((CN, "/tälker"),),
    "comma": ((CN, "/a,b"),),
    "slash at the end": ((CN, "/talker/"),),
    "two slashes": ((CN, "/a//b"),),
    "quote": ((CN, '/tal"ker'),),
    "no slash": ((CN, "talker"),),
    "mail address": ((CN, "/t"), (NameOID.EMAIL_ADDRESS, "a@b")),
    "equals sign": ((CN, "/a=b"),),
    "more than 1,024 octets": (*((OU, f"{number:02}" + "u" * 60) for number in range(20)), (CN, "/talker")),
}
_LONG = ",".join(["CN=/talker", *(f"OU={number:02}" + "u" * 60 for number in reversed(range(20)))])

GRANTS = (
    *("CN=/talker", "CN=/talker/arm", "CN=/arm/talker", "CN = /talker", "CN=/talker,", "CN=/talker,O=Extra"),
    *("O=Org,CN=/talker", "CN=/talker,O=Org", "CN=/talker, O=Org", "CN=/arm/robot", "CN=/robot/arm", "CN=/robot"),
    *("/CN=/talker", "/CN=talker", "CN=talker", "CN=/t,OU=b,OU=a", "CN=/t,OU=a,OU=b", "CN=/t,OU=a", "CN=/tälker"),
    *("CN=/t\\C3\\A4lker", "CN=/a\\,b", "CN=/a,b", "CN=/talker/", "CN=/a//b", "CN=/a/b", 'CN=/tal\\"ker'),
    *('CN=/tal"ker', "CN=/talker,foo", "CN=/talker|x", "CN=,talker=", "talker=,CN=", "emailAddress=a@b,CN=/t"),
    *("CN=/t,emailAddress=a@b", "1.2.840.113549.1.9.1=a@b,CN=/t", "CN=/a=b", "CN=/a\\=b", "cn=/talker", "CN=/TALKER"),
    *(" CN=/talker", "CN=/talker ", "\tCN=/talker", "CN=/talker\n", "\n  CN=/talker,O=Org\n", " CN=/talker, O=Org "),
    *("CN=/talker,\nO=Org", "/O=Org/CN=/talker", "/CN=/talker/O=Org", "/ O=Org / CN=/talker", "/CN=\\/talker"),
    *("/CN=/t/emailAddress=a@b", "/CN=/t\\C3\\A4lker", "CN=\\2Ftalker", "/OU=a/OU=b/CN=/t", "/O=Org", "CN=/"),
    *("CN=/talker,,O=x", "CN=/talker" + "," * 25, "CN=/talker," + "x=1," * 19, _LONG, _LONG[:1024], _LONG[:1023]),
)

MEASURED = {"cyclone": SubjectComparison.PIECES_WITHIN, "fastdds": SubjectComparison.PIECES_IN_ORDER}


def named(attributes: tuple[tuple[x509.ObjectIdentifier, str], ...]) -> x509.Name:
    return x509.Name([x509.NameAttribute(kind, value) for kind, value in attributes])


def starts(plugin: Plugin, subject_name: str) -> bool:
    """Whether the plugin finds a grant for its identity in permissions whose only grant has this subject_name."""
    before, _, rest = PERMISSIONS.decode().partition("<subject_name>")
    document = f"{before}<subject_name>{escape(subject_name)}</subject_name>{rest.partition('</subject_name>')[2]}"
    return plugin.ask(plugin.sign(document.encode()), DocumentKind.PERMISSIONS).refused is None


@pytest.mark.parametrize("vendor", MEASURED)
@pytest.mark.parametrize("title", SUBJECTS)
def test_the_plugin_finds_the_grants_that_we_say(plugins: dict[str, Plugin], title: str, vendor: str) -> None:
    plugin = plugins[vendor]
    identity = evidence(plugin.take(named(SUBJECTS[title])))
    ours = {grant: names(grant, identity, MEASURED[vendor]) for grant in GRANTS}
    assert {grant: starts(plugin, grant) for grant in GRANTS} == ours


PATHS = st.lists(st.sampled_from(["a", "b", "c", "robot"]), min_size=1, max_size=3).map(
    lambda parts: "/" + "/".join(parts)
)


@settings(max_examples=tried(150))
@given(path=PATHS, other=PATHS, vendor=st.sampled_from(sorted(MEASURED)))
def test_paths_of_the_same_parts(plugins: dict[str, Plugin], path: str, other: str, vendor: str) -> None:
    identity = evidence(plugins[vendor].take(path))
    assert starts(plugins[vendor], f"CN={other}") == names(f"CN={other}", identity, MEASURED[vendor])


def test_an_enclave_has_the_rights_of_one_whose_path_holds_its_parts(plugins: dict[str, Plugin]) -> None:
    """Measured with the plugin of Cyclone DDS 0.10.2, which Humble, Jazzy and Kilted ship: the finding KA519."""
    plugins["cyclone"].take("/robot")
    assert starts(plugins["cyclone"], "CN=/robot/arm")
    assert starts(plugins["cyclone"], "CN=/arm/robot")
    assert not starts(plugins["cyclone"], "CN=/arm")


# --- read in the sources of versions that are not installed here; rows measured on them by the project's tables


def certified(plugins: dict[str, Plugin], *attributes: tuple[x509.ObjectIdentifier, str]) -> Certificate:
    return evidence(plugins["fastdds"].take(named(attributes)))


@pytest.mark.parametrize(
    ("subject", "grant", "expected"),
    [
        (((CN, "/talker"),), "CN = /talker", True),
        (((ORG, "Org"), (CN, "/talker")), "O=Org,CN=/talker", True),
        (((ORG, "Org"), (CN, "/talker")), "CN=/talker,CN=/talker", True),
        (((OU, "robots"), (CN, "/mallory")), "OU=robots,OU=robots", True),
        (((CN, "/talker"),), "CN=/talker,foo", True),
        (((CN, '/tal"ker'),), "CN=/talker", True),
        (((CN, "/tal\\ker"),), "CN=/talker", True),
        (((CN, "/talker"),), "CN=/talker,", True),
        (((OU, "a"), (OU, "b"), (CN, "/t")), "CN=/t,OU=b,OU=a", False),
        (((CN, "/talker"),), "CN=/talker,O=Extra", False),
        (((CN, "/talker"),), "CN=/talker/arm", False),
        (((CN, "/talker"),), "/CN=/talker", False),
    ],
)
def test_fast_dds_since_2_14(
    plugins: dict[str, Plugin],
    subject: tuple[tuple[x509.ObjectIdentifier, str], ...],
    grant: str,
    expected: bool,
) -> None:
    """The rows that were measured on 2.14.6, 3.2.5 and 3.6.2 (docs/security-model.md)."""
    assert names(grant, certified(plugins, *subject), SubjectComparison.ATTRIBUTES) is expected


def test_cyclone_dds_11_trims(plugins: dict[str, Plugin]) -> None:
    identity = certified(plugins, (ORG, "Org"), (CN, "/talker"))
    assert names("O=Org, CN = /talker", identity, SubjectComparison.TRIMMED_PIECES_WITHIN)
    assert not names("O=Org, CN = /talker", identity, SubjectComparison.PIECES_WITHIN)


ODD = '/a ,+"\\<>;#= ä\t'
"""Characters that RFC 2253 escapes, and some that it does not."""


PRINTED: dict[str, Callable[[Certificate], str]] = {
    "RFC2253": partial(printed, escape_non_ascii=True),
    "RFC2253,-esc_msb": partial(printed, escape_non_ascii=False),
    "oneline": oneline,
}


@pytest.mark.parametrize("options", PRINTED)
@pytest.mark.parametrize("title", [*SUBJECTS, "odd", "blanks", "hash", "backslash"])
def test_names_are_printed_as_openssl_prints_them(
    oracle: Callable[[str], str], tmp_path: Path, title: str, options: str
) -> None:
    others = {
        "odd": ((CN, ODD), (OU, "x")),
        "blanks": ((CN, " x "),),
        "hash": ((CN, "#x"),),
        "backslash": ((CN, "\\"),),
    }
    made = certificate(named(others.get(title) or SUBJECTS[title]))
    (tmp_path / "cert.pem").write_bytes(made.pem)
    command = [oracle("openssl"), "x509", "-noout", "-subject", "-nameopt", options, "-in", str(tmp_path / "cert.pem")]
    said = subprocess.run(command, capture_output=True, check=True).stdout.decode()
    assert PRINTED[options](evidence(made)) == said.removeprefix("subject=").removesuffix("\n")


@pytest.mark.parametrize(
    ("subject", "grant", "expected"),
    [
        (((ORG, "Org"), (CN, "/talker")), "O=Org,CN=/talker", True),
        (((ORG, "Org"), (CN, "/talker")), "O = Org, CN = /talker", True),
        (((ORG, "Org"), (CN, "/talker")), "CN=/talker,O=Org", False),
        (((CN, "/talker"),), 'CN="/talker"', False),
        (((CN, "/talker"),), "CN=/talker,", False),
        (((CN, "/talker"),), "/CN=/talker", False),
        (((CN, "talker"),), "/CN=talker", True),
        (((ORG, "Org"), (CN, "talker")), "/O=Org/CN=talker", True),
        (((ORG, "Org"), (CN, "talker")), "/ O = Org / CN = talker", True),
        (((ORG, "Org"), (CN, "talker")), "/CN=talker/O=Org", False),
        (((ORG, "Org"), (ORG, "Org"), (CN, "talker")), "/O=Org/CN=talker", False),
        (((NameOID.EMAIL_ADDRESS, "a@b"), (CN, "t")), "/emailAddress=a@b/CN=t", True),
        (((CN, "/a,b"),), "CN=/a\\,b", False),
        (((CN, "/a=b"),), "CN=/a\\=b", True),
        (((CN, "/tälker"),), "CN=/tälker", False),
        (((CN, "/tälker"),), "CN=/t\\C3\\A4lker", True),
        (((CN, '/tal"ker'),), 'CN=/tal"ker', True),
    ],
)
def test_opendds(subject: tuple[tuple[x509.ObjectIdentifier, str], ...], grant: str, expected: bool) -> None:
    """Read in SubjectName.cpp; a certificate's is in its own order (Certificate.h, XN_FLAG_ONELINE)."""
    assert names(grant, evidence(certificate(named(subject))), SubjectComparison.RELATIVE_NAMES) is expected


@pytest.mark.parametrize("title", SUBJECTS)
def test_a_name_as_openssl_prints_it_means_the_name(title: str) -> None:
    made = evidence(certificate(named(SUBJECTS[title])))
    assert same_meaning(printed(made, escape_non_ascii=False), made)


@pytest.mark.parametrize("title", SUBJECTS)
def test_the_compact_form_is_that_of_openssl(title: str) -> None:
    made = certificate(named(SUBJECTS[title]))
    (theirs,) = certificates_in(made.pem)
    assert compact(evidence(made)) == theirs.oneline
