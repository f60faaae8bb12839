"""Remedies: what to do about a finding, in steps.

A step is a sentence, or an act on files of the keystore that a script can do. A rule declares its remedy in general,
and a finding has it with the files it is about (`keystore_audit.rules.remedies`). `explain CODE --for KEYSTORE` prints
the script (`keystore_audit.report.script`).
"""

from __future__ import annotations

from enum import Enum
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.text import some

MAX_PATHS: Final = 3
"""Files named in the text of a step; `paths` has them all."""


class Kind(str, Enum):
    """Who can do it: a script; a script when somebody has decided and edited something; nobody in the keystore."""

    MECHANICAL = "mechanical"
    DECISION = "decision"
    OUTSIDE = "outside"


class Act(str, Enum):
    """What a script does; the value stands in JSON. What somebody edits first is signed as it is then."""

    SIGN = "sign"
    EDIT = "edit"
    EDIT_GOVERNANCE = "edit-governance"
    EDIT_PERMISSIONS = "edit-permissions"
    ISSUE = "issue"
    RENEW = "renew"
    NEW_IDENTITY_CA = "new-identity-ca"
    NEW_PERMISSIONS_CA = "new-permissions-ca"
    LINK = "link"
    CLOSE_KEY = "chmod-600"
    CLOSE = "chmod-go-w"


_SAID: Final = {
    Act.SIGN: "Sign the document again with the permissions CA.",
    Act.EDIT: "Write it into the document's .xml, and sign that with the permissions CA.",
    Act.EDIT_GOVERNANCE: "Write it into the governance's .xml, and sign that with the permissions CA.",
    Act.EDIT_PERMISSIONS: (
        "Write it into permissions.xml, and sign that with the permissions CA; or into the policy, and run `ros2 "
        "security create_permission KEYSTORE ENCLAVE policy.xml`."
    ),
    Act.ISSUE: "Issue a new key and certificate under the identity CA, for a year.",
    Act.RENEW: "Renew the authority's certificate, with its own key and name, and sign again what names the old one.",
    Act.NEW_IDENTITY_CA: "Make a new identity CA, and issue all identities under it, for a year.",
    Act.NEW_PERMISSIONS_CA: "Make a separate permissions CA, and sign all documents with it.",
    Act.LINK: "Make the link again, as sros2 makes it.",
    Act.CLOSE_KEY: "Take the rights of other users from the key (chmod 600).",
    Act.CLOSE: "Take the right to write from other users (chmod go-w).",
}


class Step(Struct, frozen=True, kw_only=True):
    """A sentence and, where a script can do it, the act. `paths`: the files it writes, as in `Location.path`; none in a
    remedy that is about no keystore, and where the keystore has not the layout that sros2 makes since Foxy.
    """

    text: str
    act: Act | None = None
    paths: tuple[str, ...] = ()

    def at(self, paths: tuple[str, ...]) -> Step:
        """The act on these files."""
        named = f"{self.text.rstrip('.')}: {some(paths, MAX_PATHS)}." if paths else self.text
        return replace(self, text=named, paths=paths)


class Remedy(Struct, frozen=True, kw_only=True):
    """What to do, in this order."""

    kind: Kind
    steps: tuple[Step, ...]

    @property
    def text(self) -> str:
        """All of it for people."""
        return " ".join(step.text for step in self.steps)

    @property
    def general(self) -> str:
        """The same without the names of files, which several findings of a rule share."""
        return " ".join(map(_sentence, self.steps))

    @property
    def short(self) -> str:
        """Its first step, without the names of files."""
        return _sentence(self.steps[0])

    @property
    def scripted(self) -> bool:
        """Whether there is something that a script does."""
        return any(step.paths for step in self.steps)


def _sentence(step: Step) -> str:
    return step.text if step.act is None else _SAID[step.act]


def _remedy(kind: Kind, text: str, acts: tuple[Act, ...]) -> Remedy:
    said = (Step(text=text),) if text else ()
    return Remedy(kind=kind, steps=(*said, *(Step(text=_SAID[act], act=act) for act in acts)))


def mechanical(text: str, *acts: Act) -> Remedy:
    """What a script does without being told anything."""
    return _remedy(Kind.MECHANICAL, text, acts)


def decision(text: str, *acts: Act) -> Remedy:
    """What somebody has to decide; then, where there are acts, a script does the rest."""
    return _remedy(Kind.DECISION, text, acts)


def outside(text: str) -> Remedy:
    """What no edit of the keystore brings about."""
    return _remedy(Kind.OUTSIDE, text, ())
