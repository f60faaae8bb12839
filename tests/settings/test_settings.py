"""keystore-audit.toml: what is asserted, and where something in it is wrong."""

from __future__ import annotations

import hashlib
import json
import string
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from keystore_audit import toml
from keystore_audit.errors import UsageError
from keystore_audit.findings import Severity
from keystore_audit.model.claims.globs import Globs
from keystore_audit.model.claims.stated import Claim
from keystore_audit.model.formal.asked import Attacker, ClaimKind
from keystore_audit.settings.document import lines_of
from keystore_audit.settings.settings import read_settings
from tests.schemas import schema
from tests.settings.files import plain, read, wrong

HEAD = '[[property]]\nname = "a"\n'
SAMPLES = Path(__file__).resolve().parents[2] / "sample_keystores"


def claims(tmp_path: Path, text: str) -> tuple[Claim, ...]:
    return read(tmp_path, text).claims


@pytest.mark.parametrize(("said", "told"), [("No", "No."), ("No. ", "No."), ("Never!", "Never!"), ("Why?", "Why?")])
def test_a_description_ends_as_a_sentence_since_more_follows_it(said: str, told: str, tmp_path: Path) -> None:
    text = '[[property]]\nname = "x"\ndescription = "{}"\nnever_share_domain = ["/a", "/b"]\n'
    (claim,) = claims(tmp_path, text.format(said))
    assert claim.statement == told


def test_every_form_is_read(tmp_path: Path) -> None:
    flow, publish, encrypted, apart, able = claims(
        tmp_path,
        """
[[property]]
name = "flow"
description = "Mine."
severity = "low"
until = 2027-01-01
no_flow = { from = ["/a/*", "/b"], to = "topic:/cmd_vel", through = "/c", attacker = "source", include_ambient = true }
[[property]]
name = "publish"
only_publish = { topic = "/x/*", enclaves = ["/d"] }
[[property]]
name = "encrypted"
encrypted = { topic = "dds:rq/addRequest", against = "insider" }
[[property]]
name = "apart"
never_share_domain = ["/a", "/b"]
[[property]]
name = "able"
until = 2027-01-01T01:00:00+02:00
[property.able]
from = "outsider"
to = "/b"
""",
    )
    assert (flow.id, flow.statement, flow.severity, flow.kind) == ("flow", "Mine.", Severity.LOW, ClaimKind.NO_FLOW)
    assert (flow.attacker, flow.through, flow.include_ambient) == (Attacker.SOURCE, ("/c",), True)
    assert (flow.source, flow.target) == (Globs(enclaves=("/a/*", "/b")), Globs(topics=("rt/cmd_vel",)))
    assert flow.until == datetime(2027, 1, 1, 23, 59, 59, tzinfo=timezone.utc)
    assert (flow.location.line, flow.location.beside) == (2, True)
    assert (publish.source, publish.target) == (Globs(enclaves=("/d",)), Globs(topics=("rt/x/*",)))
    assert (publish.statement, publish.severity) == ("Only /d may publish /x/*.", Severity.HIGH)
    assert (encrypted.attacker, encrypted.target) == (Attacker.INSIDER, Globs(topics=("rq/addRequest",)))
    assert (apart.source, apart.target) == (Globs(enclaves=("/a",)), Globs(enclaves=("/b",)))
    assert (able.kind, able.source) == (ClaimKind.ABLE, Globs(outsider=True))
    assert "nodes can be made (KA636)" in able.statement, "what is not asked is said"
    assert able.until == datetime(2026, 12, 31, 23, 0, 0, tzinfo=timezone.utc)


@pytest.mark.parametrize(
    ("text", "where", "what"),
    [
        ("x = [", ":1", "this is not TOML"),
        ("[[propertty]]\n", ":1", "unknown key 'propertty'; expected property, forward, "),
        ("property = 3\n", ":1", "Expected `array`, got `int`"),
        (f"{HEAD}", ":1", "expected exactly one of no_flow"),
        ("[[property]]\nable = 1\n", ":2", "Expected `table`, got `int`"),
        ('[[property]]\nname = "A b"\nable = {}\n', ":2", "expected letters a to z, digits and hyphens"),
        ('[[property]]\nname = "outsiders-cannot-read"\nable = { from = "/a", to = "/b" }\n', ":2", "always decided"),
        (f"{HEAD}  no_flow = {{ fro = 1 }}\n", ":3", "unknown key 'fro'"),
        (f'{HEAD}no_flow = {{ from = "/a" }}\n', ":3", "missing key `to`"),
        (
            f'{HEAD}no_flow = {{ from = "arm", to = "/b" }}\n',
            ":3",
            """'arm': expected enclaves ("/arm/*"), or topics ("topic:/cmd_vel",""",
        ),
        (f'{HEAD}no_flow = {{ from = ["/a", "topic:/b"], to = "/b" }}\n', ":3", "one sort alone"),
        (f'{HEAD}no_flow = {{ from = "/a", to = "topic:b" }}\n', ":3", "is no topic"),
        (f'{HEAD}no_flow = {{ from = "/a", to = "/b", attacker = "all" }}\n', ":3", "expected honest, relays, source"),
        (f'{HEAD}no_flow = {{ from = "/a", to = "/b", through = "c" }}\n', ":3", "expected an enclave's path"),
        (f'{HEAD}no_flow = {{ from = "/a", to = "/b", include_ambient = 1 }}\n', ":3", "Expected `bool`, got `int`"),
        (f'{HEAD}able = {{ from = [], to = "/b" }}\n', ":3", "Expected `array` of length >= 1"),
        (f'{HEAD}severity = "bad"\nable = {{ from = "/a", to = "/b" }}\n', ":3", "expected critical, high"),
        (f'{HEAD}until = "2027-01-01"\nable = {{ from = "/a", to = "/b" }}\n', ":3", "without quotes"),
        (f'{HEAD}until = 0001-01-01T00:00:00+10:00\nable = {{ from = "/a", to = "/b" }}\n', ":3", "no UTC date"),
        (
            f'{HEAD}never_share_domain = ["/a"]\n',
            ":3",
            "never_share_domain: Expected `array` of length >= 2; expected two enclaves",
        ),
        (f'{HEAD}only_publish = {{ topic = "x", enclaves = "/a" }}\n', ":3", "expected a topic as"),
        (f"{HEAD}encrypted = 3\n", ":3", "Expected `table`, got `int`"),
        (f'{HEAD}able = {{ from = "/a", to = "/b" }}\n' * 2, ":5", "there is a property 'a' already"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path: Path, text: str, where: str, what: str) -> None:
    said = wrong(tmp_path, text)
    assert said.startswith(f"{where}: ")
    assert what in said


def test_bytes_that_are_no_text_and_files_that_are_no_settings(tmp_path: Path) -> None:
    assert wrong(tmp_path, b"# ok\nx = '\xff'\n").startswith(":2: this is not UTF-8")
    assert "larger" in wrong(tmp_path, b"#" * 1_000_001)
    assert "this is not TOML" in wrong(tmp_path, "x = " + "[" * 100_000)
    with pytest.raises(UsageError, match="cannot be read"):
        read_settings(tmp_path / "none.toml", ())


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (f"a{'.a' * 32_000} = 1", 1),
        (f"\n[a{' . a' * 20}]", 2),
        ("x = { a" + '."a"' * 20 + " = 1 }", 1),
        ("x = '''\n\n'''\n# a\nx = { 'a'" + ".a" * 20 + " = 1 }", 5),
    ],
)
def test_long_keys_are_refused_before_any_parser_is_asked(
    tmp_path: Path, text: str, line: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    monkeypatch.setattr(toml, "_loads", lambda document: asked.append(document) or {})
    assert wrong(tmp_path, text).startswith(f":{line}: more than is read here: a key of ")
    assert asked == []


@pytest.mark.parametrize(
    "text",
    [
        f"a{'.a' * 19} = 1",
        f"{'k' * 2_000} = 1",
        'x = "' + "k" * 5_000 + '"',
        'x = [\n  "' + "k." * 500 + '",\n]',
        "x = 1  # " + "a." * 100 + "k" * 500,
        'x = """\n' + "a." * 100 + '\n"""',
    ],
)
def test_keys_within_the_limits_and_long_values_are_read(text: str) -> None:
    assert toml.loads(text) == toml._loads(text)


def test_settings_inside_of_the_keystore_are_refused_also_over_a_link(tmp_path: Path) -> None:
    keystore = tmp_path / "keystore"
    (keystore / "enclaves").mkdir(parents=True)
    inside = keystore / "enclaves" / "keystore-audit.toml"
    inside.write_text("")
    link = tmp_path / "settings.toml"
    link.symlink_to(inside)
    for path in (inside, link):
        with pytest.raises(UsageError, match="would judge itself"):
            read_settings(path, [str(keystore)])
    outside = tmp_path / "outside.toml"
    outside.write_text("")
    assert read_settings(outside, [keystore]).file.sha256 == hashlib.sha256(b"").hexdigest()


def test_links_that_lead_in_a_circle_are_said(tmp_path: Path) -> None:
    circle = tmp_path / "circle"
    circle.symlink_to(circle)
    with pytest.raises(UsageError, match="circle cannot be read: Too many levels of symbolic links"):
        read_settings(circle, [str(tmp_path / "keystore")])
    file = tmp_path / "settings.toml"
    file.write_text("")
    assert read_settings(file, [str(circle)]).claims == ()


def test_the_schema_takes_what_is_taken_and_refuses_what_is_refused(tmp_path: Path) -> None:
    validator = schema("settings")
    for file in sorted((SAMPLES / "settings").glob("*.toml")):
        settings = read_settings(file, ())
        assert settings.claims or settings.declared.claims
        assert [error.message for error in validator.iter_errors(plain(file.read_text()))] == []
    for text in (
        HEAD,
        "[[propertty]]\n",
        f'{HEAD}able = {{ from = "/a", to = "/b", attacker = "source" }}\n',
        f'{HEAD}able = {{ from = "/a", to = "/b" }}\nencrypted = {{ topic = "/a" }}\n',
        f'{HEAD}never_share_domain = ["/a"]\n',
        f'{HEAD}only_publish = {{ topic = "/a", enclaves = "a" }}\n',
    ):
        assert wrong(tmp_path, text)
        assert not validator.is_valid(plain(text)), text


KEYS = st.text(alphabet=string.ascii_letters + string.digits + "-_", min_size=1, max_size=3) | st.text(max_size=3)
SCALARS = st.one_of(
    st.integers(-(10**9), 10**9).map(str),
    st.booleans().map(lambda flag: str(flag).lower()),
    st.sampled_from(["1.5", "2027-01-01", "2027-01-01 12:00:00Z", "'''a\n]b'''", '"""x"y\\"""" # }\n"""', "'#,]'"]),
    st.text(max_size=6).map(lambda text: json.dumps(text).replace("\\ud", "\\u00").replace("\x7f", "")),
)
BLANKS = st.sampled_from(["", " ", "\t", "  # [c] = 'x\n", "\n"])


def quoted(key: str) -> str:
    """A key as it can stand in a document."""
    bare = key and all(c in string.ascii_letters + string.digits + "-_" for c in key)
    return key if bare else json.dumps("".join(c for c in key if c.isprintable() and ord(c) < 0xD800))


@st.composite
def values(draw: st.DrawFn) -> str:
    """A scalar, an array or an inline table of some: settings have no deeper ones."""
    kind = draw(st.integers(0, 2))
    if kind == 1:
        items = draw(st.lists(SCALARS, max_size=3))
        gaps = [draw(BLANKS) for _ in range(2 * len(items) + 1)]
        parts = (f"{gaps[2 * n]}{item}{gaps[2 * n + 1]}" for n, item in enumerate(items))
        return "[" + ",".join(parts) + gaps[-1] + "]"
    if kind == 2:
        pairs = draw(st.dictionaries(KEYS.map(quoted), SCALARS, max_size=3))
        return "{ " + ", ".join(f"{key} = {value}" for key, value in pairs.items()) + " }"
    return draw(SCALARS)


@st.composite
def documents(draw: st.DrawFn) -> str:
    lines = []
    for header in [None, *draw(st.lists(KEYS.map(quoted), max_size=3))]:
        if header is not None:
            several = draw(st.booleans())
            sub = draw(st.sampled_from(["", ".sub", ' . "s.b"']))
            lines.append(f"[[ {header}{sub} ]] # x" if several else f"[{header}{sub}]")
        pairs = draw(st.dictionaries(KEYS.map(quoted), values(), max_size=3))
        lines += [f"{draw(st.sampled_from(['', '  ']))}{key}{draw(st.sampled_from(['', '.k']))} = {value}"
                  for key, value in pairs.items()]  # fmt: skip
    return "\n".join(lines) + "\n"


def paths(value: object, at: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Every key and item of what the parser read."""
    children: Sequence[tuple[str | int, object]] = ()
    if isinstance(value, Mapping):
        children = list(value.items())
    elif isinstance(value, list):
        children = list(enumerate(value))
    for key, child in children:
        yield (*at, key)
        yield from paths(child, (*at, key))


@settings(max_examples=200, derandomize=True, deadline=None)
@given(documents())
def test_lines_are_those_of_keys_that_the_parser_reads(text: str) -> None:
    try:
        read = toml.loads(text)
    except toml.TOMLDecodeError:
        return
    found = lines_of(text)
    every = set(paths(read))
    assert set(found) <= every
    assert {path for path in every if len(path) == 1} <= set(found)
    lines = text.split("\n")
    for path, line in found.items():
        here = lines[line - 1].lstrip()
        key = path[-1] if isinstance(path[-1], str) else path[-2]
        assert str(key) in here or here.startswith(("[", '"')), (path, here)


def test_lines_by_hand() -> None:
    text = (
        'a = 1\n[[b]]\n  "c d".e = [1,\n   2]\nx = """\n[no]\nno = 1"""\n[[b]]\ny = { z = 1 }\n[b.f]\n# n = 1\ng = 1\n'
    )
    assert lines_of(text) == {
        ("a",): 1,
        ("b",): 2,
        ("b", 0): 2,
        ("b", 0, "c d"): 3,
        ("b", 0, "c d", "e"): 3,
        ("b", 0, "x"): 5,
        ("b", 1): 8,
        ("b", 1, "y"): 9,
        ("b", 1, "f"): 10,
        ("b", 1, "f", "g"): 12,
    }


@pytest.mark.parametrize(
    ("text", "runs"),
    [
        ('[enclaves."/arm"]\nrmw = "cyclonedds"\n', {"/arm": ("cyclonedds-0.10", "cyclonedds-11")}),
        ('[enclaves."/arm"]\nprofile = ["humble"]\nrmw = "fastdds"\n', {"/arm": ("fastdds-2.6",)}),
        ('[enclaves]\n"/a/b" = { profile = "opendds" }\n', {"/a/b": ("opendds",)}),
        ('[enclaves."/arm"]\n', None),
        ('[enclaves.arm]\nrmw = "cyclonedds"\n', None),
        ('[enclaves."/arm"]\nrmw = "zenoh"\n', None),
        ('[enclaves."/arm"]\nprofile = "fastdds-1"\n', None),
        ('[enclaves."/arm"]\nrelease = "humble"\n', None),
    ],
)
def test_enclaves_may_run_another_implementation(
    text: str, runs: dict[str, tuple[str, ...]] | None, tmp_path: Path
) -> None:
    file = tmp_path / "settings.toml"
    file.write_text(text)
    if runs is None:
        with pytest.raises(UsageError, match=r"settings\.toml:[12]: "):
            read_settings(file, ())
    else:
        assert read_settings(file, ()).runs == runs
        assert [error.message for error in schema("settings").iter_errors(plain(text))] == []
