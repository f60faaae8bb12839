"""Elements of a page, escaped by construction: the only module that writes markup.

Every text passes through `text.html`, so hidden and direction-changing characters are visible and nothing that a
keystore's author wrote becomes markup. Attributes hold no text of a keystore at all: only words, numbers and places on
the page. There is no way to write a script, an event handler, a style attribute or a link that leaves the page.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from typing import Final

from msgspec import Struct

from keystore_audit.text import html, shorten, terminal

MAX_NAME: Final = 200
"""Characters of one name; a longer one is cut in the middle. JSON has it in full."""

MAX_WHOLE: Final = 20
"""Characters up to which a name is left in one piece."""

_VOID: Final = frozenset({"br", "hr", "link", "meta", "col", "wbr"})
_TAGS: Final = frozenset(
    re.split(
        r"\s+",
        """a article aside b body br caption circle code col colgroup dd defs details div dl dt em figcaption figure
    footer g h1 h2 h3 h4 head header hr html i li line link main marker meta nav ol p path pattern polygon rect section
    small span strong summary svg table tbody td text tfoot th thead title tr tspan ul wbr""",
    )
)
_ATTRIBUTES: Final = frozenset(
    re.split(
        r"\s+",
        """aria-hidden aria-label aria-labelledby charset class colspan content cx cy d dx dy fill height href
    http-equiv id lang marker-end markerheight markerwidth name open orient patternunits points r refx refy rel role
    rowspan rx scope stroke tabindex text-anchor transform viewbox width x x1 x2 y y1 y2""",
    )
)
_CASED: Final = {
    name.lower(): name for name in ("viewBox", "markerWidth", "markerHeight", "refX", "refY", "patternUnits")
}
"""Attributes of SVG that are not all in small letters."""

_VALUE: Final = re.compile(r"[A-Za-z0-9 _.,:;#()/+='-]*")
_PLACE: Final = re.compile(r"#[A-Za-z0-9_-]+|data:,")


class Html(Struct, frozen=True):
    """Markup that `element` has made."""

    markup: str


NOTHING: Final = Html("")
BREAK: Final = Html("\n")
"""The end of a line of the file; nothing on the page."""

Child = Html | str

_MAY_BREAK: Final = Html("<wbr>")


def element(tag: str, *children: Child, **attributes: str | int | float) -> Html:
    """Return an element; a `str` among the children is text, whatever is in it.

    `class_`, `http_equiv`: the attributes `class`, `http-equiv`. Raises ValueError for an element or an attribute that
    no page needs, and for an attribute's value that could be somebody's text.
    """
    if tag not in _TAGS:
        raise ValueError(f"no page needs the element {tag!r}")
    opening = tag + "".join([_attribute(name, value) for name, value in attributes.items()])
    if tag in _VOID:
        return Html(f"<{opening}>")
    return Html(f"<{opening}>{_inside(children)}</{tag}>")


def joined(children: Iterable[Child]) -> Html:
    """Return the children one after the other."""
    return Html(_inside(children))


def lines(children: Iterable[Child]) -> Html:
    """Return the children on lines of their own, so that the file can be read and compared."""
    return Html("\n".join(_inside((child,)) for child in children))


def _inside(children: Iterable[Child]) -> str:
    return "".join([child.markup if isinstance(child, Html) else html(child) for child in children])


@lru_cache(maxsize=4096)  # tables repeat theirs in every cell
def _attribute(name: str, value: str | int | float) -> str:
    name = name.rstrip("_").replace("_", "-").lower()
    text = f"{value:g}" if isinstance(value, float) else str(value)
    if name not in _ATTRIBUTES:
        raise ValueError(f"no page needs the attribute {name!r}")
    if _VALUE.fullmatch(text) is None or (name == "href" and _PLACE.fullmatch(text) is None):
        raise ValueError(f"{text!r} is no value for the attribute {name!r}")
    return f' {_CASED.get(name, name)}="{html(text)}"'


def style(sheet: str) -> Html:
    """Return our own style sheet, which stands as it is. Raises ValueError if it could end early."""
    if "</" in sheet or "<!--" in sheet:
        raise ValueError("a style sheet holds no markup")
    return Html(f"<style>{sheet}</style>")


def name(text: str) -> Html:
    """Return a name as it stands in the keystore."""
    return element("code", *_broken(shorten(text, MAX_NAME)))


def some(names: Sequence[str], most: int) -> list[Html]:
    """Return the first of the names, and behind them how many more there are."""
    left = len(names) - most
    return [*map(name, names[:most]), *([element("span", f"and {left} more")] if left > 0 else [])]


def place(path: str, line: int | None) -> Html:
    """Return a place in a file."""
    return element("code", *_broken(shorten(path, MAX_NAME) + ("" if line is None else f":{line}")), class_="place")


def _broken(text: str) -> Iterator[Child]:
    """The text, which is best broken behind a slash where it is long."""
    if len(text) <= MAX_WHOLE:
        yield text
        return
    for part in text.split("/")[:-1]:
        yield f"{part}/"
        yield _MAY_BREAK
    yield text.rpartition("/")[2]


def digest(value: str) -> Html:
    """Return a hash, which is best broken in the middle."""
    half = len(value) // 2
    return element("code", value[:half], element("wbr"), value[half:], class_="place")


def fitted(text: str, fit: int) -> str:
    """Return the text as it is shown in `fit` columns of a picture; beyond ASCII a character may take two."""
    shown = terminal(text)
    return shorten(shown, fit if shown.isascii() else max(fit // 2, 2))


def folded(summary: Child, *children: Child, open_: bool = False, class_: str = "") -> Html:
    """Return what is shown when its summary is clicked, or printed."""
    attributes: dict[str, str] = {"class_": class_} if class_ else {}
    if open_:
        attributes["open"] = ""
    return element("details", element("summary", summary), *children, **attributes)


def items(children: Iterable[Child], class_: str = "") -> Html:
    """Return a list; nothing where there is nothing in it."""
    listed = [element("li", child) for child in children]
    if not listed:
        return NOTHING
    return element("ul", lines(listed), class_=class_) if class_ else element("ul", lines(listed))
