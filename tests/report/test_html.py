"""The HTML report: markup that no name can change, what it says, how large it grows, its colours."""

from __future__ import annotations

import re
from base64 import b64encode
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

import lxml.html
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jinja2 import UndefinedError
from lxml import etree

from keystore_audit import text as escaping
from keystore_audit.report import html, templated
from keystore_audit.report.content import Report, Verdict
from keystore_audit.report.html import render
from tests.cli.keystores import AT, answer
from tests.report.attacks import PAYLOADS, attacks
from tests.report.robots import page_of, page_of_robots

MakeReport = Callable[..., Report]

HOSTILE = st.text(st.characters(), max_size=30) | st.sampled_from(PAYLOADS)
MARKUP = re.compile(r"<(/?)([a-zA-Z][a-zA-Z0-9]*)((?:\s+[A-Za-z0-9-]+=\"[^\"<>]*\")*)\s*>")


def document(page: str) -> etree._Element:
    """The page without the places where a long name may be broken."""
    return lxml.html.document_fromstring(page.replace("<wbr>", ""))


def words(tree: etree._Element) -> str:
    """Text as it is read: each element's words by themselves."""
    return " ".join(word for text in tree.itertext() for word in text.split())


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return attacks(tmp_path_factory.mktemp("hostile"))


ELEMENTS = re.split(
    r"\s+",
    """a article b
    body code dd details div dl dt figcaption figure footer h1 h2 h3 head header html li line link main meta
    nav ol p path polygon rect section span strong style summary svg table tbody td text th thead title tr ul wbr""",
)
ATTRIBUTES = re.split(
    r"\s+",
    """aria-hidden aria-label charset class colspan content d height href http-equiv id lang name open points rel role
    rx scope tabindex text-anchor viewBox width x x1 x2 y y1 y2""",
)
TEMPLATES = {each.name: each.read_text("utf-8") for each in templated.TEMPLATES.glob("*.html.j2")}


class TestTemplates:
    """What is written in them: only the elements and attributes that a page needs, and no way around the escaping."""

    def test_there_is_no_element_and_no_attribute_that_runs_or_fetches(self) -> None:
        for name, source in TEMPLATES.items():
            written = re.sub(r"\{%.*?%\}|\{\{.*?\}\}", "~", source, flags=re.DOTALL)
            for tag, rest in re.findall(r"</?([A-Za-z0-9]+)((?:\s*~|[^<>])*)>", written):
                assert tag in ELEMENTS, name
                assert set(re.findall(r'([A-Za-z0-9-]+)="', rest)) <= {*ATTRIBUTES}, (name, tag)

    def test_links_stay_on_the_page(self) -> None:
        targets = [each for source in TEMPLATES.values() for each in re.findall('href="([^"{]*)', source)]
        assert {each[:1] for each in targets if each != "data:,"} == {"#"}

    def test_nothing_goes_around_the_escaping(self) -> None:
        """In no template of any format; what Markdown takes for ours is names of distributions and of a status."""
        own = {}
        for path in templated.TEMPLATES.glob("*.j2"):
            source = path.read_text("utf-8")
            assert not re.search(r"\|\s*(safe|forceescape|escape|e|xmlattr|tojson|urlize)\b|autoescape|\braw\b", source)
            own[path.name] = re.findall(r"([\w.]+)\s*\|\s*ours\b", source)
            assert len(own[path.name]) == len(re.findall(r"\bours\b", source))
        assert {name: found for name, found in own.items() if found} == {
            "markdown.md.j2": ["report.scope", "run.status.value"]
        }

    def test_the_style_sheet_cannot_end_early(self) -> None:
        sheet = (templated.TEMPLATES / "style.css").read_text("utf-8")
        assert "</" not in sheet
        assert "<!--" not in sheet

    def test_what_is_not_there_is_an_error(self) -> None:
        with pytest.raises(UndefinedError):
            html._environment().from_string("{{ nobody }}").render()

    @given(HOSTILE)
    def test_what_is_shown_is_the_text_as_a_terminal_shows_it(self, text: str) -> None:
        made = html._environment().from_string("<p>{{ text }}</p>").render(text=text)
        tree = lxml.html.fragment_fromstring(made)
        assert (tree.tag, len(tree), tree.text or "") == ("p", 0, escaping.terminal(text))

    @given(HOSTILE)
    def test_a_name_is_broken_behind_slashes_alone(self, text: str) -> None:
        made = html._environment().from_string("<p>{{ text|breakable }}</p>").render(text=text)
        tree = lxml.html.fragment_fromstring(made)
        assert "".join(tree.itertext()) == escaping.terminal(text)
        assert {each.tag for each in tree} <= {"wbr"}


class TestHostileNames:
    @given(name=HOSTILE)
    def test_every_tag_is_one_that_the_page_is_made_of(self, name: str, make_report: MakeReport) -> None:
        """By a pattern, not by a parser that repairs: what is not a tag of ours holds no angle bracket at all."""
        page = render([make_report(name)])
        body = page[page.index("</style>") :].removeprefix("</style>")
        assert not set(MARKUP.sub("", body)) & set("<>")
        plain = render([make_report("talker")])
        tags = {(tag, *re.findall(r"([A-Za-z-]+)=", rest)) for _end, tag, rest in MARKUP.findall(page)}
        assert tags <= {(tag, *re.findall(r"([A-Za-z-]+)=", rest)) for _end, tag, rest in MARKUP.findall(plain)}

    @given(name=HOSTILE)
    def test_no_attribute_depends_on_a_name(self, name: str, make_report: MakeReport) -> None:
        def attributes(page: str) -> set[str]:
            return {rest for _end, _tag, rest in MARKUP.findall(page)}

        assert attributes(render([make_report(name)])) == attributes(render([make_report("talker")]))

    def test_a_whole_keystore_of_them(self, hostile: Path) -> None:
        page = page_of(hostile)
        tree = document(page)
        assert not set(MARKUP.sub("", page[page.index("</style>") + len("</style>") :])) & set("<>")
        assert not tree.xpath("//script|//iframe|//img|//object|//embed|//form|//base|//*[@style]|//*[@src]")
        assert {key for node in tree.iter(etree.Element) for key in node.attrib if key.startswith("on")} == set()
        assert all(link.startswith("#") for link in tree.xpath("//a/@href"))
        shown = words(tree)
        for payload in ("<script>document.title='executed'</script>", "</style><style>*{display:none}</style>"):
            assert shown.count(payload) > 3, payload  # in findings, the matrix, the flow, the certificates

    def test_the_policy_allows_the_one_style_sheet_and_nothing_else(self, hostile: Path) -> None:
        page = page_of(hostile)
        policy = str(document(page).xpath("//meta[@http-equiv='Content-Security-Policy']/@content")[0])
        sheet = page[page.index("<style>") + len("<style>") : page.index("</style>")]
        digest = b64encode(sha256(sheet.encode()).digest()).decode()
        assert policy.split("; ") == [
            "default-src 'none'",
            "script-src 'none'",
            f"style-src 'sha256-{digest}'",
            "img-src data:",
            "base-uri 'none'",
            "form-action 'none'",
        ]
        assert "url(" not in sheet
        assert "@import" not in sheet


class TestWhatIsSaid:
    def test_several_keystores_are_one_page_whose_ids_are_unique(self, make_report: MakeReport) -> None:
        tree = document(render([make_report("one"), make_report("two", verdict=Verdict.PASS)]))
        ids = tree.xpath("//@id")
        assert len(ids) == len(set(ids))
        assert {link[1:] for link in tree.xpath("//a/@href")} <= set(ids)
        assert "2 keystores: 1 pass, 1 fail, 0 incomplete" in words(tree)

    def test_one_has_an_overview_only_if_it_is_drawn(self, repository: Path, tmp_path: Path) -> None:
        root = repository / "sample_keystores/healthy/talker_listener"
        wanted = tmp_path / "report.html"
        _code, said = answer("audit", root, "--engine", "native", "--at", AT, "-f", "json", "-o", f"html={wanted}")
        assert "overview" not in said
        assert wanted.read_text("utf-8") == page_of(root)


class TestMeeting:
    def test_lines_of_the_page_accept_its_causes(self, repository: Path, tmp_path: Path) -> None:
        root = repository / "sample_keystores/flows/vehicle_governance_flag"
        lines = document(page_of(root)).xpath("//details[@class='accepting']//code/text()")
        filled = {
            'reason = ""': 'reason = "known"',
            'owner = ""': 'owner = "Ada"',
            "until = YYYY-MM-DD  # a date, without quotes": "until = 2026-12-04",
        }
        settings = tmp_path / "it.toml"
        settings.write_text("\n".join(filled.get(line, line) for line in lines), "utf-8")
        assert answer("audit", root, "--engine", "native", "--at", AT)[0] == 1
        code, said = answer("audit", root, "--engine", "native", "--at", AT, "--settings", settings)
        assert (code, "KA909" in said, "KA910" in said) == (0, False, False)


class TestSize:
    @pytest.mark.slow
    @pytest.mark.xdist_group("page-of-robots")
    def test_300_enclaves_are_one_page_still(self) -> None:
        page = page_of_robots(300)
        assert len(page.encode()) < 1_600_000
        assert len(MARKUP.findall(page)) / 2 < 32_000
        shown = words(document(page).xpath("//section[@class='access']")[0])
        assert "/robot_01/ 5 enclaves, and 58 namespaces alike" in shown
        assert "/robot_59/" in shown
        ranked = document(page).xpath("//section[@class='radius']//tbody/tr/th//code")
        assert len({"".join(each.itertext()) for each in ranked}) == 300
