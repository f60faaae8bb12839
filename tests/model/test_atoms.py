"""Topic classes are exact: no class is missed, none is made up, every witness is confirmed by the C library."""

from __future__ import annotations

import itertools
import json
import random
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence

import pytest

from keystore_audit.errors import BudgetExceeded
from keystore_audit.model.matching.atoms import TopicClass, budget_of, classify
from keystore_audit.model.matching.expression import Pattern, parse
from keystore_audit.profiles import Matcher
from tests.amount import tried
from tests.steps import steps

ROS = re.compile(
    r"ros_discovery_info|r[ts](/[A-Za-z_][A-Za-z_0-9]*)+"
    r"|rq(/[A-Za-z_][A-Za-z_0-9]*)*/[A-Za-z_][A-Za-z_0-9]*Request|rr(/[A-Za-z_][A-Za-z_0-9]*)*/[A-Za-z_][A-Za-z_0-9]*Reply"
)


def patterns_of(texts: Sequence[str], matcher: Matcher = Matcher.POSIX) -> list[Pattern]:
    return [parse(text, matcher) for text in texts]


def by_members(texts: Sequence[str], **options: object) -> dict[tuple[str, ...], TopicClass]:
    """The classes by the texts that match them."""
    classes = classify(patterns_of(texts), **options)  # type: ignore[arg-type]
    return {tuple(texts[number] for number in sorted(found.members)): found for found in classes}


ROS_PARTS = ["rt/", "rq/", "rr/", "rs/", "a", "b1", "/", "_", "*", "*", "?", "Request", "Reply", "Re", "[!r]", "[a-z]"]
ROS_TOKENS = ["a", "b1", "_", "ab", "Request", "aReply", "ReRequest"]


def ros_names() -> list[str]:
    paths = ["".join(f"/{token}" for token in path) for n in (1, 2) for path in itertools.product(ROS_TOKENS, repeat=n)]
    found = ["ros_discovery_info"]
    for path in paths:
        found += [f"rt{path}", f"rs{path}", f"rq{path}Request", f"rr{path}Reply"]
    return found


@pytest.mark.parametrize("seed", range(4))
def test_ros_classes_are_those_that_ros_names_lie_in(seed: int) -> None:
    """225 ROS names for each of 160 sets of expressions, near misses among the expressions."""
    random_ = random.Random(seed)
    legal = ros_names()
    assert all(ROS.fullmatch(name) for name in legal)
    for _ in range(40):
        texts = [
            "".join(random_.choices(ROS_PARTS, k=random_.randint(1, 5))) for _ in range(random_.randint(1, 6))
        ] + random_.sample(legal, 2)
        patterns = patterns_of(texts)
        classes = {found.members: found for found in classify(patterns)}
        for found in classes.values():
            assert found.ros == (ROS.fullmatch(found.witness) is not None), (texts, found)
        for name in legal:
            members = frozenset(n for n, pattern in enumerate(patterns) if pattern.matches(name))
            assert classes[members].ros, (texts, name)


def test_expression_that_matches_nothing_is_in_no_class() -> None:
    for text in ("", "[z-a]", "a\\", "a\0b"):
        assert set(by_members([text])) == {()}


FAMILIES = [
    # analysis-core 1.4; the number of classes is known by counting
    ("prefixes", [f"rt/n_{i}/*" for i in range(2000)], 2001),
    ("suffixes of requests", [f"rq/n_{i}/*Request" for i in range(200)], 201),
    ("suffixes", [f"*/node_{i}/get_parametersRequest" for i in range(50)], 51),
    ("infixes", [f"*x_{i}*" for i in range(8)], 256),
    ("words", [f"rt/*/w_{i}/*" for i in range(8)], 256),
    ("the letter before last", ["*a" + "?" * 9], 2),
]


@pytest.mark.parametrize(("texts", "count"), [family[1:] for family in FAMILIES], ids=[f[0] for f in FAMILIES])
def test_known_families(texts: list[str], count: int) -> None:
    assert len(classify(patterns_of(texts))) == count


@pytest.mark.parametrize(
    "texts",
    [
        [f"rt/*/w_{i}/*" for i in range(15)],
        ["*a" + "?" * 20],
        [f"*[!{chr(0x4E00 + i)}]?{chr(0x5E00 + i)}*" for i in range(tried(3_000))],
        [f"*{chr(0x4E00 + i)}*{chr(0x5E00 + i)}" for i in range(tried(2_000))],
        [f"{'?' * (i % 50)}{chr(97 + i % 26)}*{i}*" for i in range(tried(3_000))],
    ],
    ids=["infixes", "memory of a window", "many sets", "many characters", "all at once"],
)
def test_too_many_classes_exceed_the_budget_soon(texts: list[str]) -> None:
    patterns = patterns_of(texts)
    with pytest.raises(BudgetExceeded, match=f"{len(texts)} expressions need more than 5000 states"):
        steps(lambda: classify(patterns, budget=5_000), most=5_000_000)


def test_robots_of_whom_every_two_have_names_in_common_are_told_apart() -> None:
    """A pattern of what each of 200 sends and one of what is sent to it: more than a single document may cost."""
    patterns = patterns_of([text for n in range(200) for text in (f"rt/n{n}/*", f"rt/*/n{n}")])
    with pytest.raises(BudgetExceeded):
        classify(patterns, budget=budget_of(1))
    found = {each.members for each in classify(patterns, budget=budget_of(200))}
    sent, taken = ([frozenset[int](), *(frozenset({n}) for n in range(first, 400, 2))] for first in (0, 1))
    assert found == {one | other for one in sent for other in taken}


def test_what_exceeds_the_budget_names_an_expression_with_the_most_stars() -> None:
    texts = ["rt/*", *(f"*{a}*{b}*" for a, b in itertools.combinations("abcdefgh", 2)), "rt/*/[!x]*y*z*"]
    with pytest.raises(BudgetExceeded, match=re.escape("as 'rt/*/[!x]*y*z*' has")):
        classify(patterns_of(texts), budget=500)


def test_result_depends_on_neither_order_nor_hash_seed() -> None:
    texts = ["rt/*", "*_tf", "rq/*Request", "rt/robot[0-9]/odom", "rt/robot1/odom", "rt/[!r]*", "*/x/*", "rt/a", "?"]
    random_ = random.Random(0)
    expected = classes_as_text(texts, classify(patterns_of(texts), prefer={"rt/scan", "rt/odom", "y", "z"}))
    for _ in range(5):
        random_.shuffle(texts)
        assert classes_as_text(texts, classify(patterns_of(texts), prefer={"rt/odom", "z", "rt/scan", "y"})) == expected
    script = (
        "import json, sys; from keystore_audit.model.matching.atoms import classify;"
        "from keystore_audit.model.matching.expression import Matcher, parse; texts = json.loads(sys.argv[1]);"
        "found = classify([parse(t, Matcher.POSIX) for t in texts], prefer={'rt/scan', 'rt/odom', 'y', 'z'});"
        "print(json.dumps([[sorted(texts[m] for m in c.members), c.witness, c.ros, c.infinite] for c in found]))"
    )
    for seed in ("1", "2"):
        run = subprocess.run(
            [sys.executable, "-c", script, json.dumps(texts)],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": ":".join(sys.path)},
            capture_output=True,
            text=True,
            check=True,
        )
        assert json.loads(run.stdout) == expected


def classes_as_text(texts: Sequence[str], classes: Sequence[TopicClass]) -> list[list[object]]:
    return [[sorted(texts[m] for m in c.members), c.witness, c.ros, c.infinite] for c in classes]


def keystore_like(size: int, wildcards: int) -> list[str]:
    """Names as a fleet's permissions hold them, 40 % topics, 60 % parameter services, and wildcards as people write."""
    random_ = random.Random(size)
    fixed = ["*", "rt/*", "rq/*Request", "rt/robot?/cmd_vel", "*/get_parameters*", "rt/*/_action/feedback", "*_tf"]
    fixed += ["rt/robot[0-9]/odom", "rt/[!r]*", "rr/*Reply"]
    forms = ["rt/robot{}/*", "rq/robot{}/*Request", "rt/robot{}/cam?/image*", "*/node{}/odom", "rr/robot{}*Reply"]
    texts = fixed[:wildcards] + [random_.choice(forms).format(number) for number in range(wildcards - len(fixed))]
    distinct = dict.fromkeys(texts)
    while len(distinct) < size:
        node = f"robot{random_.randrange(size)}/{random_.choice(['nav', 'arm', 'camera'])}"
        names = [f"rt/{node}/odom", f"rt/{node}/image_raw", f"rq/{node}/get_parametersRequest"]
        names += [f"rr/{node}/get_parametersReply", f"rq/{node}/set_parametersRequest"]
        distinct[random_.choice(names)] = None
    return list(distinct)


@pytest.mark.parametrize(("size", "wildcards"), [(tried(5_000, 1_000), tried(50, 16))])
def test_keystore_of_thousands_of_expressions_is_classified_at_once(size: int, wildcards: int) -> None:
    patterns = patterns_of(keystore_like(size, wildcards))
    classes = classify(patterns)
    assert len(classes) >= size - wildcards
    assert max(Counter(found.witness for found in classes).values()) == 1
    steps(lambda: classify(patterns), most=1_000 * size)


def test_asking_many_expressions_about_many_names_is_bounded() -> None:
    """Sets of characters that nothing tells apart by beginning and end: each of the names is asked of all of them."""
    random_ = random.Random(1)
    letters = [chr(code) for code in range(0x4E00, 0x4E00 + 20_000)]
    texts = [f"[{''.join(random_.sample(letters, 46))}]" for _ in range(300)]
    assert len(classify(patterns_of(texts[:40]))) > 40
    with pytest.raises(BudgetExceeded):
        classify(patterns_of(texts), budget=10_000)


def test_characters_beyond_ascii_and_surrogates_take_part() -> None:
    classes = by_members(["rt/é", "rt/[à-ü]", "\U0001f600*", "[\ud800-\udfff]"])
    assert classes[("rt/é", "rt/[à-ü]")].witness == "rt/é"
    assert classes[("rt/[à-ü]",)].witness == "rt/à"
    assert classes[("\U0001f600*",)].witness == "\U0001f600"
    assert ("[\ud800-\udfff]",) in classes
