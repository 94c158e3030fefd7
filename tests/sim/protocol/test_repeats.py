"""Repeats of cells: deviations are the same everywhere and in any order, lanes of a repeat are within the jitter."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from outlines import outline

from bow_sim.block_request import prepare
from bow_sim.kernel.block import Block
from bow_sim.physics.errors import ParameterError
from bow_sim.protocol.repeats import F_ASYM, F_INIT, MAX_SEED, Repeats, deviations
from bow_sweep.plan.sweep import Sweep

RUN = "0123456789abcdef"
ALL = (1 << 64) - 1


def by_hand(seed: int, cell: int, repeat: int, force: int) -> float:
    """The hash of PHYSICS.md section 15, in Python's own whole numbers."""
    hashed = 0
    for key in (seed, cell, repeat, force):
        hashed = splitmix((hashed + key) & ALL)
    return (hashed >> 11) / 2**52 - 1


def splitmix(state: int) -> int:
    z = (state + 0x9E3779B97F4A7C15) & ALL
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & ALL
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & ALL
    return z ^ (z >> 31)


def test_the_hash_by_hand_is_splitmix64() -> None:
    # the first number that the authors' program (Steele, Lea, Flood 2014) gives from state 0
    assert splitmix(0) == 0xE220A8397B1DCDAF


@given(st.integers(0, MAX_SEED), st.integers(0, (1 << 22) - 1), st.integers(1, 1 << 20), st.sampled_from([0, 1]))
def test_deviations_are_those_of_plain_whole_numbers(seed: int, cell: int, repeat: int, force: int) -> None:
    (value,) = deviations(seed, [cell], [repeat], force).tolist()
    assert value == by_hand(seed, cell, repeat, force)
    assert -1 <= value < 1


def test_deviations_have_known_values() -> None:
    found = deviations(0, [0, 1, 2], [1, 1, 1], F_ASYM)
    assert found.tolist() == [by_hand(0, cell, 1, F_ASYM) for cell in range(3)]
    assert found == pytest.approx([-0.2293418346274445, -0.560752229427155, -0.8958757291062482], abs=1e-15)


def test_deviations_are_uniform_and_those_of_the_two_forces_differ() -> None:
    cells = np.arange(20_000)
    first, second = (deviations(7, cells, np.full(len(cells), 3), force) for force in (F_ASYM, F_INIT))
    counts = np.histogram(first, bins=20, range=(-1, 1))[0]
    assert abs(counts - 1000).max() < 150
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.03
    assert abs(np.corrcoef(first[1:], first[:-1])[0, 1]) < 0.03


AXES = {
    "the paper's": [],
    "the force is no axis": ["x.name=v_mid", "x.scale=linear", "x.first=-1", "x.last=0.5", "f_asym=7"],
    "newton": [
        *("string=cello_g_b", "v_unit=0.1", "x.name=beta", "x.first=0.06", "x.last=0.2"),
        *("y.name=force", "y.first=0.2", "y.last=4", "y.scale=log"),
    ],
    "an accelerated bow": [
        *("gesture=guettler", "x.name=acceleration", "x.first=0.1", "x.last=1"),
        *("y.name=f_asym", "y.first=1", "y.last=4"),
    ],
}


@settings(deadline=None, max_examples=60)
@given(
    st.sampled_from(sorted(AXES)),
    st.integers(0, 5),
    st.sampled_from([0.0, 1e-6, 0.01, 0.9]),
    st.integers(0, MAX_SEED),
    st.randoms(use_true_random=False),
)
def test_sweep_and_outline_agree_on_repeats_and_lanes_stay_within_the_jitter(axes, count, jitter, seed, random) -> None:
    extra = [f"repeats={count}", f"jitter={jitter}", f"seed={seed}", "x.count=4", "y.count=3", "block_cells=5"]
    sweep = Sweep.from_spec("", [*AXES[axes], *extra])
    found = outline(RUN, "f" * 16, sweep.settings())
    assert (found.cells, found.plane_cells, found.shape) == (sweep.cells, 12, (3, 4))
    assert sweep.cells == 12 * (1 + count) == sum(len(found.block(block)) for block in range(found.blocks))
    assert (found.repeats, found.blocks) == (sweep.repeats, sweep.blocks)
    assert Sweep.from_spec("", sweep.settings()) == sweep
    cells = np.array(random.sample(range(sweep.cells), 12))
    lanes = sweep.lanes(cells)
    whole = sweep.lanes(np.arange(sweep.cells))
    for name, values in lanes.items():
        assert values.tobytes() == found.lanes(cells)[name].tobytes() == whole[name][cells].tobytes()
    originals = outline(RUN, "f" * 16, Sweep.from_spec("", [*AXES[axes], "x.count=4", "y.count=3"]).settings())
    for name in ("f_asym", "f_init_ratio", "v_b", "bow_bridge", "acceleration", "v_mid"):
        base, own = originals.values(name, cells % 12), found.values(name, cells)
        if name not in ("f_asym", "f_init_ratio"):
            assert own.tobytes() == base.tobytes()
            continue
        assert own[cells < 12].tobytes() == base[cells < 12].tobytes()
    asym, of_asym = found.values("f_asym", cells), originals.values("f_asym", cells % 12)
    init = asym * found.values("f_init_ratio", cells)
    of_init = of_asym * originals.values("f_init_ratio", cells % 12)
    for changed, base, force in ((asym, of_asym, F_ASYM), (init, of_init, F_INIT)):
        r = [by_hand(seed, cell % 12, cell // 12, force) if cell >= 12 else 0.0 for cell in cells.tolist()]
        np.testing.assert_allclose(changed, base * (1 + jitter * np.array(r)), rtol=1e-12)


def test_a_simulator_computes_a_repeat_as_the_sweep_asks_and_nothing_beyond_the_last_one() -> None:
    sweep = Sweep.from_spec("", ["x.count=3", "y.count=2", "repeats=2", "jitter=0.05", "periods=5", "model=raman"])
    cells = np.array([17, 2, 8])
    at = sweep.axis_values(cells)
    message = {"cells": cells, "x": at["f_asym"], "y": at["f_init_ratio"], "spec.settings": sweep.settings()}
    made = prepare(message).block.advance().bridge_force
    assert made.tobytes() == Block(sweep.parameters, sweep.lanes(cells)).advance().bridge_force.tobytes()
    assert made[0].tobytes() != made[1].tobytes() != made[2].tobytes()  # all three are one cell of the plane
    assert len(set((cells % 6).tolist())) == 2
    with pytest.raises(ParameterError, match=r"cells: should be different ones out of 0 \.\.\. 17"):
        prepare({**message, "cells": np.array([18, 2, 8])})


def test_without_repeats_settings_and_lanes_are_as_before() -> None:
    sweep = Sweep.from_spec("fig11d", ["x.count=4", "y.count=2", "repeats=0", "jitter=0.3"])
    assert sweep == Sweep.from_spec("fig11d", ["x.count=4", "y.count=2"])
    assert not [line for line in sweep.settings() if line.startswith(("repeats", "jitter", "seed"))]
    assert list(sweep.lanes(np.arange(8))) == ["f_asym", "f_init_ratio"]
    assert Repeats().factors(np.arange(8), 8)[0].tolist() == [1.0] * 8


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        (["repeats=-1"], "repeats = -1: should be 0"),
        (["repeats=two"], "repeats = 'two': should be a whole number"),
        (["repeats=2", "jitter=1"], "jitter = 1: should be at least 0 and less than 1"),
        (["repeats=2", "jitter=nan"], "jitter = nan: should be at least 0"),
        (["jitter=0.01"], "jitter = 0.01: says how cells are repeated; give repeats too"),
        (["seed=3"], "seed = 3: says how cells are repeated; give repeats too"),
        (["repeats=2", "seed=-1"], f"seed = -1: should be 0 ... {MAX_SEED}"),
        (["repeats=2", "adaptive=0.5"], "repeats = 2: adaptive = 0.5 leaves cells out"),
        (["repeats=600"], "repeats = 600: 4923392 cells in all; should be at most 511 for this plane"),
        (["repeats=500", "periods=500"], "periods = 500: 4104192 cells with 100 tests each"),
        (["repeats=2", "jitter=0.1", "x.last=1e6"], "jitter = 0.1: at x.last and y.first, with the largest deviation"),
    ],
)
def test_repeats_that_cannot_be_are_refused(given: list[str], reason: str) -> None:
    with pytest.raises(ParameterError) as error:
        Sweep.from_spec("", given)
    assert str(error.value).startswith(reason)
