"""An interrupt in the middle of what must not be half done."""

from __future__ import annotations

import signal
import threading

import pytest

from keystore_audit.cli.progress import interrupts_later


def test_the_block_is_finished_first() -> None:
    steps = []

    def work() -> None:
        with interrupts_later():
            signal.raise_signal(signal.SIGINT)
            steps.append("finished")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert steps == ["finished"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_error_of_the_block_is_not_hidden() -> None:
    def work() -> None:
        with interrupts_later():
            signal.raise_signal(signal.SIGINT)
            raise ValueError("own")

    with pytest.raises(ValueError, match="own"):
        work()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_other_threads_are_left_alone() -> None:
    done = []

    def work() -> None:
        with interrupts_later():
            done.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done == [True]
