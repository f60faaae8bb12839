"""What README.md shows of the program is what the program prints."""

from __future__ import annotations

from tools import readme_output


def test_the_shown_output_is_the_command_s() -> None:
    text = readme_output.README.read_text("utf-8")
    assert [match["command"] for match in readme_output.BLOCK.finditer(text)] == [
        "sample_keystores/stock/talker_listener"
    ]
    assert readme_output.written() == text, "run tools/readme_output.py"
