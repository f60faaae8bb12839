"""How much work a call is, counted: no clock is asked, so that a busy machine changes nothing."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

PRODUCT = str(Path(__file__).parents[1] / "keystore_audit")


def steps(call: Callable[[], object], most: float = math.inf) -> int:
    """The lines of keystore_audit that the call runs through; beyond `most` it is ended, and the test fails.

    A line is one step however much C code it calls: what that repeats without need is left to pytest's
    `faulthandler_timeout`.
    """
    count = 0

    def line(_frame: FrameType, event: str, _argument: object) -> Any:
        nonlocal count
        count += event == "line"
        assert count <= most, f"more than {most} steps"
        return line

    def frame(entered: FrameType, _event: str, _argument: object) -> Any:
        return line if entered.f_code.co_filename.startswith(PRODUCT) else None

    before = sys.gettrace()
    sys.settrace(frame)
    try:
        call()
    finally:
        sys.settrace(before)
    assert count, "nothing of keystore_audit was called"
    assert count <= most, "the call went on after it was ended"
    return count
