"""The committed samples are what their stories build, and each rule has its two."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from tools import build_samples
from tools.samples import catalogue, made_at_test_time
from tools.samples.compare import differences, read_stock
from tools.samples.expectation import finding_line
from tools.samples.made_at_test_time import RECIPES, VARIANTS
from tools.samples.store import Link, Tree, copy_with_modes, is_private_key, read, write
from tools.samples.story import Story, read_description

SAMPLES = build_samples.SAMPLES
STORIES = tuple(catalogue.stories())
PAIRS = {story.rule: story for story in STORIES if story.rule and story.directory.endswith("/bad")}

MADE_BY_FAULTS = frozenset({"KA616", "KA666", "KA901", "KA902", "KA903", "KA904", "KA905", "KA907", "KA908"})
"""Findings about an audit that went wrong: a keystore alone does not cause them (tests/test_engine_faults.py). KA616 is
the net below its family (tests/rules/test_divergence_rules.py), KA666 is about two keystores
(tests/rules/test_provisioning_rules.py)."""

LARGEST = 6 * 1024 * 1024
"""The samples are part of every clone and source distribution."""


def directory(story: Story) -> str:
    return story.directory


@pytest.mark.parametrize("story", STORIES, ids=directory)
def test_a_committed_sample_is_what_its_story_builds(story: Story) -> None:
    assert build_samples.check(story) == []


def test_nothing_else_is_committed() -> None:
    assert build_samples.leftovers() == []


def test_another_process_with_other_hashes_builds_the_same() -> None:
    environment = {**os.environ, "PYTHONHASHSEED": "4711", "TZ": "Pacific/Apia"}
    command = [sys.executable, str(build_samples.ROOT / "tools" / "build_samples.py"), "--check"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_check_notices_every_kind_of_difference(tmp_path: Path) -> None:
    story = next(story for story in STORIES if story.directory == "stock/talker_listener")
    build_samples.build(story, tmp_path)
    assert build_samples.check(story, tmp_path) == []
    sample = tmp_path / story.directory
    enclave = sample / "enclaves" / "talker"
    (enclave / "cert.pem").write_bytes((sample / "public" / "ca.cert.pem").read_bytes())
    (enclave / "extra").write_bytes(b"")
    (enclave / "key.pem").unlink()
    (enclave / "governance.p7s").unlink()
    (enclave / "governance.p7s").symlink_to("../governance.xml")
    message = enclave / "permissions.p7s"
    message.write_bytes(message.read_bytes().replace(b"rt/chatter", b"rt/chatted"))
    (sample / "enclaves" / "listener" / "permissions.p7s").write_bytes(
        (sample / "enclaves/governance.p7s").read_bytes()
    )
    (sample / "enclaves" / "governance.p7s").write_bytes(b"no message at all")
    lines = (line.split(":")[0] for line in build_samples.check(story, tmp_path))
    assert {line.removeprefix(f"{story.directory}/enclaves/") for line in lines} == {
        "governance.p7s",
        "listener/permissions.p7s",
        "talker/cert.pem",
        "talker/extra",
        "talker/governance.p7s",
        "talker/key.pem",
        "talker/permissions.p7s",
    }
    build_samples.build(story, tmp_path)
    assert build_samples.check(story, tmp_path) == []


def test_a_second_build_leaves_stock_signatures_alone(tmp_path: Path) -> None:
    story = next(story for story in STORIES if story.directory == "stock/talker_listener")
    build_samples.build(story, tmp_path)
    first = read(tmp_path / story.directory)
    again = next(s for s in catalogue.stories(story.directory))
    assert again.tree["enclaves/governance.p7s"] != first["enclaves/governance.p7s"], "the signer adds a nonce"
    build_samples.build(again, tmp_path)
    assert read(tmp_path / story.directory) == first


def test_a_build_keeps_the_expected_findings(tmp_path: Path) -> None:
    story = next(story for story in STORIES if story.rule == "KA207")
    build_samples.build(story, tmp_path)
    description = tmp_path / f"{story.directory}.toml"
    findings = ['KA207 high /talker "quoted".pem:1', "KA108 medium - -"]
    description.write_text(story.description({"exit_code": 1, "findings": findings}), "utf-8")
    build_samples.build(story, tmp_path)
    found = read_description(tmp_path / story.directory)
    assert (found["exit_code"], found["findings"], found["story"]) == (1, findings, story.text)
    assert build_samples.check(story, tmp_path) == []


def test_a_finding_is_written_with_its_first_place() -> None:
    finding = {"code": "KA110", "severity": "medium", "enclave": "/talker", "suppressed": None}
    two = [{"path": "a/b.p7s", "line": 7, "message": ""}, {"path": "a/b.xml", "line": 1, "message": ""}]
    assert finding_line({**finding, "locations": two}) == "KA110 medium /talker a/b.p7s:7"
    whole = [{"path": "a/b.p7s", "line": None, "message": ""}]
    assert finding_line({**finding, "enclave": None, "locations": whole}) == "KA110 medium - a/b.p7s:-"
    assert finding_line({**finding, "locations": []}) == "KA110 medium /talker -:-"


def test_links_are_relative_and_lead_to_files_inside() -> None:
    """git keeps other links, a source distribution does not, and it follows links to directories.

    One that leads nowhere is no file to either: that it cannot be followed is what such a sample is about.
    """
    samples = {SAMPLES / story.directory for story in STORIES}
    links = [place for place in SAMPLES.rglob("*") if place.is_symlink()]
    assert links, "keystores as sros2 makes them hold links"
    for place in links:
        (sample,) = samples.intersection(place.parents)
        assert not place.readlink().is_absolute(), place
        assert not place.is_dir(), f"{place} leads to a directory"
        assert not place.exists() or place.resolve().is_relative_to(sample.resolve()), place


def test_the_samples_stay_small() -> None:
    files = [place for place in SAMPLES.rglob("*") if place.is_file() and not place.is_symlink()]
    assert sum(place.stat().st_size for place in files) < LARGEST


def test_names_differ_in_more_than_case() -> None:
    """A clone on a file system that ignores case would lose one of two."""
    paths = [place.relative_to(SAMPLES).as_posix() for place in SAMPLES.rglob("*")]
    assert len({path.casefold() for path in paths}) == len(paths)


def test_every_rule_has_a_bad_and_a_good_keystore() -> None:
    from keystore_audit.rules import RULES

    codes = {rule.code for rule in RULES}
    assert codes - PAIRS.keys() - RECIPES.keys() - MADE_BY_FAULTS == set()
    assert (PAIRS.keys() | RECIPES.keys() | {code for code, _ in VARIANTS.values()}) - codes == set()


def test_a_pair_is_called_as_its_rule_is() -> None:
    from keystore_audit.rules import BY_CODE

    for code, story in PAIRS.items():
        assert code is not None
        assert story.directory == f"rules/{code}-{BY_CODE[code].name}/bad"


@pytest.mark.parametrize("code", sorted(code for code in PAIRS if code))
def test_a_pair_differs_only_where_its_story_says(code: str) -> None:
    bad = PAIRS[code]
    (good,) = (s for s in STORIES if s.directory == bad.directory.removesuffix("bad") + "good")
    assert (good.rule, good.at, good.key_mode) == (bad.rule, bad.at, bad.key_mode)
    changed = [one != other for one, other in zip(bad.options, good.options, strict=True)]
    in_tree = bool(list(differences(bad.tree, good.tree, by_meaning=False)))
    assert in_tree + sum(changed) == 1, "the keystore, or one file that an option names"
    assert bad.text != good.text


@pytest.mark.parametrize("story", [s for s in STORIES if s.by_meaning], ids=directory)
def test_stock_documents_verify_and_hold_their_xml(story: Story) -> None:
    tree: Tree = read(SAMPLES / story.directory)
    signed = [path for path, entry in tree.items() if path.endswith(".p7s") and not isinstance(entry, Link)]
    assert signed
    for path in signed:
        message, xml = tree[path], tree[path.replace(".p7s", ".xml")]
        assert isinstance(message, bytes)
        assert isinstance(xml, bytes)
        content = read_stock(message).entity
        assert content == b"Content-Type: text/plain\r\n\r\n" + xml.replace(b"\n", b"\r\n")


def test_a_copy_has_the_modes_of_the_story(tmp_path: Path) -> None:
    sample = SAMPLES / "healthy" / "turtlesim"
    copy_with_modes(sample, tmp_path / "copy", 0o600)
    assert read(tmp_path / "copy") == read(sample)
    for place in (tmp_path / "copy").rglob("*"):
        if place.is_file() and not place.is_symlink():
            assert stat.S_IMODE(place.stat().st_mode) == (0o600 if is_private_key(place.name) else 0o644)


def test_no_mode_is_left_to_the_umask(tmp_path: Path) -> None:
    before = os.umask(0o077)
    try:
        write(STORIES[0].tree, tmp_path / "sample", 0o644)
    finally:
        os.umask(before)
    modes = {stat.S_IMODE(p.stat().st_mode) for p in (tmp_path / "sample").rglob("*") if p.is_file()}
    assert modes == {0o644}


@pytest.mark.parametrize("code", sorted(RECIPES))
def test_a_recipe_builds_two_different_keystores(code: str, tmp_path: Path) -> None:
    for name, recipe in zip(("bad", "good"), RECIPES[code], strict=True):
        recipe(tmp_path / name)
    assert _described(tmp_path / "bad") != _described(tmp_path / "good")


def _described(root: Path) -> dict[bytes, tuple[int, bytes]]:
    """Each entry's mode and content or link target: what a recipe can be about."""
    found = {}
    for folder, folders, files in os.walk(os.fsencode(root)):
        for name in (*folders, *files):
            path = os.path.join(folder, name)
            mode = os.lstat(path).st_mode
            content = b""
            if stat.S_ISLNK(mode):
                content = os.readlink(path)
            elif stat.S_ISREG(mode):
                content = Path(os.fsdecode(path)).read_bytes()
            found[os.path.relpath(path, os.fsencode(root))] = (mode, content)
    return found


def test_recipes_make_what_git_cannot_hold(tmp_path: Path) -> None:
    def enclave(code: str) -> Path:
        RECIPES[code][0](tmp_path / code)
        return tmp_path / code / "enclaves" / "talker"

    dangling = enclave("KA102") / "identity_ca.cert.pem"
    assert dangling.is_symlink()
    assert not dangling.exists()
    outside = enclave("KA103") / "cert.pem"
    assert outside.is_file()
    assert not outside.resolve().is_relative_to(tmp_path / "KA103")
    assert (enclave("KA104").parent / "fleet").is_dir()
    assert stat.S_ISFIFO((enclave("KA105") / "permissions.p7s").stat().st_mode)
    assert (enclave("KA106") / "permissions.p7s").stat().st_size > made_at_test_time.TOO_LARGE - 1
    with pytest.raises(OSError, match="name too long"):
        (enclave("KA107") / "permissions.p7s").read_bytes()
    assert stat.S_IMODE((enclave("KA108") / "key.pem").stat().st_mode) == 0o644


def test_the_good_side_of_the_size_limit_is_just_inside(tmp_path: Path) -> None:
    RECIPES["KA106"][1](tmp_path / "good")
    assert (tmp_path / "good/enclaves/talker/permissions.p7s").stat().st_size == made_at_test_time.TOO_LARGE - 1
