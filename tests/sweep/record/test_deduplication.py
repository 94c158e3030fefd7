"""What is stored once is answered every time."""

from bow_sim.protocol.cdr import chunk_checksum
from bow_sim.protocol.states import ReceiptKind
from bow_sweep.record.deduplication import MAX_HALVES, Answer, StoredMessages

WHOLE = chunk_checksum(3, 1, 11, 22)


def test_a_chunk_is_receipted_when_both_its_messages_are_there():
    stored = StoredMessages()
    assert stored.take("bridge_force", 3, 1, 1, 11) == (True, None)
    assert stored.take("stick_slip", 3, 1, 1, 22) == (True, Answer(ReceiptKind.STREAMS, 3, 1, 1, WHOLE))


def test_a_second_attempt_is_answered_once_as_the_first_was():
    stored = StoredMessages()
    for topic, checksum in (("bridge_force", 11), ("stick_slip", 22)):
        stored.take(topic, 3, 1, 1, checksum)
    assert stored.take("stick_slip", 3, 1, 2, 22) == (False, None)
    assert stored.take("bridge_force", 3, 1, 2, 11) == (False, Answer(ReceiptKind.STREAMS, 3, 1, 2, WHOLE))
    assert stored.duplicates == 2
    assert not stored.contradictions


def test_an_attempt_that_is_sent_again_is_answered_again():
    stored = StoredMessages()
    for _ in range(3):
        stored.take("bridge_force", 3, 1, 1, 11)
        assert stored.take("stick_slip", 3, 1, 1, 22)[1] == Answer(ReceiptKind.STREAMS, 3, 1, 1, WHOLE)


def test_halves_of_two_attempts_make_a_chunk_and_each_attempt_has_its_answer():
    stored = StoredMessages()
    stored.take("bridge_force", 3, 1, 1, 11)  # then its simulator dies
    assert stored.take("stick_slip", 3, 1, 2, 22) == (True, Answer(ReceiptKind.STREAMS, 3, 1, 2, WHOLE))
    assert stored.take("stick_slip", 3, 1, 1, 22)[1] == Answer(ReceiptKind.STREAMS, 3, 1, 1, WHOLE)


def test_interleaved_attempts_are_both_answered():
    stored = StoredMessages()
    stored.take("bridge_force", 3, 1, 1, 11)
    stored.take("bridge_force", 3, 1, 2, 11)
    assert stored.take("stick_slip", 3, 1, 1, 22)[1].attempt == 1
    assert stored.take("stick_slip", 3, 1, 2, 22)[1].attempt == 2


def test_a_duplicate_with_another_checksum_is_answered_with_what_is_stored():
    stored = StoredMessages()
    stored.take("bridge_force", 3, 1, 1, 11)
    stored.take("stick_slip", 3, 1, 1, 22)
    stored.take("bridge_force", 3, 1, 2, 99)
    new, answer = stored.take("stick_slip", 3, 1, 2, 22)
    assert (new, answer.checksum) == (False, WHOLE)
    assert stored.contradictions == {("bridge_force", 3, 1): 1}


def test_verdicts_are_receipted_one_by_one():
    stored = StoredMessages()
    assert stored.take("verdicts", 3, 1, 1, 5) == (True, Answer(ReceiptKind.VERDICTS, 3, 1, 1, 5))
    assert stored.take("verdicts", 3, 1, 2, 6) == (False, Answer(ReceiptKind.VERDICTS, 3, 1, 2, 5))
    assert stored.contradictions == {("verdicts", 3, 1): 1}


def test_made_up_attempts_do_not_pile_up():
    stored = StoredMessages()
    for attempt in range(3 * MAX_HALVES):
        stored.take("bridge_force", 3, 1, attempt, 11)
    assert len(stored._halves) == MAX_HALVES
