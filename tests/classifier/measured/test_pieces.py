"""A live signal is cut into the chunks that a whole recording gives."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from measured import BETA, F0, RATE, blocks, played
from scipy.signal import resample_poly

from bow_classifier.measured.pieces import Pieces, Resampler
from bow_classifier.measured.tuning import Given, tune


@pytest.mark.parametrize("share", [Fraction(139, 151), Fraction(556, 245), Fraction(1, 2), Fraction(1)], ids=str)
def test_blocks_are_resampled_as_the_whole_is(share: Fraction) -> None:
    chance = np.random.default_rng(4)
    wave = np.cumsum(chance.normal(size=9000))
    resampler, parts, first = Resampler(share), [], 0
    while first < len(wave):
        length = int(chance.integers(1, 900))
        parts.append(resampler.take(wave[first : first + length]))
        first += length
    parts.append(resampler.take(np.zeros(0), last=True))
    whole = resample_poly(wave, share.numerator, share.denominator, padtype="line")
    found = np.concatenate(parts)
    assert len(found) == len(whole)
    assert np.abs(found - whole).max() < 0.02 * np.std(wave)


def test_chunks_do_not_depend_on_the_blocks_in_which_they_came() -> None:
    wave = played(0.4)
    tuning, _ = tune(wave, Given(RATE, F0, BETA))
    at_once = Pieces(tuning)
    whole = [*at_once.take(wave), *at_once.take(np.zeros(0), last=True)]
    bit_by_bit = Pieces(tuning)
    parts = [piece for block, _ in blocks(wave, 77) for piece in bit_by_bit.take(block)]
    parts += bit_by_bit.take(np.zeros(0), last=True)
    assert len(whole) == len(parts) == int(0.4 * F0 - tuning.start / tuning.period) // 5
    for one, other in zip(whole, parts, strict=True):
        assert one.force == pytest.approx(other.force, abs=0.02)
        assert one.slips.duration.tolist() == other.slips.duration.tolist()
        assert len(one.slips.duration) == 5
    assert {np.sign(piece.bow_speed) for piece in parts} == {tuning.sign}
    assert tune(-wave, Given(RATE, F0, BETA))[0].sign == -tuning.sign
