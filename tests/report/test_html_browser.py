"""The HTML report as a browser that we did not write shows it: nothing runs or is fetched, everything is legible."""

from __future__ import annotations

import json
import re
import struct
import subprocess
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lxml.html
import pytest

from tests.report import browser
from tests.report.attacks import attacks
from tests.report.robots import page_of, page_of_robots

pytestmark = pytest.mark.slow

Oracle = Callable[[str], str]

WITHOUT_POLICY = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')
LEGIBLE = 4.5
"""WCAG 2.1, 1.4.3: the least contrast of text that is neither large nor bold."""

MEASURE = """<script>
function channel(v) { v /= 255; return v <= 0.03928 ? v / 12.92 : Math.pow((v + 0.055) / 1.055, 2.4); }
function light(c) { return 0.2126 * channel(c[0]) + 0.7152 * channel(c[1]) + 0.0722 * channel(c[2]); }
function parsed(text) { return (text.match(/[0-9.]+/g) || []).map(Number); }
function ratio(one, other) {
  const a = light(one), b = light(other); return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
}
function grounds(node) {
  const found = [];
  for (let at = node; at; at = at.parentElement) {
    const style = getComputedStyle(at), color = parsed(style.backgroundColor);
    if (style.backgroundImage !== 'none')
      for (const each of style.backgroundImage.match(/rgba?\\([^)]*\\)/g) || []) found.push(parsed(each));
    if (color.length === 3 || color[3] > 0) { found.push(color); return found; }
  }
  return found;
}
function measure() {
  for (const each of document.querySelectorAll('details')) each.open = true;
  const styles = document.createElement('style');
  styles.textContent = '.tip { display: block !important }';
  document.head.append(styles);
  const found = {};
  for (const node of document.querySelectorAll('body *')) {
    const own = [...node.childNodes].some(child => child.nodeType === 3 && child.data.trim());
    if (!own || node.closest('title')) continue;
    const style = getComputedStyle(node), svg = node.namespaceURI.endsWith('svg');
    const color = parsed(svg ? style.fill : style.color);
    let behind = grounds(node);
    if (svg) for (const rect of node.ownerSVGElement.querySelectorAll('rect.box, rect.centre')) {
      const fill = parsed(getComputedStyle(rect).fill);
      if (node.ownerSVGElement.classList.contains('flowing') && fill.length > 2) behind.push(fill);
    }
    const least = Math.min(...behind.map(ground => ratio(color, ground)));
    const key = node.tagName.toLowerCase() + '.' + (node.getAttribute('class') || '');
    found[key] = Math.min(found[key] || 99, least);
  }
  document.title = JSON.stringify(found);
}
addEventListener('load', measure);
</script></head>"""
"""Says in the title, for each kind of element with text, the least contrast to whatever lies behind it."""


BEGIN = """<script>
addEventListener('load', () => { document.title = document.getElementById('findings').getBoundingClientRect().top; });
</script></head>"""
"""Says in the title how far down findings begin, in pixels."""


@pytest.fixture(scope="module", autouse=True)
def chromium(oracle: Oracle) -> None:
    oracle("chromium")
    oracle("pdftotext")


def title(loaded: browser.Loaded) -> str:
    return str(lxml.html.document_fromstring(loaded.dom).findtext(".//title"))


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> str:
    return page_of(attacks(tmp_path_factory.mktemp("hostile")))


@pytest.fixture(scope="module")
def leaky(repository: Path) -> str:
    samples = repository / "sample_keystores"
    return page_of(samples / "flows/vehicle_governance_flag", "--settings", str(samples / "settings/vehicle.toml"))


class TestTheBrowserWouldSay:
    """That each of the tests below can fail."""

    def test_a_script_that_runs_changes_the_title(self, tmp_path: Path) -> None:
        loaded = browser.load("<!DOCTYPE html><title>as made</title><svg onload=document.title='executed'>", tmp_path)
        assert title(loaded) == "executed"

    def test_what_the_policy_stops_is_said_on_the_console(self, leaky: str, tmp_path: Path) -> None:
        loaded = browser.load(leaky.replace("</head>", "<script>document.title='executed'</script></head>"), tmp_path)
        assert title(loaded).startswith("FAIL: ")
        assert any("Content Security Policy" in line for line in loaded.console)

    def test_every_request_is_seen(self, tmp_path: Path) -> None:
        page = "<!DOCTYPE html><title>x</title><img src=here.png><img src=http://example.invalid/there.png>"
        loaded = browser.load(page, tmp_path)
        assert "/here.png" in loaded.asked
        assert loaded.elsewhere == ("http://example.invalid/there.png",)


class TestSafety:
    @pytest.mark.parametrize("policy", [True, False], ids=["as it is", "without its policy"])
    def test_names_never_run_and_nothing_is_asked_for(self, policy: bool, hostile: str, tmp_path: Path) -> None:
        """Without its policy too: the markup alone is safe."""
        page = hostile if policy else WITHOUT_POLICY.sub("", hostile)
        loaded = browser.load(page, tmp_path)
        assert title(loaded) == lxml.html.document_fromstring(hostile).findtext(".//title")
        assert loaded.console == ()
        assert loaded.asked == ("/page.html",)
        assert loaded.elsewhere == ()
        tree = lxml.html.document_fromstring(loaded.dom)
        assert not tree.xpath("//script|//iframe|//img|//object|//base|//*[@onload or @onerror or @onfocus]")
        assert len(tree.xpath("//style")) == 1

    def test_the_browser_builds_the_tree_that_was_written(self, hostile: str, tmp_path: Path) -> None:
        """A parser of HTML5 repairs what is not well formed; here there is nothing to repair."""
        written = lxml.html.document_fromstring(hostile)
        shown = lxml.html.document_fromstring(browser.load(hostile, tmp_path).dom)
        assert [node.tag for node in shown.iter("*")] == [node.tag for node in written.iter("*")]

    def test_a_page_of_samples(self, leaky: str, tmp_path: Path) -> None:
        loaded = browser.load(leaky, tmp_path)
        assert loaded.console == ()
        assert loaded.asked == ("/page.html",)
        assert loaded.elsewhere == ()


class TestLegibility:
    @pytest.mark.parametrize("scheme", [(), (browser.DARK,)], ids=["light", "dark"])
    def test_every_text_stands_out(self, scheme: tuple[str, ...], leaky: str, repository: Path, tmp_path: Path) -> None:
        for number, page in enumerate((leaky, page_of(repository / "sample_keystores/stock/sample_policy"))):
            measured = WITHOUT_POLICY.sub("", page).replace("</head>", MEASURE)
            (tmp_path / str(number)).mkdir()
            contrasts: dict[str, Any] = json.loads(title(browser.load(measured, tmp_path / str(number), *scheme)))
            assert len(contrasts) > 40
            assert {kind: ratio for kind, ratio in contrasts.items() if ratio < LEGIBLE} == {}

    @pytest.mark.parametrize(
        ("sample", "options"),
        [
            ("flows/vehicle_bridged_domain", ("--settings", "settings/vehicle.toml")),
            ("flows/turtlesim_random_moves_turtle", ("--settings", "settings/turtlesim.toml")),
            ("zenoh/turtlesim_generated", ("--zenoh", "networks/turtlesim_generated")),
            ("stock/turtlesim", ()),
        ],
    )
    def test_findings_begin_on_the_first_screen(
        self, sample: str, options: tuple[str, ...], repository: Path, tmp_path: Path
    ) -> None:
        samples = repository / "sample_keystores"
        words = (str(samples / each) if (samples / each).exists() else each for each in options)
        page = WITHOUT_POLICY.sub("", page_of(samples / sample, *words)).replace("</head>", BEGIN)
        assert 300 < float(title(browser.load(page, tmp_path, "--window-size=1280,800"))) < 700

    def test_dark_is_dark(self, leaky: str, tmp_path: Path) -> None:
        pictures = {}
        for name, options in (("light", ()), ("dark", (browser.DARK,))):
            browser.screenshot(leaky, tmp_path / f"{name}.png", tmp_path, *options, size=(600, 400))
            pictures[name] = corner(tmp_path / f"{name}.png")
        assert sum(pictures["light"]) > 600
        assert sum(pictures["dark"]) < 120

    def test_what_is_folded_is_printed(self, leaky: str, oracle: Oracle, tmp_path: Path) -> None:
        browser.printed(leaky, tmp_path / "report.pdf", tmp_path)
        command = [oracle("pdftotext"), str(tmp_path / "report.pdf"), "-"]
        text = "".join(subprocess.run(command, check=True, capture_output=True, text=True).stdout.split())
        closed = lxml.html.document_fromstring(leaky).xpath("//details[not(@open)]")
        assert len(closed) > 3
        for each in closed:
            longest = max(each.xpath("./*[2]//text()"), key=len)
            assert "".join(longest.split())[:40] in text


@pytest.mark.xdist_group("page-of-robots")
@pytest.mark.parametrize("enclaves", [4, 50, 300])
def test_a_fleet_is_shown(enclaves: int, tmp_path: Path) -> None:
    loaded = browser.load(page_of_robots(enclaves), tmp_path)
    assert (loaded.console, loaded.asked) == ((), ("/page.html",))
    tree = lxml.html.document_fromstring(loaded.dom)
    assert len(tree.xpath("//section")) == 11
    assert len(tree.xpath("//details[@class='flow']")) == enclaves


def corner(picture: Path) -> tuple[int, ...]:
    """The first pixel of a PNG of 8 bits a channel (PNG, 9: the first pixel of a filtered first line is itself)."""
    content = picture.read_bytes()
    at, data = 8, b""
    while at < len(content):
        (length,), kind = struct.unpack(">I", content[at : at + 4]), content[at + 4 : at + 8]
        data += content[at + 8 : at + 8 + length] if kind == b"IDAT" else b""
        at += length + 12
    return tuple(zlib.decompress(data)[1:4])
