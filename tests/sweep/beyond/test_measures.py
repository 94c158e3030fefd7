"""What the claims beyond the paper measure, on records and rows whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from bow_sim.kernel.block import transient
from bow_sim.physics.parameters import Parameters
from bow_sweep.beyond.cells import compute
from bow_sweep.beyond.claim import MET, MISSED, NEAR, REPORTED, Point, verdict_of
from bow_sweep.beyond.claims_linear import loop_roots
from bow_sweep.beyond.formulas import fall_of_friction, greatest_force, least_force, split_frequencies
from bow_sweep.beyond.measures import (
    beat,
    lower_limit,
    rank_correlation,
    right_edge,
    upper_limit,
    wolf_counts,
)
from bow_sweep.maps.limits import guettler_bounds
from bow_sweep.maps.slips import Slips


def test_a_limit_parts_failures_from_successes_with_the_fewest_on_the_wrong_side() -> None:
    forces = np.geomspace(1, 512, 10)
    row = np.array([0, 0, 0, 1, 1, 0, 1, 1, 0, 0], bool)
    assert lower_limit(forces, row) == pytest.approx(np.sqrt(4 * 8))
    assert upper_limit(forces, row) == pytest.approx(np.sqrt(128 * 256))
    lonely = np.array([1, 0, 0, 0, 0, 1, 1, 1, 1, 1], bool)
    assert lower_limit(forces, lonely) == pytest.approx(np.sqrt(16 * 32))


@pytest.mark.parametrize("row", [np.zeros(8, bool), np.ones(8, bool)])
def test_a_row_without_failures_or_without_successes_has_no_lower_limit(row: np.ndarray) -> None:
    assert np.isnan(lower_limit(np.geomspace(1, 128, 8), row))


def test_rank_correlation_is_that_of_the_order_and_ties_share_a_rank() -> None:
    assert rank_correlation([1, 2, 3, 4], [1, 10, 100, 1000]) == pytest.approx(1)
    assert rank_correlation([1, 2, 3, 4], [5, 4, 3, -9]) == pytest.approx(-1)
    assert rank_correlation([1, 1, 2, 3], [1, 2, 3, 4]) == pytest.approx(
        np.corrcoef([1.5, 1.5, 3, 4], [1, 2, 3, 4])[0, 1]
    )


@pytest.mark.parametrize("lag", [9.5, 13.25])
def test_the_beat_of_a_note_that_swells_is_the_time_between_two_swells(lag: float) -> None:
    t = np.arange(200 * 128)
    note = (1 + 0.3 * np.sin(2 * np.pi * t / (lag * 128))) * np.sin(2 * np.pi * t / 128)
    found, clear = beat(note, 128)
    assert found == pytest.approx(lag, abs=1 / 16)
    assert clear > 0.9
    noise = np.random.default_rng(1).normal(size=len(t))
    assert beat(noise, 128)[1] < 0.5


def test_a_right_edge_is_the_line_that_the_region_was_made_with() -> None:
    a, f = np.linspace(0.1, 4, 200), np.linspace(0.5, 4, 40)
    region = (f[:, None] > 1.2 * a + 0.4) & (f[:, None] < 3 * a + 0.4)
    m, c = right_edge(a, f, region)
    assert (m, c) == (pytest.approx(1.2, abs=0.05), pytest.approx(0.4, abs=0.1))
    assert np.isnan(right_edge(a, f, np.zeros_like(region))).all()


def slips(onsets: list[float], slip: float, period: int = 100) -> Slips:
    start = (np.array(onsets) * period).astype(int)
    return Slips(np.zeros(len(start), int), start, start + 10, np.full(len(start), slip))


def test_a_wolf_changes_between_one_slip_and_two() -> None:
    onsets = [float(i) for i in range(150)] + [i + 0.5 for i in range(150) if i % 10 < 4]
    share, mean, changes = wolf_counts(slips(sorted(onsets), 50.0), 100, 150)
    assert (share, mean) == (pytest.approx(0.6), pytest.approx(1.4))
    assert changes == 19
    assert wolf_counts(slips([float(i) for i in range(150)], 50.0), 100, 150)[2] == 0


def test_slips_are_those_of_the_waveform_also_over_the_end_of_a_chunk() -> None:
    p = Parameters(model="delta_cremer", v_mid=0.7, f_asym=5.5, periods=40)
    found = compute(p, {"f_asym": [3.0, 5.5]}).slips.of(1)
    motion = transient(p)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], motion["slipping"].astype(int), [0]])))
    assert found.start.tolist() == edges[::2].tolist()
    assert found.end.tolist() == edges[1::2].tolist()
    assert (found.start // p.chunk_samples != (found.end - 1) // p.chunk_samples).any()
    sums = np.add.reduceat(np.append(1 - motion["v"], 0), edges)[::2]
    assert found.slip == pytest.approx(sums, rel=1e-9)


def test_the_least_force_over_a_dashpot_is_ramans() -> None:
    p = Parameters(bridge_r=25.0, bridge_w_c=0.0)
    z_0, r = 0.5, 25.0 * 0.5
    raman = p.v_b * z_0**2 / (2 * r * p.beta**2 * fall_of_friction(p))
    assert least_force(p) == pytest.approx(raman, rel=0.02)  # 60 terms of the sums
    assert greatest_force(p) == pytest.approx(11.46, abs=0.01)


def test_guettlers_bounds_enclose_a_region_that_shrinks_as_the_bow_nears_the_bridge() -> None:
    spans = [
        high / low
        for low, high in (guettler_bounds(Parameters(period=360, bow_bridge=360 // i)) for i in (6, 8, 10, 12))
    ]
    assert all(span > 1 for span in spans)
    assert spans == sorted(spans, reverse=True)


def test_a_weak_mode_does_not_split_the_note() -> None:
    assert split_frequencies(440, 30, 0.0001) == (440, 440)
    low, high = loop_roots(30, 0.01)
    assert (low, high) == (pytest.approx(422.83, rel=1e-3), pytest.approx(457.17, rel=1e-3))


def test_a_number_is_near_where_it_is_off_by_at_most_the_tolerance_once_more() -> None:
    verdicts = [Point.about("x", found, 10, 2).verdict for found in (8, 12, 12.5, 14, 14.1, float("nan"))]
    assert verdicts == [MET, MET, NEAR, NEAR, MISSED, MISSED]
    assert Point.true("x", False).verdict == MISSED
    assert verdict_of((Point("a", 1, 0, 2), Point("b", 3, 0, 2, 1))) == NEAR
    assert verdict_of((Point("a", 9, 0, 2), Point("b", 3, 0, 2, 1))) == MISSED
    assert verdict_of(()) == REPORTED
