"""A wolf is a beat of many periods between one slip a period and more; nothing shorter and nothing irregular is one."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from kinematics import GEOMETRY, HEIGHT, N, Record, chunks
from wolves import PERIOD, string_of_1983, wolf

from bow_classifier.block_classifier import BlockClassifier
from bow_classifier.features.wolf import MEMORY, STEPS, WolfState, _highest, wolf_workspace
from bow_classifier.verdict.regimes import REGIMES, WOLF
from bow_classifier.verdict.thresholds import Thresholds
from bow_sweep.maps.in_process import verdicts

PERIODS = 200


def beating(beat: float, ones: float = 0.5, periods: int = PERIODS, noise: float = 0.0) -> Record:
    """Return a note whose force swells and fades; in a share `ones` of each beat it has one slip a period, else two."""
    t = np.arange(periods * N)
    place = t / N / beat % 1.0
    swell = 1.0 + 0.4 * np.cos(2 * np.pi * place)
    force = HEIGHT * (0.5 - t / N % 1.0) * swell
    force += noise * HEIGHT * np.random.default_rng(1).normal(size=len(t))
    slips = []
    for period in range(1, periods):
        both = (period / beat % 1.0) >= ones
        slips += [(period * N + 20, 10, 0.5 * N)] + [(period * N + 80, 10, 0.5 * N)] * both
    return Record(force, slips)


def last(records, periods=PERIODS, thresholds=None, classifier=None):
    """Return the verdicts at the end."""
    classifier = classifier or BlockClassifier(GEOMETRY, thresholds or Thresholds(), len(records), periods=periods)
    for chunk in chunks(records):
        found = classifier.classify(*chunk)
    return found


def test_the_beat_is_found_in_periods():
    beats = (5.0, 8.3, 12.0, 21.7)
    found = last([beating(beat) for beat in beats])
    assert [REGIMES[code] for code in found.regime] == ["wolf"] * len(beats)
    assert found.beat == pytest.approx(beats, abs=0.15)  # a sum of fewer terms is less: a long beat seems shorter
    assert (found.confidence > 0.9).all()
    assert np.isnan(found.transient).all()


@pytest.mark.parametrize(
    ("record", "thresholds", "why"),
    [
        (beating(12, ones=1.0), {}, "one slip in every period"),
        (beating(12, ones=0.0), {}, "two in every period"),
        (beating(12, ones=0.95), {}, "two in less than a tenth"),
        (beating(45, ones=0.5), {}, "changes four times only"),
        (beating(3.0), {}, "comes back after three periods: a subharmonic"),
        (beating(12), {"wolf_changes": 20}, "changes 16 times, where 20 are asked for"),
        (beating(12), {"wolf_share": 0.45, "slip": 0.6}, "no slip is significant"),
        (beating(12, noise=20.0), {}, "the force does not come back"),
        (beating(12), {"wolf_beat": 0.95}, "the autocorrelation is divided by that of the whole record: at most 0.88"),
    ],
)
def test_what_lacks_one_of_the_three_is_no_wolf(record, thresholds, why):
    found = last([record], thresholds=Thresholds(**thresholds))
    assert found.regime[0] != WOLF, why
    assert np.isnan(found.beat[0])


def test_a_run_of_less_than_150_periods_has_no_wolf_and_no_memory():
    records = [beating(12, periods=145)]
    short = BlockClassifier(GEOMETRY, Thresholds(), 1, periods=145)
    assert short._state.wolf.power.size == short._state.wolf.counts.size == 0
    assert np.isnan(last(records, classifier=short).beat).all()
    assert last([beating(12, periods=150)], periods=150).beat[0] == pytest.approx(12, abs=1 / STEPS)


def test_before_150_periods_nothing_is_called_a_wolf_and_the_other_names_are_those_of_a_short_run():
    record = beating(12)
    long, short = (BlockClassifier(GEOMETRY, Thresholds(), 1, periods=n) for n in (PERIODS, 0))
    for number, chunk in enumerate(chunks([record]), 1):
        one, other = long.classify(*chunk), short.classify(*chunk)
        assert (one.regime[0] == WOLF) == (5 * number >= 150)
        for name in ("correlation", "period", "slips", "corners"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
        if 5 * number < 150:
            assert (one.regime, one.confidence) == (other.regime, other.confidence)


def test_a_cell_among_others_is_as_it_is_alone():
    records = [beating(5.0 + i, ones=0.3 + 0.02 * i, noise=0.1) for i in range(11)]
    together = last(records)
    for i, record in enumerate(records):
        alone = last([record])
        assert all(getattr(alone, name)[0].tobytes() == getattr(together, name)[i].tobytes() for name in alone._fields)


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_beat_share_and_changes_are_those_of_the_definition(noise):
    for beat in (6.7, 11.0, 33.0):
        record = beating(beat, noise=noise)
        force = np.asarray(record.bridge_force, np.float32)
        share, changes, slow, height = wolf(force, [on + n for on, n, _ in record.slips], N, PERIODS * N)
        assert 0.1 < share < 0.9
        found = last([record], thresholds=Thresholds(wolf_beat=height - 1e-3, wolf_changes=changes))
        assert found.beat[0] == pytest.approx(slow, abs=1 / STEPS)
        for stricter in ({"wolf_beat": min(height + 1e-3, 1)}, {"wolf_changes": changes + 0.5}):
            assert np.isnan(last([record], thresholds=Thresholds(**stricter)).beat[0])


def test_sums_that_are_left_out_are_never_the_highest():
    rng = np.random.default_rng(3)
    workspace = wolf_workspace(WolfState.empty(1, 5), N)
    count = STEPS * (MEMORY - 1) + 1
    found = set()
    for beat, clear, noise in itertools.product((4.5, 9.3, 17.0, 41.0, 70.0), (0.0, 0.5, 0.7, 0.9), (0.0, 0.2, 2.0)):
        t = np.arange(count) / STEPS
        signal = (
            np.sin(2 * np.pi * t / beat + rng.uniform(0, 6)) * rng.uniform(0.2, 1, count // 8 + 1).repeat(8)[:count]
        )
        x = signal + noise * np.convolve(rng.normal(size=count), np.ones(STEPS) / STEPS, "same")
        workspace.x[:] = 0.0
        workspace.x[:count] = x - x.mean()
        height, lag = _highest(
            workspace.x, count, count // 2, clear, workspace.products, workspace.means, workspace.coarse
        )
        sums = np.correlate(workspace.x[:count], workspace.x[:count], "full")[count - 1 :][: count // 2]
        beyond = np.logical_or.accumulate(sums < 0.0)
        best = int(np.argmax(np.where(beyond, sums, -np.inf)))
        is_clear = beyond[best] and sums[best] > clear * sums[0]
        assert lag == (best if is_clear else -1)
        assert not is_clear or height == pytest.approx(sums[best])
        found.add(lag >= 0)
    assert found == {True, False}


FORCES = (1.6, 2.0, 2.4, 2.9, 3.4, 4.0, 4.6)
BEATS = (10.6, 11.0, 12.0, 13.5, 16.5)
"""Of the forces 2.0 ... 4.0: PHYSICS.md section 16."""


def test_the_wolf_of_1983_and_its_beat():
    *_, found = verdicts(string_of_1983(0.02, 30), {"f_asym": FORCES})
    assert [REGIMES[code] for code in found.regime] == ["multiple_slip", *["wolf"] * 5, "helmholtz"]
    assert np.isnan(found.beat[[0, -1]]).all()
    assert found.beat[1:-1] == pytest.approx(BEATS, abs=0.15)


@pytest.mark.full
def test_a_weaker_coupling_with_less_loss_beats_more_slowly():
    forces = (1.2, 1.4, 1.6, 2.0, 2.5, 3.0, 3.3, 3.6)
    *_, found = verdicts(string_of_1983(0.01, 50), {"f_asym": forces})
    assert [REGIMES[code] for code in found.regime] == ["multiple_slip", *["wolf"] * 6, "helmholtz"]
    assert (np.diff(found.beat[1:-1]) > 0).all()
    assert found.beat[[1, 6]] == pytest.approx([14.2, 22.0], abs=0.3)


@pytest.mark.full
def test_the_beat_of_the_force_is_that_of_the_bridges_velocity():
    """The velocity is heard, but no stream: the classifier has the force."""
    from bow_sim.kernel.block import Block

    parameters = string_of_1983(0.02, 30)
    block = Block(parameters, {"f_asym": np.array(FORCES)}, trace=True)
    velocity = block.trace_names.index("bridge_velocity")
    parts = []
    for _ in range(parameters.chunks):
        block.advance()
        assert block.traces is not None
        parts.append(block.traces[velocity, :, : len(FORCES)].T.copy())
    *_, found = verdicts(parameters, {"f_asym": FORCES})
    for i, whole in enumerate(np.concatenate(parts, axis=1)):
        if FORCES[i] in FORCES[1:-1]:
            _, _, beat, height = wolf(whole, [0], PERIOD, parameters.samples, smooth=False)
            assert found.beat[i] == pytest.approx(beat, abs=0.1)
            assert height > 0.8


@pytest.mark.full
@pytest.mark.parametrize("model", ["delta_cremer", "stiff_cremer"])
@pytest.mark.parametrize("v_mid", [0.9, 0.2, -2.0])
def test_the_papers_models_have_no_wolf(model, v_mid):
    from bow_sim.physics.parameters import Parameters

    force, ratio = (grid.ravel() for grid in np.meshgrid(np.geomspace(0.3, 20, 8), [0.25, 4.0]))
    seen = np.zeros(16, bool)
    for found in verdicts(Parameters(model=model, v_mid=v_mid, periods=200), {"f_asym": force, "f_init_ratio": ratio}):
        seen |= found.regime == WOLF
    assert not seen.any()
