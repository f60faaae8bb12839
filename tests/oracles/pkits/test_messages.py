"""The S/MIME messages of PKITS: envelope, signer and content beside OpenSSL as DDS implementations call it.

What is asked is what is asked of governance.p7s: pinned, whether a certificate of the permissions CA file made the
signature (paths, dates and lists are nobody's business then); by the older variants, whether the signer chains to it.
As they are, all messages carry revocation lists, which we do not interpret, so that they are tried without them too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from msgspec import Struct

from keystore_audit.keystore.certificate import CertificateFile
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.smime import Candidates, SignedDocument, read_signed
from keystore_audit.model.trust.verdicts import document_verdict
from keystore_audit.profiles import VARIANTS
from keystore_audit.truth import Truth
from tests.keystore.builder import present
from tests.keystore.builder import read as read_pem
from tests.oracles.pkits import suite
from tests.oracles.pkits.suite import Case, pem
from tests.oracles.smime.oracle import Oracle, running

pytestmark = pytest.mark.xdist_group("pkits")

PINNED, UNPINNED = VARIANTS["spec"].trust, VARIANTS["cyclonedds-0.10"].trust

UNKNOWN = {
    "4.1.4 ValidDSASignaturesTest4": "signed with DSA, which is not checked here",
    "4.1.5 ValidDSAParameterInheritanceTest5": "a DSA key without parameters; OpenSSL refuses it",
    "4.1.6 InvalidDSASignatureTest6": "signed with DSA (the wrong signature is the certificate's)",
}
"""Messages that leave us in doubt: the audit is incomplete then."""


@pytest.fixture(scope="module")
def openssl(oracle: Callable[[str], str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Oracle]:
    with running(oracle, tmp_path_factory.mktemp("oracle")) as asked:
        yield asked
        assert not asked.crashes


class Reading(Struct, frozen=True):
    """A message as we read it, for a permissions CA file that holds one certificate."""

    document: SignedDocument
    authority: CertificateFile

    def verdict(self, *, pins_signer: bool) -> Truth:
        return document_verdict(self.document, self.authority, PINNED if pins_signer else UNPINNED)


def reading(message: bytes, authority: bytes) -> Reading:
    file = read_pem(pem("CERTIFICATE", authority))
    return Reading(read_signed(present(message, "permissions.p7s"), Candidates(file.certificates)), file)


def asked(openssl: Oracle, message: bytes, authority: bytes) -> tuple[bytes | None, bytes | None]:
    openssl.trust(pem("CERTIFICATE", authority))
    answer = openssl.ask(message)
    assert not answer.split
    return answer.pinned, answer.chained


def test_the_signer_as_permissions_ca(openssl: Oracle) -> None:
    """Pinned: both accept, and read the same bytes."""
    for case in suite.load().cases:
        ours = reading(case.without_lists, case.signer)
        pinned, _chained = asked(openssl, case.without_lists, case.signer)
        verdict = ours.verdict(pins_signer=True)
        if case.label in UNKNOWN:
            assert verdict is Truth.UNKNOWN, case.label
        else:
            assert verdict is Truth.YES, case.label
            assert pinned is not None, case.label
            assert ours.document.content == pinned == b"This is a sample signed message.\r\n", case.label


def test_another_as_permissions_ca(openssl: Oracle) -> None:
    """Pinned: neither the issuer nor the trust anchor nor another signer signed it."""
    cases = suite.load().cases
    for case, other in zip(cases, (*cases[1:], cases[0]), strict=True):
        for authority in {suite.load().anchor, *case.issuers[-1:], other.signer} - {case.signer}:  # 4.14.18 is 19's too
            pinned, _chained = asked(openssl, case.without_lists, authority)
            assert pinned is None, case.label
            ours = reading(case.without_lists, authority)
            unread = not ours.authority.certificates  # of two that inherit the parameters of their DSA keys
            wanted = Truth.UNKNOWN if case.label in UNKNOWN or unread else Truth.NO
            assert ours.verdict(pins_signer=True) is wanted, case.label


def test_messages_with_revocation_lists_are_unknown(openssl: Oracle) -> None:
    """OpenSSL passes the lists by and accepts, so that refused would be wrong, and what they do is not ours to say."""
    for case in suite.load().cases:
        ours = reading(case.message, case.signer)
        assert ours.verdict(pins_signer=True) is Truth.UNKNOWN, case.label
        assert Kind.CMS_MALFORMED in {defect.kind for defect in ours.document.defects}
        pinned, _chained = asked(openssl, case.message, case.signer)
        assert (pinned is None) == (case.number == "4.1.5"), case.label


def test_a_changed_message_is_refused(openssl: Oracle) -> None:
    for case in suite.load().cases[::8]:
        changed = case.without_lists.replace(b"a sample", b"an evil")
        pinned, chained = asked(openssl, changed, case.signer)
        assert (pinned, chained) == (None, None)
        assert reading(changed, case.signer).verdict(pins_signer=True) is not Truth.YES


def chains(openssl: Oracle) -> Iterator[tuple[Case, Truth, bool]]:
    """What we and the older variants say of every message whose signer should chain to the trust anchor."""
    anchor = suite.load().anchor
    for case in suite.load().cases:
        _pinned, chained = asked(openssl, case.without_lists, anchor)
        yield case, reading(case.without_lists, anchor).verdict(pins_signer=False), chained is not None


def test_what_older_variants_accept_is_not_refused(openssl: Oracle) -> None:
    wrong = [case.label for case, verdict, accepted in chains(openssl) if accepted and verdict is Truth.NO]
    assert not wrong, wrong


def test_what_older_variants_refuse_is_hardly_accepted(openssl: Oracle) -> None:
    """But for what is not looked at in a chain to a signer that is not the permissions CA.

    That nobody takes such a document is never said: it is a critical finding for every profile (KA301, KA302), and
    whoever may sign counts as signing.
    """
    wrong = [case for case, verdict, accepted in chains(openssl) if verdict is Truth.YES and not accepted]
    strange = [case.label for case in wrong if case.section not in {"4.2", "4.13"} and case.number != "4.6.1"]
    assert not strange, "neither dates nor name constraints nor an authority by keyUsage alone"


def test_chains_are_followed(openssl: Oracle) -> None:
    """Both accept most of what is valid, and what only policies or revocation lists forbid."""
    both = [case for case, verdict, accepted in chains(openssl) if verdict is Truth.YES and accepted]
    assert len(both) > 170
    assert {case.section for case in both} == suite.SECTIONS.keys()
