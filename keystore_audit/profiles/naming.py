"""What people call implementations, scopes and peculiarities."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import Final

from keystore_audit.grouped import gathered
from keystore_audit.profiles.peculiarities import Profile
from keystore_audit.profiles.scope import DEFAULT
from keystore_audit.profiles.table import QUIRKS, SPEC, VARIANTS, answer, inflected, sharing, value_name, value_of
from keystore_audit.text import some

MAX_NAMED: Final = 6
"""Implementations named one by one; the profiles of a finding have them all."""

TESTED_ON: Final = " and ".join(profile.asked for profile in VARIANTS.values() if profile.asked)
"""`Fast DDS 2.9.1 and Cyclone DDS 0.10.2`: what this project's tests ask."""


def implementations(profiles: Iterable[Profile | str]) -> str:
    """`Cyclone DDS 0.10 (Humble, Jazzy, Kilted)`, of profiles or of the names of known ones."""
    found = (each if isinstance(each, Profile) else VARIANTS.get(each) for each in profiles)
    return some([_implementation(profile) for profile in found if profile is not None], MAX_NAMED)


def _implementation(profile: Profile) -> str:
    shipped = ", ".join(name.capitalize() for name in profile.distributions)
    return f"{profile.title} ({shipped})" if shipped else profile.title


def shipped_by(names: Iterable[str]) -> str:
    """`Humble, Jazzy`: the distributions that ship one of these variants; empty where none does."""
    found = {each for name in names if name in VARIANTS for each in VARIANTS[name].distributions}
    return ", ".join(name.capitalize() for name in sorted(found))


def scope_of(profiles: Sequence[Profile]) -> str:
    """`Jazzy with Fast DDS 2.14; /arm on Cyclone DDS 0.10, declared`: what a verdict over these is about.

    Empty where it is about all that supported distributions ship, or where nothing was judged.
    """
    most, mixed = _most_run(profiles), declared(profiles)
    return f"{most or 'all that supported distributions ship'}; {mixed}" if mixed else most


def declared(fleets: Iterable[Profile]) -> str:
    """`/arm on Cyclone DDS 0.10, declared`: what enclaves run that settings name; empty where they name none."""
    others = gathered(other for fleet in fleets for other in fleet.others)
    said = [f"{path} on {' or '.join(dict.fromkeys(each.title for each in run))}" for path, run in others.items()]
    return f"{some(said, MAX_NAMED)}, declared" if said else ""


def _most_run(known: Sequence[Profile]) -> str:
    """What all run that nothing is declared of. Where no distribution ships all, each with its own."""
    if not known or set(DEFAULT) <= {profile.name for profile in known}:
        return ""
    common = [each for each in known[0].distributions if all(each in profile.distributions for profile in known)]
    if not common:
        return ", ".join(map(_implementation, known))
    where = " or ".join(name.capitalize() for name in common)
    return f"{where} with {' and '.join(profile.title for profile in known)}"


def doing(name: str, *values: object) -> str:
    """`Fast DDS and OpenDDS`: who of all has one of these values of a peculiarity, the specification apart."""
    return _listed(_who(name, *values))


def told(name: str, values: Collection[object], sentence: str) -> str:
    """The sentence with who has one of these values for `{who}`, and its verbs, `[takes|take]`, accordingly."""
    who = _who(name, *values)
    return inflected(sentence, several=len(who) > 1).replace("{who}", _listed(who))


def doing_so(profiles: Iterable[Profile], sentence: str, common: Callable[[Profile], bool]) -> str:
    """The sentence with these profiles for `{who}`, a family where what is `common` to them is so of all releases."""
    who = sharing(profiles, common)
    return inflected(sentence, several=len(who) > 1).replace("{who}", _listed(who))


def _who(name: str, *values: object) -> list[str]:
    having = [each for each in VARIANTS.values() if each is not SPEC and value_of(each, name) in values]
    return sharing(having, lambda profile: value_of(profile, name) in values)


def contrasted(name: str) -> str:
    """`the specification: …; Fast DDS: …`: what each does of a peculiarity."""
    by_value: dict[str, list[Profile]] = {}
    for profile in VARIANTS.values():
        by_value.setdefault(value_name(value_of(profile, name)), []).append(profile)
    return "; ".join(
        f"{_listed(who)}: {inflected(answer(name, alike[0]), several=len(who) > 1)}"
        for alike in by_value.values()
        for who in (_sharing_value(name, alike),)
    )


def explained(cause: str, names: Iterable[str]) -> str:
    """What those of the implementations do that deviate from the specification in a peculiarity of the cause."""
    deviating = [VARIANTS[name] for name in VARIANTS if name in {*names}]
    return "; ".join(dict.fromkeys(_explanations(cause, deviating)))


def _explanations(cause: str, deviating: Sequence[Profile]) -> Iterator[str]:
    for name, quirk in QUIRKS.items():
        by_sentence: dict[str, list[Profile]] = {}
        for profile in deviating:
            value = value_of(profile, name)
            told = quirk.says.get(value_name(value), {}).get(cause, "")
            if not told and cause == quirk.cause and not quirk.says and value != value_of(SPEC, name):
                told = f"{{who}} {answer(name, profile)}"
            if told:
                by_sentence.setdefault(told, []).append(profile)
        for sentence, alike in by_sentence.items():
            who = _sharing_value(name, alike)
            yield inflected(sentence, several=len(who) > 1).replace("{who}", _listed(who))


def _sharing_value(name: str, alike: Sequence[Profile]) -> list[str]:
    return sharing(alike, lambda profile: value_of(profile, name) == value_of(alike[0], name))


def _listed(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))
