"""What a stolen key opens in a network of sessions and routers: for people, and as JSON."""

from __future__ import annotations

from typing import Final

from keystore_audit.report.json import encoded, picked
from keystore_audit.report.page import by_answer, profiles, wrapped
from keystore_audit.report.routed_answer import APART, ASSUMED, doubted, unknown
from keystore_audit.text import instant, terminal
from keystore_audit.zenoh.stolen import HEARS, REACHES, StolenAnswer

_WORDS: Final = {
    "publish": "publishes",
    "subscribe": "reads",
    "request": "calls",
    "reply": "serves",
    HEARS: "hears of others:",
    REACHES: "reaches others:",
}


def json(answer: StolenAnswer) -> str:
    """One line."""
    document = {
        "from_compromised": answer.who,
        **picked(answer, "folder", "include_ambient", "beyond_itself"),
        "at": instant(answer.at),
        "profiles": {
            name: [
                {
                    **picked(each, "does", "name", "certain", "way"),
                    "places": [picked(place, "path", "line") for place in each.places],
                }
                for each in opened
            ]
            for name, opened in answer.opened.items()
        },
        "unknown": unknown(answer.doubts),
    }
    return encoded(document) + "\n"


def text(answer: StolenAnswer) -> str:
    """For people: releases that answer alike together, each thing with the lines that let it in."""
    lines = [wrapped(f"Whoever holds the private key of the enclave {answer.who} and starts without its file:")]
    lines.append(wrapped(ASSUMED.format(answer.folder), "  ", "  "))
    for every, names in by_answer(answer.opened).items():
        lines += ["", wrapped(f"under {profiles(names, answer.opened)}", "  ", "    ")]
        for each in every:
            words = f"{'' if each.certain else 'PERHAPS '}{_WORDS[each.does]} {each.way or each.name}"
            lines.append(wrapped(words, "    ", "      "))
            lines += (terminal(f"        {place}") for place in each.places)
        lines += [] if every else ["    can do nothing with it"]
    lines += [] if answer.include_ambient else ["", wrapped(APART)]
    return "\n".join([*lines, *doubted(answer.doubts)]) + "\n"
