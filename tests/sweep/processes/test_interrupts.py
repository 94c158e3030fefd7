"""Ctrl-C and SIGTERM are noted, whatever becomes of an exception, and nobody is interrupted in the middle."""

from __future__ import annotations

import contextlib
import os
import signal

import pytest

from bow_sweep.processes.interrupts import SIGNALS, Interrupts

ONCE_MORE = "a few seconds"


def handlers() -> list[object]:
    return [signal.getsignal(number) for number in SIGNALS]


@pytest.mark.parametrize("number", SIGNALS)
def test_the_end_is_asked_for_where_it_is_checked(number: signal.Signals) -> None:
    before, done = handlers(), []
    with pytest.raises(KeyboardInterrupt), Interrupts(ONCE_MORE) as interrupts:
        interrupts.check()
        signal.raise_signal(number)
        done.append("in order")
        interrupts.check()
        done.append("never")
    assert done == ["in order"]
    assert handlers() == before


def test_what_nobody_has_checked_for_comes_up_at_the_end() -> None:
    done = []
    with pytest.raises(KeyboardInterrupt), Interrupts(ONCE_MORE):
        signal.raise_signal(signal.SIGINT)
        done.append("in order")
    assert done == ["in order"]


def test_another_error_keeps_its_name() -> None:
    before = handlers()
    with pytest.raises(ValueError, match="first"), Interrupts(ONCE_MORE):
        signal.raise_signal(signal.SIGINT)
        raise ValueError("first")
    assert handlers() == before


def test_at_once_is_at_once_and_is_not_lost_where_somebody_swallows_it() -> None:
    done = []
    with pytest.raises(KeyboardInterrupt), Interrupts(ONCE_MORE) as interrupts:
        with contextlib.suppress(KeyboardInterrupt), interrupts.immediate():  # as native code does that calls Python
            signal.raise_signal(signal.SIGINT)
            done.append("never")
        done.append("swallowed")
        interrupts.check()
        done.append("never")
    assert done == ["swallowed"]


def test_what_came_before_is_told_at_once() -> None:
    with pytest.raises(KeyboardInterrupt), Interrupts(ONCE_MORE) as interrupts:
        signal.raise_signal(signal.SIGTERM)
        with interrupts.immediate():
            pytest.fail("begun although the end was asked for")


def test_asked_again_it_says_so_and_nothing_more(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(KeyboardInterrupt), Interrupts(ONCE_MORE) as interrupts:
        with contextlib.suppress(KeyboardInterrupt), interrupts.immediate():
            os.kill(os.getpid(), signal.SIGINT)
        assert capfd.readouterr().err == ""
        for _ in range(2):
            signal.raise_signal(signal.SIGINT)
        assert capfd.readouterr().err == 2 * f"\n{ONCE_MORE}\n"
