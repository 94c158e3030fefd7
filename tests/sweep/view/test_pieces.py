"""Which samples are recorded, and what can be drawn next."""

from __future__ import annotations

import numpy as np
from hypothesis import given, strategies

from bow_sweep.view.pieces import Pieces

CHUNK, CHUNKS = 5, 8


def chunk(number: int) -> np.ndarray:
    return np.arange(number * CHUNK, (number + 1) * CHUNK, dtype=float)


@given(strategies.lists(strategies.one_of(strategies.integers(0, CHUNKS - 1), strategies.none()), max_size=30))
def test_whatever_comes_in_whatever_order_every_sample_is_recorded_once(arrivals: list[int | None]) -> None:
    pieces, recorded = Pieces(), []
    for number in arrivals:
        if number is None:
            drawn = [piece for found in pieces.ready().values() for piece in found]
            after = [recorded[-1]] if recorded else []
            starts = [piece.first for piece in drawn]
            assert starts == [*range(starts[0], starts[0] + CHUNK * len(starts), CHUNK)] if starts else True
            assert not (after and drawn) or starts[0] == after[0] + 1  # it continues
            recorded += [int(sample) for piece in drawn for sample in piece.force]
        else:
            pieces.take(7, number * CHUNK, chunk(number))
    came = {number for number in arrivals if number is not None}
    gaps = {n for first, end in pieces.missing(7, CHUNKS * CHUNK) for n in range(first // CHUNK, end // CHUNK)}
    assert gaps == set(range(CHUNKS)) - came
    for found in pieces.rest().values():
        for piece, after_gap in found:
            assert after_gap == (piece.first > 0 and piece.first - 1 not in recorded)
            recorded += [int(sample) for sample in piece.force]
    assert sorted(recorded) == sorted(
        sample for number in came for sample in range(number * CHUNK, (number + 1) * CHUNK)
    )


def test_samples_of_an_earlier_recording_are_not_taken_again() -> None:
    pieces = Pieces()
    pieces.recall(7, np.array([5, 6, 7, 8, 9, 15, 16, 17, 18, 19]))
    for number in (1, 2, 3):
        pieces.take(7, number * CHUNK, chunk(number))
    assert pieces.missing(7, 25) == [(0, 5), (20, 25)]
    assert [piece.first for piece, _ in pieces.rest()[7]] == [10]
