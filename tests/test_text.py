"""No name from a keystore steers what shows it: terminal, Markdown, HTML, spreadsheet, Alloy."""

from __future__ import annotations

import csv
import html as standard_html
import io
import os
import re
import sys
import unicodedata
from html.parser import HTMLParser
from urllib.parse import unquote_to_bytes

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from rich.console import Console
from rich.text import Text

from keystore_audit import text

HOSTILE = (
    "\x1b]0;title\x07",
    "\x9b31m",
    "/talker\r\nPASS",
    "\u202egnp.yek",
    "\u2066a\u2069",
    "a\u200bb\ufeff",
    "line\u2028break",
    "\ud800",
    "[red]x[/red] [link=file:///etc]y[/link]",
    "\\[bold]\\",
    "<script>alert(1)</script>",
    "' onmouseover='x",
    "![x](javascript:1) <b> `c` **d** | e",
    "    code",
    "1. item",
    "=cmd|' /C calc'!A0",
    "*/ pred Forged { } /*",
    "%00%2e%2e/",
)
# Characters as they come, and every kind of hostile one often, in any mixture.
names = st.text(
    st.one_of(
        st.characters(codec=None),
        st.sampled_from(sorted(set("".join(HOSTILE)))),
        st.sampled_from(sorted("\\`*_{}[]()<>#+-.!|~&:@=%$^'\"/")),
    )
) | st.sampled_from(HOSTILE)
line_names = names.map(str.strip).filter(bool)  # Markdown drops blanks at the ends of a paragraph


def test_every_control_format_and_separator_character_of_unicode_is_made_visible() -> None:
    """Asks Python's Unicode tables; text.py has its own, so that reports do not change with the Python version."""
    directions = {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI", "B", "S"}
    for code in range(sys.maxunicode + 1):
        character = chr(code)
        if (
            unicodedata.category(character) in {"Cc", "Cf", "Cs", "Zl", "Zp"}
            or unicodedata.bidirectional(character) in directions
            or (character.isspace() and character != " ")
        ):
            escaped = text.terminal(character)
            assert escaped != character, f"U+{code:04X}"
            assert escaped.isascii()
            assert escaped.isprintable()
            assert escaped.lstrip("\\xuU").rjust(8, "0") == f"{code:08x}"


@pytest.mark.parametrize(
    "code", [0x034F, 0x115F, 0x1160, 0x17B4, 0x180B, 0x2800, 0x3164, 0xFE0F, 0xFFA0, 0xFFFE, 0xE0100]
)
def test_characters_that_nobody_can_see_are_made_visible(code: int) -> None:
    assert text.terminal(f"a{chr(code)}b") == f"a\\{'U' if code > 0xFFFF else 'u'}{code:0{8 if code > 0xFFFF else 4}x}b"


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("::notice title=x::PASS", "\\x3a:notice title=x\\x3a:PASS"),
        (":::é", "\\x3a\\x3a:é"),
        ("##vso[task]", "\\x23#vso[task]"),
        ("a:b #c", "a:b #c"),
    ],
)
def test_nothing_is_a_command_to_the_runner_of_a_pipeline(name: str, shown: str) -> None:
    assert text.terminal(name) == shown


@pytest.mark.parametrize(
    "name", ["/talker", "rt/chatter", "CN=Größe, O=Öl & Co", "日本語", "שלום", "C:\\keys", "a b", ""]
)
def test_readable_names_stay_as_they_are(name: str) -> None:
    assert text.terminal(name) == name


@given(names)
def test_terminal_is_one_encodable_line_and_escaping_twice_changes_nothing(name: str) -> None:
    escaped = text.terminal(name)
    assert len(escaped.splitlines()) <= 1
    assert not any(unicodedata.category(character) in {"Cc", "Cf", "Cs", "Zl", "Zp"} for character in escaped)
    escaped.encode("utf-8")
    assert text.terminal(escaped) == escaped


@given(names)
def test_rich_prints_the_name_obeys_no_markup_in_it_and_adds_no_control_sequence(name: str) -> None:
    stream = io.StringIO()
    console = Console(file=stream, force_terminal=True, color_system=None, width=10**6)
    console.print(Text(text.terminal(name)))
    assert stream.getvalue() == f"{text.terminal(name)}\n"


@given(names)
def test_markdown_renders_inline_as_the_name(name: str) -> None:
    rendered = MarkdownIt("commonmark").enable(["table", "strikethrough"]).renderInline(text.markdown(name))
    assert standard_html.unescape(rendered) == text.terminal(name)
    assert not re.search(r"<(?!/?$)", rendered), "an element"


@given(line_names)
def test_markdown_begins_no_block(name: str) -> None:
    shown = standard_html.escape(text.terminal(name), quote=False).replace('"', "&quot;")
    rendered = MarkdownIt("commonmark").enable(["table", "strikethrough"]).render(text.markdown(name))
    assert rendered == f"<p>{shown}</p>\n"


@given(names)
def test_markdown_stays_in_its_table_cell(name: str) -> None:
    source = f"| a | b |\n|---|---|\n| {text.markdown(name)} | end |\n"
    rendered = MarkdownIt("commonmark").enable("table").render(source)
    cells = re.findall(r"<td>(.*?)</td>", rendered, re.DOTALL)
    assert [standard_html.unescape(cell).strip() for cell in cells] == [text.terminal(name).strip(), "end"]


class _Page(HTMLParser):
    """What a browser would see: elements with attributes, and the text."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, list[tuple[str, str | None]]]] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, attrs))

    def handle_data(self, data: str) -> None:
        self.text += data


@given(names)
def test_html_is_text_in_elements_and_in_quoted_attributes(name: str) -> None:
    page = _Page()
    escaped = text.html(name)
    page.feed(f"<p title=\"{escaped}\" lang='{escaped}'>{escaped}</p>")
    page.close()
    shown = text.terminal(name)
    assert page.elements == [("p", [("title", shown), ("lang", shown)])]
    assert page.text == shown


@given(names)
def test_a_csv_cell_is_one_field_and_no_formula(name: str) -> None:
    stream = io.StringIO()
    csv.writer(stream).writerow([text.csv_cell(name), "end"])
    (row,) = csv.reader(io.StringIO(stream.getvalue(), newline=""))
    assert row[1:] == ["end"]
    assert row[0].removeprefix("'") == text.terminal(name).removeprefix("'")
    assert not row[0].lstrip().startswith(("=", "+", "-", "@", "\t", "\r", "\uff1d", "\uff0b", "\uff0d", "\uff20"))
    assert text.csv_cell(row[0]) == row[0]


@given(names)
@example("*/*")
@example("/*/")
@example("*" * 300 + "/")
@example("é" * 100)
def test_an_alloy_comment_is_bounded_printable_ascii_that_ends_no_comment(name: str) -> None:
    escaped = text.alloy_comment(name)
    assert escaped.isascii()
    assert escaped.isprintable()
    assert len(escaped) <= text.MAX_COMMENT_LENGTH
    assert "*/" not in escaped
    assert "/*" not in escaped


@given(st.binary() | st.text(st.sampled_from("a/%ü\x1b\u202e")).map(str.encode))
@example(b"a%25\xff\xc3\xa9/b")
def test_a_percent_path_gives_the_bytes_back_and_is_safe_on_a_terminal(path: bytes) -> None:
    shown = text.percent_path(path)
    assert unquote_to_bytes(shown) == path
    assert text.terminal(shown) == shown
    if b"\0" not in path:
        assert text.percent_path(os.fsdecode(path)) == shown


@given(names, st.integers(2, 40))
def test_shortened_names_fit_and_keep_both_ends(name: str, limit: int) -> None:
    short = text.shorten(name, limit)
    assert len(short) <= limit
    assert text.shorten(short, limit) == short
    if len(name) <= limit:
        assert short == name
    else:
        head, _, tail = short.partition("…") if "…" not in name else (name[:1], "", "")
        assert name.startswith(head)
        assert name.endswith(tail)
        assert len(short) == limit
