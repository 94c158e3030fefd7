"""Flow control: a limited number of chunks without answers, and none of them forgotten."""

from hypothesis import given
from hypothesis import strategies as st

from bow_sim.protocol.flow_control import LIMIT_BYTES, RESEND_S, Window


def test_a_chunk_is_under_way_until_it_is_recorded_and_judged() -> None:
    window = Window(limit=1)
    window.sent((0, 0), {"a": b"x"}, 0)
    assert window.full
    assert not window.answered((0, 0), 0, receipted=True)
    assert window.full
    assert window.answered((0, 0), 0, judged=True)
    assert not window.full


def test_a_chunk_whose_streams_are_not_recorded_is_under_way_until_it_is_judged() -> None:
    window = Window(limit=1)
    window.sent((0, 0), {"a": b"x"}, 0, recorded=False)
    assert window.full
    assert window.answered((0, 0), 0, judged=True)
    assert not window.full


def test_bytes_under_way_are_limited_too() -> None:
    window = Window(limit=100)
    large = bytes(LIMIT_BYTES // 2)
    window.sent((0, 0), {"a": large, "b": b"x"}, 0)
    window.sent((0, 0), {"a": large, "b": b"x"}, 0)  # another attempt replaces the one before
    assert not window.full
    window.sent((0, 1), {"a": large}, 0)
    assert window.full
    window.answered((0, 0), 0, receipted=True, judged=True)
    assert not window.full
    window.sent((1, 0), {"a": large, "b": large}, 0)
    assert window.full
    window.drop([1])
    assert not window.full


def test_unanswered_chunks_are_due_again_in_order_and_not_twice_at_once() -> None:
    window = Window()
    for chunk in range(3):
        window.sent((0, chunk), {"a": bytes([chunk])}, 0)
    window.answered((0, 1), 1, receipted=True, judged=True)
    assert window.overdue(1 + RESEND_S / 2) == []
    assert window.overdue(1 + RESEND_S) == [{"a": b"\0"}, {"a": b"\2"}]
    assert window.overdue(1 + 1.5 * RESEND_S) == []


def test_a_block_without_answers_is_sent_again_while_others_get_answers() -> None:
    window = Window()
    window.sent((0, 0), {"a": b"0"}, 0)
    window.sent((1, 0), {"a": b"1"}, 0)
    window.sent((1, 1), {"a": b"2"}, 0)
    window.answered((1, 0), 1.9, receipted=True, judged=True)
    assert window.overdue(RESEND_S) == [{"a": b"0"}]


def test_answers_for_unknown_chunks_change_nothing() -> None:
    window = Window()
    assert not window.answered((3, 3), 0, receipted=True, judged=True)
    assert len(window) == 0


def test_settled_blocks_are_forgotten() -> None:
    window = Window()
    for block in range(3):
        window.sent((block, 0), {"a": b""}, 0)
    window.drop([1])
    assert len(window) == 2
    window.drop()
    assert len(window) == 0


@given(st.lists(st.tuples(st.integers(0, 9), st.booleans(), st.booleans())))
def test_under_way_are_exactly_those_without_both_answers(answers: list[tuple[int, bool, bool]]) -> None:
    window = Window(limit=10)
    state = {chunk: [False, False] for chunk in range(10)}
    for chunk in state:
        window.sent((0, chunk), {"a": b""}, 0)
    for chunk, receipted, judged in answers:
        window.answered((0, chunk), 0, receipted=receipted, judged=judged)
        if not all(state[chunk]):
            state[chunk][0] |= receipted
            state[chunk][1] |= judged
    assert len(window) == sum(not all(answered) for answered in state.values())
