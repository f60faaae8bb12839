"""The subject of a grant, compared with that of a certificate."""

from __future__ import annotations

from cryptography import x509
from cryptography.x509.oid import NameOID

from tests.keystore.builder import certificate
from tests.keystore.documents import allow, permissions, pubsub
from tests.oracles.vendors.recipe import Recipe, common_authority, grant

CN, ORG, OU, DC, C, MAIL = (
    NameOID.COMMON_NAME,
    NameOID.ORGANIZATION_NAME,
    NameOID.ORGANIZATIONAL_UNIT_NAME,
    NameOID.DOMAIN_COMPONENT,
    NameOID.COUNTRY_NAME,
    NameOID.EMAIL_ADDRESS,
)
Parts = tuple[tuple[x509.ObjectIdentifier, str], ...]
TALKER: Parts = ((CN, "/talker"),)
ORGANISED: Parts = ((ORG, "Org"), (CN, "/talker"))
FIVE: Parts = ((C, "DE"), (ORG, "Org"), (OU, "Robots"), (DC, "example"), (CN, "/talker"))


ONE_OF_TWO = x509.Name(
    [
        x509.RelativeDistinguishedName([x509.NameAttribute(OU, "robots")]),
        x509.RelativeDistinguishedName([x509.NameAttribute(CN, "/talker"), x509.NameAttribute(ORG, "Organisation")]),
    ]
)
"""The last of its relative names has two attributes, as some company PKIs write them."""


MEMBER: Parts = ((C, "US"), (ORG, "Object Computing"), (CN, "CN_TEST"), (MAIL, "a@b.com"))
"""As the certificates of the OMG's interoperability set are (omg-dds/dds-security)."""

MAIN: Parts = ((C, "ES"), (ORG, "eProsima"), (OU, "eProsima"), (CN, "Main Subscriber"), (MAIL, "mainsub@eprosima.com"))
"""As those of Fast DDS's tests and examples (eProsima/Fast-DDS)."""

MUELLER: Parts = ((ORG, "Müller GmbH"), (CN, "/talker"))

_MAIN = "emailAddress=mainsub@eprosima.com, CN=Main Subscriber, OU=eProsima, O=eProsima, C=ES"


def subject(title: str, parts: Parts | x509.Name, named: str) -> Recipe:
    """A keystore whose certificate has this subject (in the order of the certificate) and whose grant names that."""
    name = parts
    if not isinstance(name, x509.Name):
        name = x509.Name([x509.NameAttribute(kind, text) for kind, text in parts])
    listed = permissions(grant(allow(pubsub("rt/chatter")), subject=named))
    return Recipe(title=f"subject {title}", permissions=listed, identity=certificate(name, common_authority()))


RECIPES = (
    subject("plain", TALKER, "CN=/talker"),
    subject("with blanks round =", TALKER, "CN = /talker"),
    subject("with blanks before the value", TALKER, "CN= /talker"),
    subject("with blanks around", TALKER, " CN=/talker "),
    subject("with line breaks around", TALKER, "\n  CN=/talker\n  "),
    subject("in one-line form", TALKER, "/CN=/talker"),
    subject("with small cn", TALKER, "cn=/talker"),
    subject("in capitals", TALKER, "CN=/TALKER"),
    subject("by long name", TALKER, "commonName=/talker"),
    subject("by OID", TALKER, "2.5.4.3=/talker"),
    subject("with a wildcard", TALKER, "CN=/talk*"),
    subject("without type", TALKER, "/talker"),
    subject("with a trailing comma", TALKER, "CN=/talker,"),
    subject("with a leading comma", TALKER, ",CN=/talker"),
    subject("with an extra part", TALKER, "CN=/talker,O=Org"),
    subject("with the same part twice", TALKER, "CN=/talker,CN=/talker"),
    subject("with a part without =", TALKER, "CN=/talker,foo"),
    subject("with another value of the type", TALKER, "CN=/other,CN=/talker"),
    subject("with a semicolon", TALKER, "CN=/talker;O=Org"),
    subject("with a plus", TALKER, "CN=/talker+O=Org"),
    subject("prefix of the certificate's", TALKER, "CN=/talk"),
    subject("longer than the certificate's", TALKER, "CN=/talker2"),
    subject("with a needless escape", TALKER, "CN=\\/talker"),
    subject("quoted", TALKER, 'CN="/talker"'),
    subject("empty", TALKER, ""),
    subject("with a comment inside", TALKER, "CN=/tal<!-- -->ker"),
    subject("as CDATA", TALKER, "<![CDATA[CN=/talker]]>"),
    subject("of two parts, RFC 2253", ORGANISED, "CN=/talker,O=Org"),
    subject("of two parts, with a blank", ORGANISED, "CN=/talker, O=Org"),
    subject("of two parts, in certificate order", ORGANISED, "O=Org,CN=/talker"),
    subject("of two parts, one-line", ORGANISED, "/O=Org/CN=/talker"),
    subject("of two parts, less one", ORGANISED, "CN=/talker"),
    subject("of two parts, another value", ORGANISED, "CN=/talker,O=Orb"),
    subject("of five parts, RFC 2253", FIVE, "CN=/talker,DC=example,OU=Robots,O=Org,C=DE"),
    subject("of five parts, in certificate order", FIVE, "C=DE,O=Org,OU=Robots,DC=example,CN=/talker"),
    subject("of two OU", ((OU, "a"), (OU, "b"), (CN, "/talker")), "CN=/talker,OU=b,OU=a"),
    subject("of two equal OU", ((OU, "a"), (OU, "a"), (CN, "/talker")), "CN=/talker,OU=a,OU=a"),
    subject("of two DC", ((DC, "com"), (DC, "example"), (CN, "/talker")), "CN=/talker,DC=example,DC=com"),
    subject("of a part beside a doubled one in the grant", ((OU, "robots"), (CN, "/mallory")), "OU=robots,OU=robots"),
    subject("of two in one, from the last to the first", ONE_OF_TWO, "O=Organisation+CN=/talker,OU=robots"),
    subject("of two in one, in certificate order", ONE_OF_TWO, "CN=/talker+O=Organisation,OU=robots"),
    subject("with a comma in the value", ((ORG, "Org, Inc"), (CN, "/talker")), "CN=/talker,O=Org\\, Inc"),
    subject("with a quoted comma", ((ORG, "Org, Inc"), (CN, "/talker")), 'CN=/talker,O="Org, Inc"'),
    subject("with a slash in the value", ((ORG, "a/b"), (CN, "/talker")), "CN=/talker,O=a/b"),
    subject("with a plus in the value", ((ORG, "a+b"), (CN, "/talker")), "CN=/talker,O=a\\+b"),
    subject("with an equals sign in the value", ((CN, "/a=b"),), "CN=/a=b"),
    subject("with a quote in the certificate", ((CN, '/tal"ker'),), "CN=/talker"),
    subject("with a backslash in the certificate", ((CN, "/tal\\ker"),), "CN=/talker"),
    subject("beyond ASCII, literal", ((CN, "/tälker"),), "CN=/tälker"),
    subject("beyond ASCII, escaped", ((CN, "/tälker"),), "CN=/t\\C3\\A4lker"),
    subject("with a leading blank in the certificate", ((CN, " /talker"),), "CN=/talker"),
    subject("with a leading #", ((CN, "#talker"),), "CN=\\#talker"),
    subject("with a type of a long name", ((NameOID.POSTAL_CODE, "1"), (CN, "/talker")), "CN=/talker,postalCode=1"),
    subject("empty in the certificate", (), "CN=/talker"),
    subject("with an address, RFC 2253", MEMBER, "emailAddress=a@b.com,CN=CN_TEST,O=Object Computing,C=US"),
    subject("with an address by OID", MEMBER, "1.2.840.113549.1.9.1=a@b.com,CN=CN_TEST,O=Object Computing,C=US"),
    subject("with an address as E", MEMBER, "E=a@b.com,CN=CN_TEST,O=Object Computing,C=US"),
    subject("with an address, between slashes", MEMBER, "/C=US/O=Object Computing/CN=CN_TEST/emailAddress=a@b.com"),
    subject("between slashes, in another order", MEMBER, "/O=Object Computing/C=US/CN=CN_TEST/emailAddress=a@b.com"),
    subject("between slashes, less one", MEMBER, "/C=US/O=Object Computing/CN=CN_TEST"),
    subject("between slashes, one more", MEMBER, "/C=US/O=Object Computing/OU=x/CN=CN_TEST/emailAddress=a@b.com"),
    subject("between slashes, blanks", MEMBER, "/ C=US / O=Object Computing / CN=CN_TEST / emailAddress=a@b.com"),
    subject("between slashes, the slash of the value escaped", TALKER, "/CN=\\/talker"),
    subject("between slashes, one value with a slash", ORGANISED, "/CN=/talker/O=Org"),
    subject("between slashes, two in one", ONE_OF_TWO, "/OU=robots/CN=\\/talker+O=Organisation"),
    subject("between slashes, one of two in one", ONE_OF_TWO, "/OU=robots/CN=/talker/O=Organisation"),
    subject("between slashes, another attribute in the value", ((ORG, "a/CN=b"),), "/O=a/CN=b"),
    subject("with a name of slash alone", ((CN, "/"),), "CN=/arm"),
    subject("with blanks behind commas", MAIN, _MAIN),
    subject("with blanks behind commas, and one before", MAIN, f" {_MAIN}"),
    subject("with blanks behind commas, and one behind", MAIN, f"{_MAIN} "),
    subject("with blanks behind commas, in line ends", MAIN, f"\n{_MAIN}\n"),
    subject("of several parts, and a blank before", MAIN, " " + _MAIN.replace(", ", ",")),
    subject("of several parts, and a blank behind", MAIN, _MAIN.replace(", ", ",") + " "),
    subject("of several parts, in line ends", MAIN, "\n" + _MAIN.replace(", ", ",") + "\n"),
    subject("of several parts, one a line", MAIN, _MAIN.replace(", ", ",\n")),
    subject("with a blank before", TALKER, " CN=/talker"),
    subject("with a blank behind", TALKER, "CN=/talker "),
    subject("with a tab before", TALKER, "\tCN=/talker"),
    subject("with a line end behind", TALKER, "CN=/talker\n"),
    subject("of two parts beyond ASCII, literal", MUELLER, "CN=/talker,O=Müller GmbH"),
    subject("of two parts beyond ASCII, escaped", MUELLER, "CN=/talker,O=M\\C3\\BCller GmbH"),
    subject("of two parts beyond ASCII, escaped in small letters", MUELLER, "CN=/talker,O=M\\c3\\bcller GmbH"),
    subject("of two parts beyond ASCII, between slashes", MUELLER, "/O=M\\C3\\BCller GmbH/CN=/talker"),
)
