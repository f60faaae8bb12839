"""SROS2 policies, 0.2.0 (Foxy and later) and 0.1.0 (Crystal to Eloquent): what each enclave's nodes are to do.

The form is that of the ROS 2 design article "SROS2 access control policies"; what names in it mean is what sros2's
permissions.xsl makes of them.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, Final

from lxml import etree
from msgspec import Struct

from keystore_audit.errors import UsageError
from keystore_audit.findings import Location
from keystore_audit.given import GivenFile
from keystore_audit.intent.intent import Action, IntendedNode, IntendedRight, Intent, Origin
from keystore_audit.intent.source import MAX_DETAIL, malformed, shown
from keystore_audit.intent.xinclude import Expanded, expand
from keystore_audit.keystore.document import elements, joined
from keystore_audit.resources import schemas
from keystore_audit.text import shorten

OLD: Final = "0.1.0"
CURRENT: Final = "0.2.0"

MAX_NAME: Final = 1024
"""Characters of a name or path: rmw takes 247 in a name."""

_FORMS: Final = {OLD: "profiles", CURRENT: "enclaves"}
"""The one element that a policy of the version holds."""

_PRINTABLE: Final = re.compile(r"[!-~]+")
_YAML: Final = re.compile(r"(?:\s*#[^\n]*\n|\s)*(?:---|[\w-]+\s*:)", re.ASCII)


class Profiles(Struct, frozen=True, kw_only=True):
    """A `<profiles>` of an enclave (0.1.0: a `<profile>`), of which sros2 makes one grant.

    `lost`: why no implementation asks that grant, a sentence ("" if it counts): of several grants with one subject the
    first in force decides, and of several `<enclave>` elements with one path sros2 translates the first.
    """

    enclave: str
    location: Location
    nodes: tuple[IntendedNode, ...]
    rights: tuple[IntendedRight, ...]
    lost: str


class Policy(Struct, frozen=True, kw_only=True):
    """A policy with all that it includes, in order. `path`: as the user gave it."""

    path: str
    version: str
    files: tuple[GivenFile, ...]
    profiles: tuple[Profiles, ...]

    @property
    def intent(self) -> Intent:
        """What its author means: everything it says, what is lost on the way included."""
        enclaves: dict[str, Location] = {}
        for profiles in self.profiles:
            enclaves.setdefault(profiles.enclave, profiles.location)
        return Intent(
            origin=Origin.POLICY,
            path=self.path,
            files=self.files,
            enclaves=tuple(enclaves.items()),
            nodes=tuple(node for profiles in self.profiles for node in profiles.nodes),
            rights=tuple(right for profiles in self.profiles for right in profiles.rights),
        )


def read_policy(path: str | os.PathLike[str], include: str | os.PathLike[str] | None = None) -> Policy:
    """Read the policy at `path`; what it includes has to be below the directory `include` (None: its own).

    Raises UsageError, naming file and line, for a policy that is none or cannot be read.
    """
    try:
        expanded = expand(path, include)
    except UsageError as error:
        raise _yaml(path) or error from None
    root = expanded.root
    _validate(expanded)
    version = str(root.get("version"))
    form = elements(root)[0]
    if form.tag != _FORMS[version]:
        expected = f"expected <{_FORMS[version]}> in a policy of version {version}, found <{form.tag!s}>"
        raise malformed(expanded.location(form), expected)
    found = _Reader(expanded, version).profiles(form)
    return Policy(path=os.fspath(path), version=version, files=expanded.read, profiles=tuple(found))


class _Reader:
    """Reads a valid policy."""

    def __init__(self, expanded: Expanded, version: str) -> None:
        self._expanded = expanded
        self._version = version
        self._seen: dict[str, Location] = {}

    def profiles(self, form: etree._Element) -> Iterator[Profiles]:
        """What becomes a grant each, in order."""
        for element in elements(form):
            if self._version == OLD:
                yield self._grant(_qualified(self._namespace(element), self._name(element, "node")), element, [element])
                continue
            path = self._name(element, "path")
            if not path.startswith("/"):
                raise self._malformed(
                    element, f"expected the path of an enclave such as '/talker', found {shown(path)}"
                )
            again = self._seen.get(path)
            for profiles in elements(element):
                nodes = [child for child in elements(profiles) if child.tag == "profile"]
                yield self._grant(path, profiles, nodes, again)

    def _grant(
        self, enclave: str, element: etree._Element, nodes: list[etree._Element], again: Location | None = None
    ) -> Profiles:
        location = self._expanded.location(element)
        first = self._seen.setdefault(enclave, location)
        lost = ""
        if again is not None:
            lost = f"of several <enclave> elements with one path the first is translated (line {again.line})"
        elif first is not location:
            lost = f"of several grants for one enclave the first decides (line {first.line})"
        return Profiles(
            enclave=enclave,
            location=location,
            nodes=tuple(self._node(enclave, node) for node in nodes),
            rights=tuple(right for node in nodes for right in self._rights(enclave, node)),
            lost=lost,
        )

    def _node(self, enclave: str, profile: etree._Element) -> IntendedNode:
        name = _qualified(self._namespace(profile), self._name(profile, "node"))
        return IntendedNode(enclave=enclave, name=name, location=self._expanded.location(profile))

    def _rights(self, enclave: str, profile: etree._Element) -> Iterator[IntendedRight]:
        namespace, node = self._namespace(profile), self._name(profile, "node")
        for group in elements(profile):
            # Version 0.1.0 has no other attributes either; xml:base is not among the actions.
            actions = [(action, str(group.get(action.value))) for action in Action if group.get(action.value)]
            for entry in elements(group):
                location = self._expanded.location(entry)
                name = self._expanded_name(entry, namespace, node)
                for action, qualifier in actions:
                    yield IntendedRight(
                        enclave=enclave,
                        node=_qualified(namespace, node),
                        action=action,
                        name=name,
                        allow=qualifier == "ALLOW",
                        location=location,
                    )

    def _expanded_name(self, entry: etree._Element, namespace: str, node: str) -> str:
        """The name as permissions.xsl has it: `/x` as it is, `~x` behind the node's name, else below the namespace.

        0.2.0 puts what follows the `~` straight behind the name. Crystal and Dashing put a `/` between, so that their
        policies have `~x` where later ones have `~/x`; `~/x`, of which Dashing made `//`, is read as Eloquent does.
        """
        text = joined(entry)
        if not _is_plain(text):
            raise self._malformed(entry, f"expected a name without blanks in ASCII, found {shown(text)}")
        if text.startswith("/"):
            return text
        if text.startswith("~"):
            between = "/" if self._version == OLD and text[1:2] not in ("", "/") else ""
            return _qualified(namespace, node) + between + text[1:]
        return _qualified(namespace, text)

    def _namespace(self, profile: etree._Element) -> str:
        namespace = str(profile.get("ns", ""))
        if namespace and (not namespace.startswith("/") or _PRINTABLE.fullmatch(namespace) is None):
            raise self._malformed(profile, f"expected an absolute namespace, found ns {shown(namespace)}")
        return namespace

    def _name(self, element: etree._Element, attribute: str) -> str:
        text = str(element.get(attribute, ""))
        if not _is_plain(text):
            raise self._malformed(element, f"expected a {attribute} without blanks in ASCII, found {shown(text)}")
        return text

    def _malformed(self, element: etree._Element, detail: str) -> UsageError:
        return malformed(self._expanded.location(element), detail)


def _is_plain(name: str) -> bool:
    return len(name) <= MAX_NAME and _PRINTABLE.fullmatch(name) is not None


def _qualified(namespace: str, name: str) -> str:
    return f"{namespace}{name}" if namespace.endswith("/") else f"{namespace}/{name}"


def _validate(expanded: Expanded) -> None:
    """Raises UsageError for the first place where the policy is not what the schema has."""
    schema = _schema()
    if schema.validate(expanded.root):
        return
    log: Any = schema.error_log  # the stubs do not know what is in it
    for entry in log:
        detail = shorten(str(entry.message).rstrip("."), MAX_DETAIL)
        raise malformed(expanded.location(_at(expanded.root, entry.path)), f"this is no SROS2 policy: {detail}")
    raise malformed(expanded.location(expanded.root), "this is no SROS2 policy")


def _at(root: etree._Element, path: str | None) -> etree._Element:
    """The element at a path as libxml2 tells it; the root where the path has prefixes, which are declared elsewhere."""
    try:
        found: Any = root.getroottree().xpath(path) if path else None
    except etree.XPathError:
        found = None
    return found[0] if isinstance(found, list) and found and etree.iselement(found[0]) else root


@lru_cache(maxsize=1)
def _schema() -> etree.XMLSchema:
    return etree.XMLSchema(etree.parse(str(schemas() / "policy.xsd")))


def _yaml(path: str | os.PathLike[str]) -> UsageError | None:
    """The error for a policy in YAML, which is no XML; None for anything else."""
    name = os.fspath(path)
    if not os.path.isfile(name):
        return None
    try:
        with open(name, "rb") as file:
            beginning = file.read(4096)
    except OSError:
        return None
    if not name.endswith((".yaml", ".yml")) and _YAML.match(beginning.decode("utf-8", "replace")) is None:
        return None
    form = "policies in YAML, which Ardent and Bouncy had, are not supported"
    return UsageError(f"{name}: expected an SROS2 policy in XML (Crystal and later): {form}.")
