"""Changes that are shown once: only where a reader can tell what the others are."""

from __future__ import annotations

import pytest

from keystore_audit.model.comparison.change import Change, Direction, Layer, Name, Names
from keystore_audit.report.diff_text import alike


def gained(path: str, topic: str) -> Change:
    name = Name(topic=topic, partition="", domains=((0, 0),), several=False)
    names = Names(shown=(name,), more=0, infinite=False, domains=((0, 0),), every=False)
    return Change(
        layer=Layer.GRANTS,
        kind="right",
        direction=Direction.GAINED,
        what="may publish",
        enclaves=(path,),
        profiles=("spec",),
        operation="publish",
        names=names,
    )


@pytest.mark.parametrize(
    ("one", "other", "told"),
    [
        (("/a", "rt/a/x"), ("/b", "rt/b/x"), 1),
        (("/robot1/arm", "rt/robot1/x"), ("/robot2/arm", "rt/robot2/x"), 1),
        (("/a", "rt/x"), ("/b", "rt/x"), 1),
        (("/a", "rt/arm"), ("/b", "rt/brm"), 2),
        (("/a", "rt/x/a_b"), ("/c", "rt/x/c_b"), 2),
        (("/", "rt/cmd"), ("/x", "rt/xcmd"), 2),
        (("/a", "rt/x"), ("/b", "rt/y"), 2),
    ],
)
def test_whole_segments_of_paths_stand_for_each_other(one: tuple[str, str], other: tuple[str, str], told: int) -> None:
    changes = [gained(*one), gained(*other)]
    found = alike(changes)
    assert [change for change, _paths in found] == changes[:told]
    assert [paths for _change, paths in found] == ([(other[0],)] if told == 1 else [(), ()])
