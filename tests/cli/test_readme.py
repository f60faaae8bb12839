"""What pages show of the program is what the program prints."""

from __future__ import annotations

import pytest

from tools import page_output


@pytest.mark.parametrize("page", page_output.PAGES)
def test_the_shown_output_is_the_command_s(page: str) -> None:
    text = (page_output.ROOT / page).read_text("utf-8")
    assert page_output.BLOCK.search(text)
    assert page_output.written(page) == text, "run tools/page_output.py"
