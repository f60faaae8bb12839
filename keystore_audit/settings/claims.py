"""What settings assert (`[[property]]`): a form each, of which those that rest on forwards are in `forwards`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final

from keystore_audit.errors import UsageError
from keystore_audit.model.claims.forwards import Declared, Determinism, Forward
from keystore_audit.model.claims.globs import Globs
from keystore_audit.model.claims.stated import Claim
from keystore_audit.model.formal.claim import Attacker, ClaimKind
from keystore_audit.model.matching.expression import has_wildcard
from keystore_audit.properties import BY_ID
from keystore_audit.settings.forwards import FORM, read_determinism, read_forwards
from keystore_audit.settings.table import OUTSIDER, WORD, Table, globs


def read_properties(root: Table) -> tuple[tuple[Claim, ...], Declared]:
    """What is asserted, and what is declared and asserted of behaviour. Raises errors.UsageError."""
    forwards = read_forwards(root)
    claims: dict[str, Claim | Determinism] = {}
    for table in root.tables("property"):
        claim = _claim(table, forwards)
        if claim.id in claims:
            table.wrong("name", f"there is a property {claim.id!r} already, at {claims[claim.id].place}")
        claims[claim.id] = claim
    return (
        tuple(claim for claim in claims.values() if isinstance(claim, Claim)),
        Declared(forwards=forwards, claims=tuple(claim for claim in claims.values() if isinstance(claim, Determinism))),
    )


def place(word: str) -> Globs:
    """Where a flow begins or ends, written as in settings. Raises errors.UsageError."""
    try:
        return globs((word,))
    except ValueError as error:
        raise UsageError(f"{error}.") from error


def _claim(table: Table, forwards: tuple[Forward, ...]) -> Claim | Determinism:
    known = (*_FORMS, FORM)
    table.only("name", "description", "severity", "until", *known)
    forms = [form for form in known if form in table.values]
    name = table.text("name")
    if not WORD.fullmatch(name) or name in BY_ID:
        taken = "the name of a property that is always decided" if name in BY_ID else "no name"
        table.wrong("name", f'{name!r} is {taken}; expected letters a to z, digits and hyphens, e.g. "no-leak"')
    if len(forms) != 1:
        table.wrong(None, f"expected exactly one of {', '.join(known)} in property {name!r}, found {len(forms)}")
    severity = table.severity()
    if forms[0] == FORM:
        return read_determinism(table, name, severity, forwards)
    said = _FORMS[forms[0]](table, forms[0])
    statement = said.pop("statement")
    return Claim(
        id=name,
        statement=table.described(statement),
        severity=severity,
        until=table.instant("until"),
        location=table.location,
        place=table.place(),
        marks=table.marks,
        **said,
    )


def _no_flow(table: Table, key: str) -> dict[str, Any]:
    form = table.table(key)
    form.only("from", "to", "through", "attacker", "include_ambient")
    through = form.enclaves("through") if "through" in form.values else ()
    besides = f" except through {_listed(through)}" if through else ""
    return {
        "kind": ClaimKind.NO_FLOW,
        "attacker": form.attacker(),
        "source": form.place_of("from"),
        "target": form.place_of("to"),
        "through": through,
        "include_ambient": form.flag("include_ambient"),
        "statement": f"Nothing gets from {_listed(form.texts('from'))} to {_listed(form.texts('to'))}{besides}"
        f"{'' if form.flag('include_ambient') else ', apart from topics that nearly every node uses'}.",
    }


def _able(table: Table, key: str) -> dict[str, Any]:
    form = table.table(key)
    form.only("from", "to", "include_ambient")
    return {
        "kind": ClaimKind.ABLE,
        "attacker": Attacker.HONEST,
        "source": form.place_of("from"),
        "target": form.place_of("to"),
        "include_ambient": form.flag("include_ambient"),
        "statement": f"Data can get from {_each(form.texts('from'))} to {_each(form.texts('to'))}, by what "
        "permissions allow; whether governances match (KA416), nodes can be made (KA636) and use it is not asked.",
    }


def _only_publish(table: Table, key: str) -> dict[str, Any]:
    form = table.table(key)
    form.only("topic", "enclaves")
    return {
        "kind": ClaimKind.ONLY_PUBLISH,
        "attacker": Attacker.INSIDER,
        "source": Globs(enclaves=form.enclaves("enclaves")),
        "target": Globs(topics=form.topics("topic")),
        "include_ambient": True,
        "statement": f"Only {_listed(form.texts('enclaves'))} may publish {_listed(form.texts('topic'))}.",
    }


def _encrypted(table: Table, key: str) -> dict[str, Any]:
    form = table.table(key)
    form.only("topic", "against")
    against = form.choice("against", ("outsider", "insider"))
    return {
        "kind": ClaimKind.ENCRYPTED,
        "attacker": Attacker(against),
        "source": Globs(),
        "target": Globs(topics=form.topics("topic")),
        "include_ambient": True,
        "statement": f"{_listed(form.texts('topic'))} is encrypted against "
        f"{'outsiders' if against == OUTSIDER else 'insiders that no grant lets read it'}.",
    }


def _never_share_domain(table: Table, key: str) -> dict[str, Any]:
    sides = table.enclaves(key)
    if len(sides) != 2:
        table.wrong(key, f"expected two globs on enclaves, found {len(sides)}")
    return {
        "kind": ClaimKind.SEPARATE_DOMAINS,
        "attacker": Attacker.INSIDER,
        "source": Globs(enclaves=sides[:1]),
        "target": Globs(enclaves=sides[1:]),
        "include_ambient": True,
        "statement": f"{sides[0]} and {sides[1]} can never join one domain.",
    }


_FORMS: Final[Mapping[str, Callable[[Table, str], dict[str, Any]]]] = {
    "no_flow": _no_flow,
    "only_publish": _only_publish,
    "encrypted": _encrypted,
    "never_share_domain": _never_share_domain,
    "able": _able,
}


def _listed(words: Iterable[str]) -> str:
    return ", ".join(words)


def _each(words: Sequence[str]) -> str:
    """All of the places, one by one, where they are several; a glob on topics is one place."""
    told = _listed(f"some topic of {w}" if has_wildcard(w) and not w.startswith("/") else w for w in words)
    several = len(words) > 1 or (has_wildcard(words[0]) and words[0].startswith("/"))
    return f"each of {told}" if several else told
