"""The kernel agrees with the plain scalar string bit for bit, whatever cells it computes together."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scalar_string import intervals, simulate
from sources import made_of

from bow_sim.kernel.block import TRACES, Block, transient
from bow_sim.kernel.sources import SOURCES
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import GESTURES, MODELS, Parameters

MAIN = ("delta_cremer", "stiff_cremer")


def run(p, lanes, chunks):
    """Chunks of a block, one after another."""
    block = Block(p, lanes)
    return [block.advance() for _ in range(chunks)]


def slips_of(results, cell):
    """The intervals of one cell: (chunk, onset, duration, slip)."""
    return [
        (number, int(r.onset[k]), int(r.duration[k]), float(r.slip[k]))
        for number, r in enumerate(results)
        for k in range(r.offsets[cell], r.offsets[cell + 1])
    ]


def same_cell(results, cell, others, other):
    """Whether two cells of two runs agree in every bit of every stream."""
    for a, b in zip(results, others, strict=True):
        x, y = slice(*a.offsets[cell : cell + 2]), slice(*b.offsets[other : other + 2])
        if not (
            a.bridge_force[cell].tobytes() == b.bridge_force[other].tobytes()
            and a.slipping[cell] == b.slipping[other]
            and all(getattr(a, n)[x].tobytes() == getattr(b, n)[y].tobytes() for n in ("onset", "duration", "slip"))
        ):
            return False
    return True


@pytest.mark.parametrize("model", MAIN)
@pytest.mark.parametrize(("f_asym", "ratio", "lanes"), [(5.5, 1.0, 1), (1.1, 0.0, 3), (17.0, 1.9, 127)])
def test_a_whole_simulation_agrees_with_the_scalar_string_bit_for_bit(model, f_asym, ratio, lanes):
    p = Parameters(model=model, f_asym=f_asym, f_init_ratio=ratio)
    want = simulate(p, p.samples)
    place = lanes // 2
    forces = np.linspace(0.5, 20.0, lanes)
    forces[place] = f_asym
    results = run(p, {"f_asym": forces, "f_init_ratio": np.full(lanes, ratio)}, p.chunks)
    force = np.concatenate([r.bridge_force[place] for r in results])
    assert force.tobytes() == want["bridge_force"].astype(np.float32).tobytes()
    assert slips_of(results, place) == intervals(want["slipping"], want["s"], p.chunk_samples)


@pytest.mark.parametrize("model", MODELS)
def test_every_waveform_of_a_transient_agrees_with_the_scalar_string_bit_for_bit(model):
    p = Parameters(model=model, f_asym=1.4, f_init_ratio=1.7, v_mid=-0.5, periods=10)
    got, want = transient(p), simulate(p, p.samples)
    assert tuple(got) == TRACES
    for name in TRACES:
        assert got[name].tobytes() == want[name].tobytes(), name
        assert got[name].dtype == (bool if name == "slipping" else np.float64)


@pytest.mark.parametrize("gesture", GESTURES)
def test_every_gesture_agrees_with_the_scalar_string_bit_for_bit(gesture):
    p = Parameters(gesture=gesture, f_asym=3.0, f_init_ratio=1.5, bow_bridge=4, v_b=1.25, tau_v=120.0, periods=10)
    got, want = transient(p), simulate(p, p.samples)
    for name in TRACES:
        assert got[name].tobytes() == want[name].tobytes(), name


@pytest.mark.parametrize(("f_asym", "onset"), [(5.5, 2224), (5.3, 2922)])
def test_the_transients_of_figures_5_and_8_become_regular_where_they_should(f_asym, onset):
    p = Parameters(model="delta_cremer", v_mid=0.7, f_asym=f_asym, f_init_ratio=1.0)
    slipping = transient(p)["slipping"]
    onsets = np.flatnonzero(slipping & ~np.concatenate([[False], slipping[:-1]]))
    irregular = np.flatnonzero(np.abs(np.diff(onsets) - p.period) > 5)
    assert onsets[irregular[-1] + 1] == onset


def test_the_transients_of_figures_5_and_8_part_in_one_decision():
    a, b = (transient(Parameters(model="delta_cremer", v_mid=0.7, f_asym=f)) for f in (5.5, 5.3))
    parting = int(np.flatnonzero(a["slipping"] != b["slipping"])[0])
    assert np.max(np.abs(a["v"] - b["v"])[:parting]) < 0.5 < np.max(np.abs(a["v"] - b["v"])[parting : parting + 139])


@pytest.mark.parametrize("model", MAIN)
def test_a_cell_does_not_depend_on_its_lane_its_neighbours_or_their_number(model):
    rng = np.random.default_rng(3)
    p = Parameters(model=model)
    lanes = {
        "f_asym": rng.uniform(0.5, 20, 30),
        "f_init_ratio": rng.uniform(0, 2, 30),
        "v_mid": rng.uniform(-2, 0.9, 30),
    }
    results = run(p, lanes, 4)
    for cell in (0, 7, 8, 23, 29):
        alone = run(p, {name: values[[cell]] for name, values in lanes.items()}, 4)
        assert same_cell(results, cell, alone, 0)
    order = rng.permutation(30)[:13]
    shuffled = run(p, {name: values[order] for name, values in lanes.items()}, 4)
    assert all(same_cell(results, cell, shuffled, place) for place, cell in enumerate(order))


SWEEPS = {
    "bow position": ("stiff_cremer", {"bow_bridge": np.array([30, 110, 5, 15, 69, 9, 4, 16, 15, 70.0])}),
    "stiffness": ("stiff_cremer", {"stiffness_b": np.geomspace(1e-6, 1e-3, 10)}),
    "anti-alias filter": (
        "stiff_cremer",
        {"nut_cutoff": np.linspace(0.3, 0.6, 10), "nut_power": np.linspace(3, 6, 10)},
    ),
    "bridge": ("delta_cremer", {"bridge_r": np.geomspace(2, 200, 10), "bridge_w_c": np.geomspace(0.5, 20, 10)}),
    "torsion": ("delta_cremer", {"torsion_speed": np.linspace(2, 5, 10), "torsion_width": np.linspace(0.5, 3, 10)}),
    "admittances": ("stiff_cremer", {"torsion_admittance": np.linspace(0, 2, 10), "y_t": np.linspace(1, 3, 10)}),
    "losses": ("raman", {"bridge_gain": np.linspace(0.5, 1, 10), "nut_gain": np.linspace(0.8, 1, 10)}),
    "corner": ("rounded_corner", {"corner_width": np.linspace(0.6, 2.5, 10), "torsion_half": np.arange(4, 14.0)}),
    "friction": ("delta_cremer", {"mu_s": np.linspace(0.5, 1, 10), "mu_d": np.linspace(0, 0.45, 10)}),
    "time constants": ("stiff_cremer", {"tau_f": np.geomspace(5, 5000, 10), "v_b": np.linspace(0.5, 2, 10)}),
}


@pytest.mark.parametrize("what", SWEEPS)
def test_any_number_may_differ_between_the_cells_of_a_block(what):
    model, lanes = SWEEPS[what]
    p = Parameters(model=model, f_asym=2.5, v_mid=0.1, periods=15)
    results = run(p, lanes, 3)
    for cell in (0, 4, 9):
        own = p.replace(**{name: float(values[cell]) for name, values in lanes.items()})
        assert same_cell(results, cell, run(own, {"f_asym": [2.5]}, 3), 0)
        assert results[0].bridge_force[cell].tobytes() != results[0].bridge_force[(cell + 5) % 10].tobytes()


def test_cells_that_the_kernel_computes_in_another_order_keep_their_places():
    positions = np.repeat([20.0, 5.0, 40.0, 11.0], 4)
    forces = np.geomspace(0.5, 20.0, 16)
    p, order = Parameters(model="stiff_cremer", periods=15), np.argsort(positions, kind="stable")
    mixed, by_position = (
        run(p, {"bow_bridge": positions[some], "f_asym": forces[some]}, 3) for some in (np.arange(16), order)
    )
    assert all(same_cell(by_position, lane, mixed, cell) for lane, cell in enumerate(order))
    block, force = Block(p, {"bow_bridge": positions, "f_asym": forces}), np.empty_like(mixed[0].bridge_force)
    assert block.advance(force).bridge_force is force
    assert force.tobytes() == mixed[0].bridge_force.tobytes()
    assert np.array_equal(block.admittance, Block(p, {"f_asym": forces}).admittance)


@pytest.mark.parametrize(
    ("gesture", "name"), [("martele", "tau_v"), ("accelerate_to", "acceleration"), ("string_crossing", "tau_f")]
)
def test_the_start_of_a_gesture_may_differ_between_the_cells_of_a_block(gesture, name):
    p = Parameters(gesture=gesture, f_asym=2.5, periods=10)
    values = np.geomspace(0.05, 2.0, 9) * getattr(p, name)
    results = run(p, {name: values}, 2)
    for cell in (0, 8):
        assert same_cell(results, cell, run(p.replace(**{name: values[cell]}), {"f_asym": [2.5]}, 2), 0)


def test_a_users_reflection_function_runs_in_a_block():
    p = Parameters(model="delta_cremer", nut_function="first=120 taps=-0.1,-0.2,-0.4,-0.2,-0.1", periods=10)
    want = simulate(p, p.samples)
    results = run(p, {"f_asym": [5.5] * 9}, 2)
    got = np.concatenate([r.bridge_force[8] for r in results])
    assert got.tobytes() == want["bridge_force"].astype(np.float32).tobytes()


def test_a_bow_very_near_the_bridge_or_the_nut_agrees_with_the_scalar_string():
    for bow in (1, 2, 7, 8, 137, 138):
        p = Parameters(model="raman", bow_bridge=bow, f_asym=2.0, periods=5)
        assert transient(p)["v"].tobytes() == simulate(p, p.samples)["v"].tobytes()


def test_a_string_of_another_period_has_chunks_of_its_own_five_periods():
    p = Parameters(model="stiff_cremer", period=200, bow_bridge=20, f_asym=3.0, periods=10)
    want = simulate(p, p.samples)
    results = run(p, {"f_asym": [3.0]}, 2)
    assert results[0].bridge_force.shape == (1, 1000)
    got = np.concatenate([r.bridge_force[0] for r in results])
    assert got.tobytes() == want["bridge_force"].astype(np.float32).tobytes()
    assert slips_of(results, 0) == intervals(want["slipping"], want["s"], 1000)


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.5, 20), st.floats(0, 2)), min_size=1, max_size=20),
    st.floats(-2, 0.9),
    st.sampled_from(MAIN),
)
def test_a_chunk_keeps_its_accounts(cells, v_mid, model):
    p = Parameters(model=model, v_mid=v_mid, periods=15)
    block = Block(p, {"f_asym": [f for f, _ in cells], "f_init_ratio": [r for _, r in cells]})
    before = np.zeros(len(cells), bool)
    for _ in range(p.chunks):
        r = block.advance()
        assert r.bridge_force.shape == (len(cells), 695) and r.bridge_force.dtype == np.float32
        assert r.bridge_force.flags.c_contiguous and np.isfinite(r.bridge_force).all()
        assert r.slipping.tolist() == before.tolist()
        assert r.offsets[0] == 0 and r.offsets[-1] == len(r.onset) == len(r.duration) == len(r.slip)
        assert np.all(np.diff(r.offsets.astype(int)) >= 0)
        for i in range(len(cells)):
            mine = slice(*r.offsets[i : i + 2])
            onset, duration, slip = r.onset[mine].astype(int), r.duration[mine].astype(int), r.slip[mine]
            end = onset + duration
            assert np.all(duration > 0) and np.all(end <= 695)
            assert np.all(onset[1:] > end[:-1])  # between two slips there is a stick
            assert np.all(slip >= 0) and np.all(np.isfinite(slip))
            before[i] = bool(len(end)) and end[-1] == 695


def test_a_slip_across_a_border_is_whole_when_its_parts_are_added():
    p = Parameters(model="stiff_cremer", f_asym=3.0, periods=50)
    want = simulate(p, p.samples)
    results = run(p, {"f_asym": [3.0]}, p.chunks)
    slips, cut = [], 0
    for number, onset, duration, slip in slips_of(results, 0):
        start = number * 695 + onset
        if slips and slips[-1][1] == start:
            slips[-1] = (slips[-1][0], start + duration, slips[-1][2] + slip)
            cut += 1
        else:
            slips.append((start, start + duration, slip))
    assert cut > 0
    for start, end, slip in slips:
        assert want["slipping"][start:end].all()
        assert not want["slipping"][start - 1] and (end == len(want["s"]) or not want["slipping"][end])
        assert slip == pytest.approx(want["s"][start:end].sum(), rel=1e-12)


def test_single_precision_follows_double_precision_for_a_while():
    lanes = {"f_asym": np.geomspace(0.5, 20, 16)}
    double = run(Parameters(periods=5), lanes, 1)[0].bridge_force
    single = run(Parameters(periods=5, dtype="float32"), lanes, 1)[0].bridge_force
    assert single[:, :300] == pytest.approx(double[:, :300], abs=1e-4)
    assert single.tobytes() != double.tobytes()


@pytest.mark.parametrize(
    ("lanes", "what"),
    [
        ({}, "must be one or more arrays of one length"),
        ({"f_asym": []}, "must be one or more arrays of one length, at least 1"),
        ({"f_asym": [1.0], "v_mid": [0.1, 0.2]}, r"lanes: lengths \{'f_asym': 1, 'v_mid': 2\}"),
        ({"f_asym": [1.0, -2.0]}, r"lanes\.f_asym\[1\] = -2\.0: must be a number > 0"),
        ({"f_asym": [1.0, np.nan]}, r"lanes\.f_asym\[1\] = nan"),
        ({"v_mid": [0.5, 1.5]}, r"lanes\[1\]: v_mid = 1\.5: must be less than v_b = 1\.0"),
        ({"mu_d": [0.3, 0.9]}, r"lanes\[1\]: mu_d = 0\.9: must be less than mu_s = 0\.8"),
        ({"bow_bridge": [15.0, 15.5]}, r"lanes\.bow_bridge\[1\] = 15\.5: must be a whole number"),
        ({"bow_bridge": [15.0, 139.0]}, r"lanes\[1\]: bow_bridge = 139: must be less than period"),
        ({"bow_bridge": [15.0, 2.0]}, r"lanes\[1\]: torsion_speed: the torsional round trip"),
        ({"period": [139.0]}, r"lanes\.period: is the same for all cells of a block; must be one of"),
        ({"colour": [139.0]}, r"lanes\.colour: is not a parameter"),
        ({"f_asym": [[1.0]]}, r"lanes\.f_asym: shape \(1, 1\)"),
    ],
)
def test_cells_that_cannot_be_are_refused_by_parameter_place_and_value(lanes, what):
    with pytest.raises(ParameterError, match=what):
        Block(Parameters(), lanes)


NO_SOURCES = {
    "bow_sim.kernel.sources",  # lists them
    "bow_sim.simd.code_cache",  # stores the code
    "bow_sim.physics.errors",
}
"""Modules that the kernel imports and that decide no waveform."""


def test_the_sources_are_all_modules_that_the_waveforms_are_made_of():
    modules = made_of("bow_sim.kernel.block").keys()
    assert modules > NO_SOURCES
    assert {"bow_sim." + name.replace("/", ".") for name in SOURCES} == modules - NO_SOURCES


CHILD = """
import sys
from bow_sim.kernel import block
from bow_sim.physics.parameters import Parameters
for model in ("delta_cremer", "stiff_cremer"):
    for cells in (1, 8):
        block.Block(Parameters(model=model), {"f_asym": [2.0] * cells}).advance()
for loop in (block._advance, block._advance_few):
    print(sum(loop.stats.cache_misses.values()), sum(loop.stats.cache_hits.values()))
print(sorted(m for m in ("rclpy", "mcap", "rerun") if m in sys.modules))
"""


def test_another_process_loads_the_compiled_kernel_and_needs_no_ros():
    for model in MAIN:
        for cells in (1, 8):
            Block(Parameters(model=model), {"f_asym": [2.0] * cells}).advance()  # fills the cache, if it is cold
    lines = subprocess.run(
        [sys.executable, "-c", CHILD], check=True, capture_output=True, text=True
    ).stdout.splitlines()
    assert lines == ["0 2", "0 1", "[]"]
