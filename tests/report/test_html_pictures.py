"""Pictures of whatever a keystore may hold: every date, every length of a name, more than fits."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime, timezone
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import lxml.html
import pytest
from hypothesis import given
from hypothesis import strategies as st

from keystore_audit.model.formal.rights import Safeguard
from keystore_audit.model.tables.access_table import AccessTable, Group, Named
from keystore_audit.model.tables.overview import Dated, Neighbourhood, Overview, PeerGroup, Period
from keystore_audit.report import html, html_tables, pictures, system_picture
from keystore_audit.report.view_model import Consequences
from tests.cli.keystores import AT, answer, keystore, rule
from tests.report.robots import page_of

INSTANTS = st.datetimes(datetime(1, 1, 1), datetime(9999, 12, 31), timezones=st.just(timezone.utc))
NAMES = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=80)
PERIODS = st.builds(
    lambda kind, dates, endless, names: Period(
        kind=kind, start=min(dates), end=None if endless else max(dates), names=tuple(sorted(names))
    ),
    st.sampled_from(Dated),
    st.tuples(INSTANTS, INSTANTS),
    st.booleans(),
    st.frozensets(NAMES, min_size=1, max_size=3),
)


def drawn_dates(periods: Sequence[Period], at: datetime, until: datetime | None) -> str:
    return section("dates", pictures.timeline(periods, at, until))


def drawn_flow(table: AccessTable, flow: Neighbourhood) -> str:
    view = {
        "domain": 0,
        "unread": "",
        "profiles": (),
        "ambient": "",
        "spaces": [("", [pictures.picture(table, flow)])],
        "left_out": 0,
    }
    return f"<div>{section('flows', view)}</div>"


def section(key: str, view: object) -> str:
    sheet = SimpleNamespace(numbers={}, anchor=None, under="".join)
    return html._environment().get_template(f"{key}.html.j2").render(view=view, sheet=sheet, report=None)


class TestTimeline:
    @given(periods=st.lists(PERIODS, min_size=1, max_size=50), at=INSTANTS, until=INSTANTS | st.none())
    def test_every_date_has_a_place(self, periods: list[Period], at: datetime, until: datetime | None) -> None:
        drawn = drawn_dates(periods, at, until)
        tree = lxml.html.fragment_fromstring(drawn, create_parent=True)
        bars = tree.xpath("//svg//rect")
        assert len(bars) == min(len(periods), pictures.MAX_ROWS)
        for bar in bars:
            x, width = float(bar.get("x")), float(bar.get("width"))
            assert x >= pictures.LEFT
            assert width >= 2
            assert x + width <= pictures.WIDTH - pictures.RIGHT + 2
        for line in tree.xpath("//svg//line"):
            assert pictures.LEFT <= float(line.get("x1")) <= pictures.WIDTH - pictures.RIGHT
        ticks = [float(each.get("x")) for each in tree.xpath("//svg//text[@class='tick']")]
        assert ticks == sorted(ticks)
        assert all(later - earlier > 28 for earlier, later in pairwise(ticks))  # a year's width
        flagged = tree.xpath("//svg//line[@class='until']")
        assert len(flagged) == (1 if until is not None and until > at else 0)


def table(names: list[str]) -> AccessTable:
    named = tuple(Named(topic=each, partition="", ros=False, several=False, expressions=()) for each in names)
    group = Group(profiles=("spec",), enclaves={}, safeguards=((Safeguard(governed=True),),) * len(named))
    at = datetime(2026, 1, 1, tzinfo=timezone.utc)
    return AccessTable(root=".", at=at, domain=0, names=named, rest=0, groups=(group,), fleets=())


HOPS = st.lists(
    st.builds(
        PeerGroup,
        peers=st.lists(NAMES | st.none(), min_size=1, max_size=30).map(tuple),
        names=st.sets(st.integers(0, 5), min_size=1).map(lambda found: tuple(sorted(found))),
        by_right=st.booleans(),
    ),
    max_size=14,
)


class TestFlow:
    @given(incoming=HOPS, outgoing=HOPS, path=NAMES, names=st.lists(NAMES, min_size=6, max_size=6))
    def test_nothing_leaves_its_box_and_nothing_is_dropped_in_silence(
        self, incoming: list[PeerGroup], outgoing: list[PeerGroup], path: str, names: list[str]
    ) -> None:
        flow = Neighbourhood(path=path, incoming=tuple(incoming), outgoing=tuple(outgoing))
        drawn = drawn_flow(table(names), flow)
        tree = lxml.html.fragment_fromstring(drawn).xpath("//svg")[0]
        _x, _y, _width, height = map(float, tree.get("viewbox").split())
        boxes = [{key: float(each.get(key)) for key in ("x", "y", "width", "height")} for each in tree.xpath("//rect")]
        for box in boxes:
            assert box["y"] >= 0
            assert box["y"] + box["height"] <= height
        for line in tree.xpath("//text"):
            x, y = float(line.get("x")), float(line.get("y"))
            assert any(b["x"] <= x <= b["x"] + b["width"] and b["y"] < y < b["y"] + b["height"] for b in boxes)
            assert len(line.text or "") * pictures.CHARACTER <= pictures.BOX
        for hops in (incoming, outgoing):
            more = len(hops) - pictures.MAX_BOXES
            assert more <= 0 or f"{more} more not drawn" in drawn
        assert len(tree.xpath("//polygon")) == sum(min(len(each), pictures.MAX_BOXES) for each in (incoming, outgoing))
        dashed = [hop for each in (incoming, outgoing) for hop in each[: pictures.MAX_BOXES] if not hop.by_right]
        assert len(tree.xpath("//path[@class='hop keys']")) == len(dashed)


class TestSystem:
    @pytest.mark.parametrize(("sample", "blamed"), [("vehicle_governance_flag", ["1", "1"]), ("vehicle_healthy", [])])
    def test_who_is_blamed_is_marked_with_the_number_of_the_cause(
        self, sample: str, blamed: list[str], repository: Path
    ) -> None:
        tree = lxml.html.document_fromstring(page_of(repository / "sample_keystores/flows" / sample))
        (drawn,) = tree.xpath("//figure[@class='whole']/svg")
        assert {*drawn.xpath("./text[not(@class)]/text()")} >= {"/brake", "/gateway", "/motor", "/motor_limit"}
        assert (
            drawn.xpath("./rect[@class='centre bad']/following-sibling::text[1]/text()")
            == ["/brake", "/gateway"][: len(blamed)]
        )
        assert drawn.xpath("./text[@class='number' and @text-anchor='end']/text()") == blamed
        assert len(drawn.xpath("./path[@class='hop bad']")) == len(blamed)

    def test_a_way_that_settings_forbid_is_marked_from_end_to_end(self, repository: Path) -> None:
        """Of the page of a property that is violated; its healthy twin has no red line."""
        samples, marked = repository / "sample_keystores", {}
        for sample in ("turtlesim_random_moves_turtle", "turtlesim_healthy"):
            page = page_of(samples / "flows" / sample, "--settings", str(samples / "settings/turtlesim.toml"))
            (drawn,) = lxml.html.document_fromstring(page).xpath("//figure[@class='whole']/svg")
            topics = drawn.xpath("./rect[@class='box bad']/following-sibling::text[1]/text()")
            marked[sample] = (topics, len(drawn.xpath("./path[@class='hop bad']")))
        assert marked == {
            "turtlesim_random_moves_turtle": (["/move_turtle"], 2),
            "turtlesim_healthy": ([], 0),
        }

    @pytest.mark.parametrize(
        ("sample", "options", "said", "lasts"),
        [
            ("flows/vehicle_governance_flag", (), "For example, /gateway can publish /motor_limit (topic)", False),
            ("flows/vehicle_healthy", (), "Nothing was found that fails this gate.", True),
            (
                "flows/turtlesim_random_moves_turtle",
                ("--settings", "settings/turtlesim.toml"),
                "Data of /random can reach /turtlesim: /random -> /move_turtle (domain 0) -> /turtlesim (no attack",
                False,
            ),
            (
                "zenoh/turtlesim_generated",
                ("--zenoh", "networks/turtlesim_generated"),
                "/random can publish /high_priority if it starts without its file: /multiplexer accepts it",
                False,
            ),
        ],
    )
    def test_the_first_sentence_says_who_can_do_what_and_no_date_comforts(
        self, sample: str, options: tuple[str, ...], said: str, *, lasts: bool, repository: Path
    ) -> None:
        samples = repository / "sample_keystores"
        words = (str(samples / each) if (samples / each).exists() else each for each in options)
        tree = lxml.html.document_fromstring(page_of(samples / sample, *words))
        assert tree.xpath("string(//div[@class='said']/p[1])").startswith(said)
        assert ("holds until" in tree.text_content()) is lasts
        assert ("safe until" in tree.text_content()) is lasts

    @given(
        outgoing=HOPS,
        incoming=HOPS,
        paths=st.lists(NAMES, min_size=1, max_size=30, unique=True),
        names=st.lists(NAMES, min_size=6, max_size=6),
    )
    def test_nothing_leaves_the_picture(
        self, outgoing: list[PeerGroup], incoming: list[PeerGroup], paths: list[str], names: list[str]
    ) -> None:
        flow = Neighbourhood(path=paths[0], incoming=tuple(incoming), outgoing=tuple(outgoing))
        overview = Overview(access=table(names), neighbourhoods=(flow,))
        view = system_picture.system(paths, overview, None, (), Consequences((), ()))
        if not view:  # one enclave alone, of which nothing is sent
            return
        tree = lxml.html.fragment_fromstring(section("system", view)).xpath(".//svg")[0]
        for box in tree.xpath("./rect"):
            text = box.getnext()
            assert 0 <= float(box.get("y")) <= view["height"] - float(box.get("height"))
            end = float(text.get("x")) + len(text.text or "") * system_picture.CHARACTER
            assert end <= float(box.get("x")) + float(box.get("width"))


@pytest.mark.parametrize(
    ("sample", "random", "dropping", "lines"),
    [
        ("turtlesim_generated", ["pub!", "sub!"], ["/keyboard", "/random", "/turtlesim"], 6),
        ("turtlesim_clients", [], ["/zenohd"], 0),
    ],
)
def test_what_each_can_do_by_the_files_of_sessions(
    sample: str, random: list[str], dropping: list[str], lines: int, repository: Path
) -> None:
    """Files that restrain their owners alone, and a router that restrains all: the table, and lines of the picture."""
    samples = repository / "sample_keystores"
    page = page_of(samples / "zenoh" / sample, "--zenoh", str(samples / "networks" / sample))
    tree = lxml.html.document_fromstring(page)
    (matrix,) = tree.xpath("//table[@class='matrix routed']")
    paths = matrix.xpath("./thead//code/text()")
    (row,) = (each for each in matrix.xpath("./tbody/tr") if each.xpath("string(./th)") == "/high_priority")
    cells = {path: cell.xpath("./span/text()") for path, cell in zip(paths, row.xpath("./td"), strict=True)}
    assert (cells["/keyboard"], cells["/multiplexer"], cells["/random"]) == (["pub"], ["sub"], random)
    dashed = {
        path
        for each in matrix.xpath("./tbody/tr")
        for path, cell in zip(paths, each.xpath("./td"), strict=True)
        if "patterned" in cell.get("class", "")
    }
    assert sorted(dashed) == dropping
    assert len(tree.xpath("//figure[@class='whole']//path[@class='hop bad keys']")) == lines


@pytest.mark.parametrize(
    ("sample", "option", "told", "expected"),
    [
        ("healthy/turtlesim", "--graph", "graphs/turtlesim.graph.json", {}),
        ("healthy/turtlesim", "--graph", "graphs/turtlesim-missing-grant.graph.json", {"/keyboard": ["lacks"]}),
        ("flows/vehicle_healthy", "--graph", "graphs/vehicle-excess-grant.graph.json", {"/brake": ["pub†"]}),
        ("healthy/turtlesim", "--policy", "policies/turtlesim.policy.xml", {}),
        (
            "flows/turtlesim_random_moves_turtle",
            "--policy",
            "policies/turtlesim.policy.xml",
            {"/random": ["pub†"]},
        ),
    ],
)
def test_what_was_meant_stands_beside_what_each_may_do(
    sample: str, option: str, told: str, expected: dict[str, list[str]], repository: Path
) -> None:
    samples = repository / "sample_keystores"
    tree = lxml.html.document_fromstring(page_of(samples / sample, option, str(samples / told)))
    (matrix,) = tree.xpath("//table[@class='matrix']")
    paths = [f"/{name}" for name in matrix.xpath("./thead//code/text()")]
    found: dict[str, list[str]] = {}
    for row in matrix.xpath("./tbody/tr[td]"):
        for path, cell in zip(paths, row.xpath("./td"), strict=True):
            words = [word for word in cell.xpath("./span[not(@class='tip')]/text()") if word[-1] in "†s"]
            found |= {path: [*found.get(path, []), *words]} if words else {}
    assert found == expected


@pytest.mark.slow
def test_rows_beyond_the_limit_are_counted(tmp_path: Path) -> None:
    topics = tuple(f"rt/topic_{number}" for number in range(html_tables.MAX_ROWS + 50))
    root = keystore(tmp_path, {"/a": (rule(topics),), "/b": (rule((), topics),)})
    _code, page = answer("audit", root, "--engine", "native", "--at", AT, "-f", "html")
    tree = lxml.html.document_fromstring(page)
    drawn = len(tree.xpath("//table[@class='matrix']//th[@scope='row']"))
    (said,) = re.findall(r"([0-9,]+) rows not drawn", page)
    assert (drawn, int(said)) == (html_tables.MAX_ROWS, 50)
