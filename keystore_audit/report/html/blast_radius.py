"""What follows from the loss of each enclave's key, the worst first."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from msgspec.structs import replace

from keystore_audit.grouped import grouped
from keystore_audit.model.blast_radius import Ranked, Ranking
from keystore_audit.report.html.element import NOTHING, Html, element, folded, items, joined, lines, name, some
from keystore_audit.report.html.sheet import FULL, Sheet

MAX_SEEN: Final = 12
"""Enclaves that are seen without a click."""

MAX_ROWS: Final = 200
"""Rows of one ranking; enclaves with the same numbers are one row."""

MAX_NAMED: Final = 200
"""Enclaves that are named for one row."""

MAX_RANKINGS: Final = 4
"""Rankings, where profiles differ."""

_BAR: Final = 120
_HEADS: Final = (
    ("reaches", "if all on the way are compromised"),
    ("alone", "if nobody else is"),
    ("passes for", "others with the same key"),
    ("writes", "topics, by right"),
    ("forges", "others, with its keys"),
    ("reads", "topics"),
)


def blast_radius(sheet: Sheet, rankings: Sequence[Ranking] | None) -> Html:
    """Return the rankings, that of the most profiles first."""
    if not rankings:
        words = "The enclaves were not ranked: they are too many, or of too many kinds. `keystore-audit flow "
        return element("p", f"{words}--from-compromised` answers for each.", class_="soft")
    intro = (
        "What somebody can do who holds the key of an enclave, the worst first: to how many enclaves its data can get, "
        "and on how many topics. What it reaches over topics that nearly every node uses is left out."
    )
    first = rankings[0]
    parts = [element("p", intro), _ranking(sheet, first, len(rankings) > 1)]
    for ranking in rankings[1:MAX_RANKINGS]:
        table = _ranking(sheet, ranking, said=False)
        parts.append(folded(joined(["Under ", name(", ".join(ranking.profiles))]), table, class_="space"))
    return joined(parts)


def _ranking(sheet: Sheet, ranking: Ranking, said: bool) -> Html:
    rows = _alike(ranking.enclaves)
    most = max((each.enclaves_reached for each in ranking.enclaves), default=0)
    seen = rows if len(rows) <= MAX_SEEN + 2 else rows[:MAX_SEEN]
    parts = [element("p", f"Under {', '.join(ranking.profiles)}:")] if said else []
    parts.append(_table(sheet, seen, most))
    rest = rows[len(seen) : MAX_ROWS]
    if rest:
        left_out = sum(map(len, rows[MAX_ROWS:]))
        more = element("p", f"{left_out} more. {FULL}", class_="soft") if left_out else NOTHING
        words = f"{sum(map(len, rows[len(seen) :]))} more"
        parts.append(folded(words, _table(sheet, rest, most), more, class_="more"))
    if any(each.endless for each in ranking.enclaves):
        words = "+: and all names of a class that has no end, counted as one."
        parts.append(element("p", words, class_="soft legend"))
    return joined(parts)


def _alike(enclaves: Sequence[Ranked]) -> list[list[Ranked]]:
    """Enclaves with the same numbers together, where there are many."""
    if len(enclaves) <= MAX_SEEN + 2:
        return [[each] for each in enclaves]
    return list(grouped(enclaves, lambda each: replace(each, path="")).values())


def _table(sheet: Sheet, rows: Sequence[Sequence[Ranked]], most: int) -> Html:
    heads = [element("th", text, element("span", note, class_="soft"), scope="col") for text, note in _HEADS]
    head = element("thead", element("tr", element("td"), joined(heads)))
    table = element("table", head, element("tbody", lines(_row(sheet, row, most) for row in rows)), class_="ranking")
    return element("div", table, class_="wide")


def _row(sheet: Sheet, alike: Sequence[Ranked], most: int) -> Html:
    each = alike[0]
    number = sheet.numbers.get(each.path)
    shown = name(each.path)
    drawn = sheet.report.overview is not None and number is not None
    head = element("a", shown, href=f"#{sheet.anchor('flow', number or 0)}") if drawn else shown
    others = some([other.path for other in alike[1:]], MAX_NAMED - 1)
    more = folded(f"and {len(alike) - 1} alike", items(others), class_="more") if others else NOTHING
    plus = "+" if each.endless else ""
    return element(
        "tr",
        element("th", head, more, scope="row"),
        element("td", _bar(each, most), f"{each.enclaves_reached}"),
        element("td", f"{each.enclaves_reached_alone}"),
        element("td", f"{each.passes_for}"),
        *(
            element("td", f"{count}{plus if count else ''}")
            for count in (each.topics_written, each.topics_forged, each.topics_read)
        ),
    )


def _bar(each: Ranked, most: int) -> Html:
    """As long as it reaches far, the dark part alone."""
    if not most:
        return element("span")
    whole, alone = _BAR * each.enclaves_reached / most, _BAR * each.enclaves_reached_alone / most
    bars = (
        element("rect", x=0, y=3, width=round(whole, 1), height=10, class_="reached"),
        element("rect", x=0, y=3, width=round(alone, 1), height=10, class_="alone"),
    )
    return element("svg", *bars, viewBox=f"0 0 {_BAR} 16", class_="length", aria_hidden="true")
