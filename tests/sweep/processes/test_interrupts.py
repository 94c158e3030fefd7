"""Ctrl-C and SIGTERM are noted, and raised only where the program checks for them."""

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
def test_a_signal_is_raised_where_it_is_checked(number: signal.Signals) -> None:
    before, done = handlers(), []
    with pytest.raises(KeyboardInterrupt), Interrupts(ONCE_MORE) as interrupts:
        interrupts.check()
        signal.raise_signal(number)
        done.append("in order")
        interrupts.check()
        done.append("never")
    assert done == ["in order"]
    assert handlers() == before


def test_a_signal_that_was_not_checked_is_raised_at_the_end() -> None:
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


def test_an_immediate_interrupt_is_not_lost_where_its_exception_is_swallowed() -> None:
    done = []
    with pytest.raises(KeyboardInterrupt), Interrupts(ONCE_MORE) as interrupts:
        with contextlib.suppress(KeyboardInterrupt), interrupts.immediate():  # as native code does that calls Python
            signal.raise_signal(signal.SIGINT)
            done.append("never")
        done.append("swallowed")
        interrupts.check()
        done.append("never")
    assert done == ["swallowed"]


def test_a_signal_that_came_before_is_raised_immediately() -> None:
    with pytest.raises(KeyboardInterrupt), Interrupts(ONCE_MORE) as interrupts:
        signal.raise_signal(signal.SIGTERM)
        with interrupts.immediate():
            pytest.fail("begun although a signal had come")


def test_further_signals_print_a_line_and_do_nothing_else(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(KeyboardInterrupt), Interrupts(ONCE_MORE) as interrupts:
        with contextlib.suppress(KeyboardInterrupt), interrupts.immediate():
            os.kill(os.getpid(), signal.SIGINT)
        assert capfd.readouterr().err == ""
        for _ in range(2):
            signal.raise_signal(signal.SIGINT)
        assert capfd.readouterr().err == 2 * f"\n{ONCE_MORE}\n"
