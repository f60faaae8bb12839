"""Whether the subject_name of a grant names a certificate, as each implementation compares them.

DDS-Security 1.1 (9.4.1.3) asks for the subject in the form of RFC 2253 and leaves the comparison open. Every
implementation has its own comparison (sources: docs/security-model.md). All of them find the name that `ros2 security`
writes; they differ about order, blanks, quotes, escapes, repeated attributes and text that does not belong there.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from itertools import chain
from typing import Final

from cryptography import x509
from msgspec import Struct

from keystore_audit.grouped import gathered
from keystore_audit.keystore.attribute_types import SHORT_NAMES
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.xml import BLANKS
from keystore_audit.model.subjects.attributes import Subject, compact, oneline, relative_names, typed
from keystore_audit.profiles import SubjectComparison

TOKENWISE: Final = frozenset({SubjectComparison.PIECES_WITHIN, SubjectComparison.TRIMMED_PIECES_WITHIN})
"""Comparisons by parts of names: a text names each subject that is made of some of its own."""

COMPACT_TOO: Final = frozenset({SubjectComparison.PIECES_IN_ORDER, SubjectComparison.ATTRIBUTES})
"""Comparisons of Fast DDS: of a peer, `compact` to the letter will do as well (Permissions.cpp,
validate_remote_permissions). This holds where it answers the handshake (PKIDH.cpp, begin_handshake_reply), not where it
began it. Digests of both subjects decide which of them answers (measured on 2.9.1; of the others read)."""

MAX_PAIRS: Final = 200_000
"""Grants and certificates that are compared one by one: half a second. Only names in odd forms are; beyond it a grant
counts as naming every certificate that an index cannot rule out."""

_MAX_ATTRIBUTES: Final = 20
"""Attributes of a name that Fast DDS keeps (DistinguishedName.h, MAX_VALUES_)."""

_MAX_OCTETS: Final = 1024

MAX_PIECES: Final = 20
"""Attributes of a grant's subject that Cyclone DDS keeps (ac_check_subjects_are_equal)."""

_DELIMITERS: Final = str.maketrans("/|", ",,")

_PLAIN: Final = re.compile(r"CN=(?:/[A-Za-z0-9_]+){1,19}")
"""Subjects as sros2 writes them: each names itself for everybody, and for all but Cyclone DDS nothing else."""

Attributes = tuple[tuple[str, str], ...]
"""Types and values, in order."""


def matching(
    subjects: Iterable[str], certificates: Sequence[Subject], comparison: SubjectComparison, *, own: bool = False
) -> dict[str, frozenset[int]]:
    """For each text of `subjects` the certificates (indices) that a grant with this subject_name is taken to name.

    By peers; `own`: by whoever has the certificate.
    """
    wanted = dict.fromkeys(subjects)
    if comparison is SubjectComparison.EXACT:
        return _equal(wanted, range(len(certificates)), certificates)
    if comparison in TOKENWISE:  # as the parser leaves the text (xmlparser.c, save_payload; measured)
        bare = {text: text.strip(BLANKS) for text in wanted}
        named = _tokenwise(tuple(dict.fromkeys(bare.values())), tuple(certificates), comparison)
        return {text: named[inside] for text, inside in bare.items()}
    found = _typed(wanted, certificates, comparison)
    if not own and comparison in COMPACT_TOO and any(text.startswith("/") for text in wanted):
        compacts = gathered((compact(certificate), number) for number, certificate in enumerate(certificates))
        found = {text: named.union(compacts.get(text, ())) for text, named in found.items()}
    return found


def _typed(
    wanted: Mapping[str, None], certificates: Sequence[Subject], comparison: SubjectComparison
) -> dict[str, frozenset[int]]:
    """By those that compare attribute by attribute; subjects as sros2 writes them need no such thing."""
    plain = [number for number, certificate in enumerate(certificates) if _PLAIN.fullmatch(certificate.subject)]
    odd = sorted(set(range(len(certificates))) - set(plain))
    found = _equal(wanted, plain, certificates)
    by_form = (odd, wanted), (plain, [text for text in wanted if not _PLAIN.fullmatch(text)])
    for numbers, texts in by_form:
        for text, named in _compared(texts, numbers, certificates, comparison).items() if numbers and texts else ():
            found[text] |= named
    return found


def _equal(
    subjects: Iterable[str], numbers: Iterable[int], certificates: Sequence[Subject]
) -> dict[str, frozenset[int]]:
    by_name = gathered((certificates[number].subject, number) for number in numbers)
    return {text: frozenset(by_name.get(text, ())) for text in subjects}


@lru_cache(maxsize=2)
def _tokenwise(
    subjects: tuple[str, ...], certificates: tuple[Subject, ...], comparison: SubjectComparison
) -> dict[str, frozenset[int]]:
    """As Cyclone DDS: where nothing has blanks it does not matter whether they are taken off, so one table is both."""
    if comparison is SubjectComparison.TRIMMED_PIECES_WITHIN:
        names = (_printed(each, escape_non_ascii=True) for each in certificates)
        if not any(" " in text for text in chain(subjects, names)):
            return _tokenwise(subjects, certificates, SubjectComparison.PIECES_WITHIN)
    return _compared(subjects, range(len(certificates)), certificates, comparison)


def _compared(
    subjects: Iterable[str],
    numbers: Sequence[int],
    certificates: Sequence[Subject],
    comparison: SubjectComparison,
) -> dict[str, frozenset[int]]:
    """By the comparison itself, for the certificates `numbers`."""
    by_attribute = _BY_ATTRIBUTE.get(comparison)
    if by_attribute is None:
        parse, print_name = _WHOLE[comparison]
        found = gathered((parse(print_name(certificates[number])), number) for number in numbers)
        found.pop(None, None)  # what is no name names nobody
        return {text: frozenset(found.get(parse(text), ())) for text in subjects}
    printed_names = [
        _printed(certificates[number], escape_non_ascii=by_attribute.escape_non_ascii) for number in numbers
    ]
    index = _Index([by_attribute.parse(name) for name in printed_names], by_attribute)
    return {text: frozenset(numbers[place] for place in index.named(text)) for text in subjects}


def names(subject: str, certificate: Certificate, comparison: SubjectComparison) -> bool:
    """Whether a grant with this subject_name is taken, by whoever has the certificate, to name it."""
    if subject == certificate.subject and _PLAIN.fullmatch(subject):
        return True
    return bool(matching((subject,), (certificate,), comparison, own=True)[subject])


def is_printable(certificate: Certificate) -> bool:
    """Whether `printed` knows how OpenSSL prints the subject: every attribute a string of a type in its table."""
    return all(
        each.oid.dotted_string in SHORT_NAMES and isinstance(each.value, str) for each in certificate.subject_name
    )


def printed(certificate: Subject, *, escape_non_ascii: bool) -> str:
    """The subject as X509_NAME_print_ex gives it with XN_FLAG_RFC2253, without ASN1_STRFLGS_ESC_MSB unless asked.

    As the implementations compute it: Fast DDS leaves UTF-8 as it is (PKIDH.cpp), Cyclone DDS escapes each byte of it
    (access_control_utils.c).
    """
    if _PLAIN.fullmatch(certificate.subject):
        return certificate.subject
    relative = reversed(list(certificate.subject_name.rdns))
    # From the last attribute to the first, those of one relative name too.
    return ",".join(
        "+".join(_attribute(each, escape=escape_non_ascii) for each in reversed(list(rdn))) for rdn in relative
    )


def _attribute(attribute: x509.NameAttribute[str | bytes], *, escape: bool) -> str:
    kind, value = typed(attribute)
    return f"{kind}={escaped(value, escape=escape)}"


def escaped(value: str, *, escape: bool = False) -> str:
    """Escapes of RFC 2253, 2.4, as do_esc_char of OpenSSL makes them (crypto/asn1/a_strex.c)."""
    pieces = []
    for place, character in enumerate(value):
        edge = (place == 0 and character in " #") or (place == len(value) - 1 and character == " ")
        if edge or character in ',+"\\<>;':
            pieces.append("\\" + character)
        elif ord(character) < 0x20 or ord(character) == 0x7F or (escape and ord(character) > 0x7F):
            pieces.append("".join(f"\\{byte:02X}" for byte in character.encode("utf-8", "surrogatepass")))
        else:
            pieces.append(character)
    return "".join(pieces)


# --- equal keys


@lru_cache(maxsize=32_768)
def _printed(certificate: Subject, *, escape_non_ascii: bool) -> str:
    """As an implementation keeps it: Fast DDS, which leaves UTF-8, what fits into its buffer (PKIDH.cpp; measured)."""
    whole = printed(certificate, escape_non_ascii=escape_non_ascii)
    if escape_non_ascii or len(whole) <= _MAX_OCTETS // 4:
        return whole
    return whole.encode("utf-8", "surrogatepass")[:_MAX_OCTETS].decode("utf-8", "backslashreplace")


def _ordered(text: str) -> tuple[str, ...]:
    """Fast DDS before 2.14: pieces between commas, blanks around them off, up to the first empty piece.

    Permissions.cpp, rfc2253_string_compare at v2.6.12 (read; order, blanks and the trailing comma measured).
    """
    pieces = []
    for piece in text.split(","):
        if not piece:
            break
        pieces.append(_trimmed(piece))
    return tuple(pieces)


def _trimmed(piece: str) -> str:
    """Blanks off, save that a piece of two characters keeps its blank: the loops there stop one too early."""
    low, high = 0, len(piece) - 1
    while low < len(piece) and piece[low] == " " and low + 1 != high:
        low += 1
    while high > 0 and piece[high] == " " and high - 1 != low:
        high -= 1
    return piece[low : high + 1]


def split(text: str, delimiter: str) -> Iterator[str]:
    """The pieces between delimiters that no backslash escapes and no quotes enclose."""
    if "\\" not in text and '"' not in text:  # nearly always
        yield from text.split(delimiter)
        return
    begin, place, quoted = 0, 0, False
    while place < len(text):
        if text[place] == "\\":
            place += 1
        elif text[place] == '"':
            quoted = not quoted
        elif text[place] == delimiter and not quoted:
            yield text[begin:place]
            begin = place + 1
        place += 1
    yield text[begin:]


# --- one name within another


class _Index:
    """Certificates by attributes that a text needs to have, or to share with them, to name them."""

    def __init__(self, certificates: Sequence[Attributes], comparison: Comparison) -> None:
        self._certificates = certificates
        self._comparison = comparison
        self._sets = [frozenset(attributes) for attributes in certificates]
        self._found: dict[tuple[str, str], list[int]] = {}
        self._pairs_left = MAX_PAIRS
        counts: dict[tuple[str, str], int] = {}
        for attributes in certificates:
            for attribute in set(attributes):
                counts[attribute] = counts.get(attribute, 0) + 1
        for number, attributes in enumerate(certificates):
            wanted = set(attributes)
            if comparison.names is None:  # all of them have to be in the text: the rarest is enough to look for
                wanted = {min(wanted, key=lambda attribute: (counts[attribute], attribute))} if wanted else set()
            for attribute in wanted:
                self._found.setdefault(attribute, []).append(number)
        # Nothing has to be in the text for a name of no attributes: Cyclone DDS takes any for it (read).
        self._nameless = [number for number, attributes in enumerate(certificates) if not attributes]

    def named(self, text: str) -> frozenset[int]:
        """The certificates that the text names; beyond the budget, all that the index cannot rule out."""
        attributes = self._comparison.parse(text)
        names = self._comparison.names
        if names is None:
            found = [number for each in dict.fromkeys(attributes) for number in self._found.get(each, ())]
            candidates = [*found, *self._nameless]
        elif attributes and attributes[0][1]:
            candidates = self._found.get(attributes[0], [])
        else:  # an empty value is equal to none at all
            candidates = list(range(len(self._certificates)))
        self._pairs_left -= len(candidates)
        if self._pairs_left < 0:
            return frozenset(candidates)
        if names is None:
            # The first of each type in the text; an empty type stands for what nothing names.
            first = frozenset(each for each in dict(reversed(attributes)).items() if each[0])
            pieces = filter(None, text.translate(_DELIMITERS).split(","))
            kept = len(list(pieces)) <= MAX_PIECES
            return frozenset(number for number in candidates if kept and self._sets[number] <= first)
        return frozenset(number for number in candidates if names(attributes, self._certificates[number]))


class Comparison(Struct, frozen=True, kw_only=True):
    """A comparison attribute by attribute.

    `names`: whether the attributes of a text name those of a certificate. None: if every attribute of the certificate
    is the first of its type in the text, whatever else the text has. `escape_non_ascii`: how the certificate's name is
    printed before it is parsed.
    """

    parse: Callable[[str], Attributes]
    names: Callable[[Attributes, Attributes], bool] | None
    escape_non_ascii: bool


def _typed_attributes(text: str) -> Attributes:
    """Fast DDS since 2.14: `type=value` between commas outside quotes and escapes, as far as the text has that form.

    Blanks around, quotes and backslashes do not count (DistinguishedName.cpp; measured on 2.14.6, 3.2.5 and 3.6.2).
    """
    attributes: list[tuple[str, str]] = []
    rest = text.lstrip(" ")
    while rest and len(attributes) < _MAX_ATTRIBUTES:
        kind, sign, behind = _cut(rest, "=")
        if not sign:
            break
        value, _sign, following = _cut(behind, ",")
        # A cut of no length takes everything there (Attribute::cut), so an empty type or value is all that follows.
        attributes.append((_plain(kind or rest), _plain(value or behind)))
        rest = following.lstrip(" ")
    return tuple(attributes)


def _cut(text: str, delimiter: str) -> tuple[str, str, str]:
    """Like str.partition, at the first delimiter outside quotes and escapes."""
    head = next(split(text, delimiter))
    return head, text[len(head) : len(head) + 1], text[len(head) + 1 :]


def _plain(text: str) -> str:
    return text.strip(" ").replace("\\", "").replace('"', "")


def _names_in_any_order(text: Attributes, certificate: Attributes) -> bool:
    """As many attributes, and each of the text is the first of its type in the certificate.

    So a repeated attribute names other subjects, and a subject with a repeated type is not even named by itself.
    """
    first = dict(reversed(certificate))
    return len(text) == len(certificate) and all(first.get(kind, "") == value for kind, value in text)


def _pieces(text: str, *, trimmed: bool) -> Attributes:
    """Cyclone DDS: pieces between `,`, `/` and `|`, each `type=value`, or a type without value.

    So `CN=/robot/arm` is `CN=`, `robot=` and `arm=` (access_control_utils.c, string_to_properties; measured with the
    plugin of 0.10.2, the subset on 11.0.1 too). Of a certificate no piece but the last may be empty: nothing names it
    then, which the empty type stands for here.
    """
    if not text:
        return ()
    attributes = []
    for piece in text.translate(_DELIMITERS).removesuffix(",").split(","):
        kind, _sign, value = piece.partition("=")
        attributes.append((kind.strip(" "), value.strip(" ")) if trimmed else (kind, value))
    return tuple(attributes)


_BY_ATTRIBUTE: Final = {
    SubjectComparison.ATTRIBUTES: Comparison(
        parse=_typed_attributes, names=_names_in_any_order, escape_non_ascii=False
    ),
    SubjectComparison.PIECES_WITHIN: Comparison(
        parse=partial(_pieces, trimmed=False),
        names=None,
        escape_non_ascii=True,
    ),
    SubjectComparison.TRIMMED_PIECES_WITHIN: Comparison(
        parse=partial(_pieces, trimmed=True), names=None, escape_non_ascii=True
    ),
}

_WHOLE: Final[Mapping[SubjectComparison, tuple[Callable[[str], object], Callable[[Subject], str]]]] = {
    SubjectComparison.PIECES_IN_ORDER: (_ordered, partial(_printed, escape_non_ascii=False)),
    SubjectComparison.RELATIVE_NAMES: (relative_names, oneline),
}
"""How a comparison of the whole takes texts apart, and how it prints a certificate's subject before."""
