"""What to do about a finding, for people: the names of its enclave and document in commands, long commands once."""

from __future__ import annotations

import re
from typing import Final

from keystore_audit.findings import Finding
from keystore_audit.text import PLAIN_PATH

_PLAIN: Final = re.compile(r"(?:/\w+)+", re.ASCII)
"""Enclaves as ROS names them: nothing in them that a shell would read otherwise."""

_FILE: Final = re.compile(r"(?<=-in )FILE\b|(?<=new\.pem )FILE\b")
"""In commands of openssl; others speak of files that the finding is not about."""

_SIGNED: Final = re.compile(r"enclaves/(?:(?:\w+/)*(governance)|((?:\w+/)+permissions))\.(?:p7s|xml)", re.ASCII)
_AUTHORITY: Final = re.compile(r"public/(identity|permissions)_ca\.cert\.pem")
_ROLES: Final = ", ROLE being identity or permissions"
_NAME: Final = "'/CN=NAME'"
_WHICH: Final = re.compile(r", (?:DOCUMENT|NAME) being [^,;.]+")
_DEEPER: Final = ", with one ../ more for every further level of the enclave's path"
_OF_ALL: Final = re.compile(r"\bevery (?:enclave|identity|robot)\b")
_BEGINS: Final = re.compile("^|(?<=[.:;] )|(?<=, )(?=correct )")
"""Where a part of a remedy may begin that another one ends with."""

_COMMAND: Final = re.compile("`[^`]+`")
_LONG: Final = 100
"""Characters of what is not said twice."""

_HEAD: Final = re.compile(r".{1,50}\S*", re.DOTALL)
"""The words by which it is found above: of a command that signs, with the name of the document."""


def exact(finding: Finding) -> str:
    """The remedy with the enclave and the document that the finding is about in its commands, where they are plain."""
    return _filled(finding.remedy, finding)


def _filled(remedy: str, finding: Finding) -> str:
    """The same of a part of the remedy."""
    document, enclave, file = _named(finding)
    if file:
        remedy = _FILE.sub(file, remedy)
    if (authority := _AUTHORITY.fullmatch(file)) is not None:
        remedy = remedy.replace(_ROLES, "").replace("ROLE", authority[1])
    if document:
        remedy = _WHICH.sub("", remedy).replace("DOCUMENT", document)
    if enclave:
        if _NAME in remedy:
            subject = enclave.replace("/", r"\/")
            remedy = _WHICH.sub("", remedy).replace(_NAME, f"'/CN={subject}'")
        if _DEEPER in remedy:
            remedy = remedy.replace(_DEEPER, "").replace("`ln -sf ", f"`ln -sf {'../' * (enclave.count('/') - 1)}")
        remedy = remedy.replace("enclaves/ENCLAVE/", f"enclaves{enclave}/").replace("ENCLAVE", enclave)
    return remedy


def _named(finding: Finding) -> tuple[str, str, str]:
    """What DOCUMENT, ENCLAVE, and FILE or the file of the ROLE are in the remedy, empty where they stay."""
    remedy, enclave = finding.remedy, finding.enclave or ""
    signed = (_SIGNED.fullmatch(place.path) for place in finding.locations)
    document = next((found[1] or found[2] for found in signed if found), "") if "DOCUMENT" in remedy else ""
    plain = "ENCLAVE" in remedy and _PLAIN.fullmatch(enclave) and not _OF_ALL.search(remedy)
    first = finding.locations[0].path if finding.locations else ""
    told = (_FILE.search(remedy) and PLAIN_PATH.fullmatch(first)) or (_ROLES in remedy and _AUTHORITY.fullmatch(first))
    return document, enclave if plain else "", first if told else ""


class Remedies:
    """Those of one report in their order: what was given above is named, and not given again."""

    def __init__(self) -> None:
        """Nothing is given yet."""
        self._codes: dict[str, list[str]] = {}
        self._parts: dict[str, Finding] = {}

    def told(self, finding: Finding) -> bool:
        """Whether the remedy was given above under the finding's own code."""
        return finding.code in self._codes.get(finding.remedy, ())

    def give(self, finding: Finding) -> str:
        """What is to be said of the finding's remedy."""
        remedy = finding.remedy
        codes = self._codes.setdefault(remedy, [])
        first = next(iter(codes), None)
        codes.append(finding.code)
        if _DEEPER in remedy:  # a link is another at another depth
            return exact(finding)
        if first is not None:
            return f"as for {first} above{_for(finding)}"
        parts = {begin.start(): remedy[begin.start() :].rstrip(".") for begin in _BEGINS.finditer(remedy)}
        above = ((at, self._parts[part]) for at, part in parts.items() if len(part) >= _LONG and part in self._parts)
        found = next(above, None)
        if found is None:
            for part in (*parts.values(), *_COMMAND.findall(remedy)):
                self._parts.setdefault(part, finding)
            return exact(finding)
        at, other = found
        before, head = remedy[:at], _HEAD.findall(_filled(remedy[at:], other).lstrip("`"))[0]
        go_on = "Go on as" if before.endswith(". ") else "as"
        return f'{_filled(before, finding)}{go_on} for {other.code} above ("{head} …"){_for(finding)}.'


def _for(finding: Finding) -> str:
    """Whose names belong into what was given above for another."""
    document, enclave, file = _named(finding)
    name = f"enclaves/{document}" if document else enclave or file
    return f", for {name}" if name else ""
