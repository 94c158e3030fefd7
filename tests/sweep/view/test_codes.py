"""Codes of pictures: what a cell's code means, and its colours."""

import numpy as np
import pytest

from bow_classifier.verdict.regimes import REGIMES
from bow_sim.protocol.verdict_fields import PENDING
from bow_sweep.figures.colours import BLACK, GREY, REGIME_COLOURS, transient_colours
from bow_sweep.view.codes import NO_VALUE, Motion, layer_codes, layer_meanings, terrain_meanings

HELMHOLTZ, SLIP = REGIMES.index("helmholtz"), REGIMES.index("multiple_slip")
LENGTHS = np.array([5.0, 100.0, 0.0, np.nan, 40.0, 40.0], np.float32)
CODES = np.array([HELMHOLTZ, SLIP, SLIP, PENDING, PENDING, HELMHOLTZ], np.uint8)


def meaning(motion: Motion, by_regime: bool) -> list:
    known = {each.code: each for each in motion.meanings(by_regime)}
    return [known[code] for code in motion.codes(LENGTHS, CODES, REGIMES).tolist()]


def test_a_code_says_regime_and_transient_length():
    assert [each.label for each in meaning(Motion(REGIMES, 100), by_regime=False)] == [
        "Helmholtz, transient 5 periods",
        "multiple slip, transient 100 periods",
        "multiple slip, no Helmholtz motion",
        "pending",
        "transient 40 periods",  # predicted by an adaptive sweep
        "Helmholtz, transient 40 periods",
    ]


def test_a_transient_of_guettlers_gesture_is_said_as_a_range() -> None:
    motion = Motion(REGIMES, 60, real=True)
    known = {each.code: each.label for each in motion.meanings(by_regime=False)}
    lengths = np.array([0.72, 1.0, 0.004, 59.7, 0.0], np.float32)
    found = motion.codes(lengths, np.full(5, HELMHOLTZ, np.uint8), REGIMES).tolist()
    assert [known[code].partition(", ")[2] for code in found] == [
        "transient 0.5 to 1 periods",
        "transient 0.5 to 1 periods",
        "transient 0 to 0.5 periods",
        "transient 59.5 to 60 periods",
        "no Helmholtz motion",
    ]


def test_one_picture_is_coloured_by_length_and_one_by_regime():
    motion = Motion(REGIMES, 100)
    by_length = [tuple(each.colour) for each in meaning(motion, by_regime=False)]
    shades = [tuple(transient_colours(length, 100).tolist()) for length in (5, 100, 40)]
    assert by_length == [shades[0], shades[1], BLACK, GREY, shades[2], shades[2]]
    by_regime = [tuple(each.colour) for each in meaning(motion, by_regime=True)]
    green, blue = REGIME_COLOURS["helmholtz"], REGIME_COLOURS["multiple_slip"]
    assert by_regime == [green, blue, blue, GREY, GREY, green]


@pytest.mark.parametrize("real", [False, True])
@pytest.mark.parametrize("periods", [5, 100, 1000, 1005, 50_000, 1_000_000])
def test_every_code_of_long_and_short_simulations_has_one_meaning(periods, real):
    motion = Motion(REGIMES, periods, real)
    known = motion.meanings(by_regime=False)
    assert len({each.code for each in known}) == len(known) < 3000
    lengths = np.array([0, 5, periods, np.nan], np.float32)
    for length, code in zip(lengths.tolist(), motion.codes(lengths, CODES[:4], REGIMES).tolist(), strict=True):
        label = next(each.label for each in known if each.code == code)
        if length:
            assert ("pending" if np.isnan(length) else "transient") in label


def test_regimes_are_counted_from_codes():
    motion = Motion(REGIMES, 100)
    counts = motion.of_regimes(motion.codes(LENGTHS, CODES, REGIMES))
    assert (counts[HELMHOLTZ], counts[SLIP], counts[-1], counts.sum()) == (2, 2, 2, 6)


def test_results_of_tests_beyond_the_scale_are_shown_at_its_end():
    values = np.array([5, 15, 400], np.uint16)
    labels = {each.code: each.label for each in layer_meanings("slips")}
    found = layer_codes("slips", values, np.zeros(3, bool)).tolist()
    assert [labels[code] for code in found] == ["5 slips", "15 slips or more", "15 slips or more"]
    labels = {each.code: each.label for each in layer_meanings("correlation")}
    found = layer_codes("correlation", np.array([-0.3, 0.957, np.nan]), np.array([False, False, True])).tolist()
    assert [labels[code] for code in found] == ["correlation 0.00", "correlation 0.96", "pending"]
    assert found[-1] == NO_VALUE


def test_kinds_of_terrain_have_their_names():
    assert [each.label for each in terrain_meanings()][1::2] == ["smooth", "speckle with black", "unknown"]
