"""What is stored once is answered every time."""

from bow_sim.protocol.cdr import RECEIPT_STREAMS, RECEIPT_VERDICTS, chunk_checksum
from bow_sweep.record.deduplication import MAX_HALVES, Answer, Inventory

WHOLE = chunk_checksum(3, 1, 11, 22)


def test_a_chunk_is_receipted_when_both_its_messages_are_there():
    inventory = Inventory()
    assert inventory.take("bridge_force", 3, 1, 1, 11) == (True, None)
    assert inventory.take("stick_slip", 3, 1, 1, 22) == (True, Answer(RECEIPT_STREAMS, 3, 1, 1, WHOLE))


def test_a_second_attempt_is_answered_once_as_the_first_was():
    inventory = Inventory()
    for topic, checksum in (("bridge_force", 11), ("stick_slip", 22)):
        inventory.take(topic, 3, 1, 1, checksum)
    assert inventory.take("stick_slip", 3, 1, 2, 22) == (False, None)
    assert inventory.take("bridge_force", 3, 1, 2, 11) == (False, Answer(RECEIPT_STREAMS, 3, 1, 2, WHOLE))
    assert inventory.duplicates == 2
    assert not inventory.contradictions


def test_an_attempt_that_is_sent_again_is_answered_again():
    inventory = Inventory()
    for _ in range(3):
        inventory.take("bridge_force", 3, 1, 1, 11)
        assert inventory.take("stick_slip", 3, 1, 1, 22)[1] == Answer(RECEIPT_STREAMS, 3, 1, 1, WHOLE)


def test_halves_of_two_attempts_make_a_chunk_and_each_attempt_has_its_answer():
    inventory = Inventory()
    inventory.take("bridge_force", 3, 1, 1, 11)  # then its simulator dies
    assert inventory.take("stick_slip", 3, 1, 2, 22) == (True, Answer(RECEIPT_STREAMS, 3, 1, 2, WHOLE))
    assert inventory.take("stick_slip", 3, 1, 1, 22)[1] == Answer(RECEIPT_STREAMS, 3, 1, 1, WHOLE)


def test_interleaved_attempts_are_both_answered():
    inventory = Inventory()
    inventory.take("bridge_force", 3, 1, 1, 11)
    inventory.take("bridge_force", 3, 1, 2, 11)
    assert inventory.take("stick_slip", 3, 1, 1, 22)[1].attempt == 1
    assert inventory.take("stick_slip", 3, 1, 2, 22)[1].attempt == 2


def test_a_duplicate_with_another_checksum_is_answered_with_what_is_stored():
    inventory = Inventory()
    inventory.take("bridge_force", 3, 1, 1, 11)
    inventory.take("stick_slip", 3, 1, 1, 22)
    inventory.take("bridge_force", 3, 1, 2, 99)
    new, answer = inventory.take("stick_slip", 3, 1, 2, 22)
    assert (new, answer.checksum) == (False, WHOLE)
    assert inventory.contradictions == {("bridge_force", 3, 1): 1}


def test_verdicts_are_receipted_one_by_one():
    inventory = Inventory()
    assert inventory.take("verdicts", 3, 1, 1, 5) == (True, Answer(RECEIPT_VERDICTS, 3, 1, 1, 5))
    assert inventory.take("verdicts", 3, 1, 2, 6) == (False, Answer(RECEIPT_VERDICTS, 3, 1, 2, 5))
    assert inventory.contradictions == {("verdicts", 3, 1): 1}


def test_made_up_attempts_do_not_pile_up():
    inventory = Inventory()
    for attempt in range(3 * MAX_HALVES):
        inventory.take("bridge_force", 3, 1, attempt, 11)
    assert len(inventory._halves) == MAX_HALVES
