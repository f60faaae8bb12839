"""What people read is in sentences of at most 25 words, without words that have plainer ones."""

from __future__ import annotations

import pytest

from tools import words


@pytest.mark.parametrize("part", words.PARTS)
def test_every_sentence_is_easy(part: str) -> None:
    assert [f"{place}: {said}" for place, text in words.texts(part) for said in words.hard(text)] == []


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("word " * 25 + "end.", 1),
        ("word " * 24 + "end.", 0),
        ("word " * 20 + "end. " + "Word " * 20 + "end.", 0),
        ("word " * 20 + "end; " + "word " * 20 + "end.", 1),
        ("- " + "word " * 20 + "\n- " + "word " * 20, 0),
        ("| " + "word " * 20 + "| " + "word " * 20 + "|", 0),
        ("```\n" + "word " * 40 + "\n```", 0),
        ("`" + "word " * 40 + "` word", 0),
        ("Mend it.", 1),
        ("Amendments mention it.", 0),
    ],
)
def test_the_search_finds_what_is_hard(text: str, found: int) -> None:
    assert len([*words.hard(text)]) == found
