"""A sweep's written form: round trips, blocks that cover it once, and refusals that name the value."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bow_sim.physics.errors import ParameterError
from bow_sim.protocol.limits import MAX_CHUNK_VALUES
from bow_sweep.plan.presets import presets
from bow_sweep.plan.sweep import Sweep, default_block_cells


def test_the_presets_are_those_of_the_paper() -> None:
    assert set(presets()) >= {"fig10", *(f"fig11{panel}" for panel in "abcdef")}


@pytest.mark.parametrize("preset", [name for name in presets() if name.startswith("fig")])
def test_a_preset_is_the_papers_plane_and_survives_its_written_form(preset: str) -> None:
    sweep = Sweep.from_spec(preset)
    assert (sweep.x.count, sweep.y.count, sweep.cells, sweep.blocks) == (128, 64, 8192, 16)
    force, ratio = sweep.x.values(), sweep.y.values()
    assert (force[0], force[-1], ratio[0], ratio[-1]) == (0.5, 20.0, 0.0, 2.0)
    np.testing.assert_allclose(np.diff(np.log(force)), np.log(40) / 127)
    np.testing.assert_allclose(np.diff(ratio), 2 / 63)
    again = Sweep.from_spec("", sweep.settings())
    assert again.settings() == sweep.settings()
    assert again.sweep_id == sweep.sweep_id


@pytest.mark.parametrize("preset", presets())
def test_every_preset_survives_its_written_form(preset: str) -> None:
    sweep = Sweep.from_spec(preset)
    assert Sweep.from_spec("", sweep.settings()).sweep_id == sweep.sweep_id
    assert Sweep.from_spec(preset, sweep.settings()).sweep_id == sweep.sweep_id  # as a goal has it


def test_a_setting_takes_the_place_of_the_same_in_other_units_in_a_preset() -> None:
    slow = Sweep.from_spec("schelleng_cello", ["speed=0.05"])
    assert Sweep.from_spec("schelleng_cello", ["v_b=0.5"]).sweep_id == slow.sweep_id
    near = Sweep.from_spec("guettler_cello", ["bow_distance=28"])
    assert near.parameters.beta == pytest.approx(0.04)


def test_thresholds_are_not_part_of_the_sweeps_identity_and_physics_is() -> None:
    base = Sweep.from_spec("fig11d")
    assert Sweep.from_spec("fig11d", ["classifier.correlation=0.9"]).sweep_id == base.sweep_id
    assert Sweep.from_spec("fig11d", ["v_mid=0.21"]).sweep_id != base.sweep_id
    assert Sweep.from_spec("fig11d", ["dtype=float32"]).sweep_id != base.sweep_id


@given(cells=st.integers(1, 1 << 22), adaptive=st.sampled_from([1.0, 0.5]), samples=st.integers(10, 100_000))
def test_default_blocks_suit_the_lanes_of_the_kernel_and_the_size_of_messages(
    cells: int, adaptive: float, samples: int
) -> None:
    block = default_block_cells(cells, adaptive, samples)
    assert block * samples <= MAX_CHUNK_VALUES
    assert 1 <= block <= 512
    assert block % 8 == 0 or (block + 1) * samples > MAX_CHUNK_VALUES


def test_the_paper_s_plane_has_sixteen_blocks_and_four_for_each_round_of_an_adaptive_sweep() -> None:
    sizes = [
        default_block_cells(cells, adaptive, 695) for cells, adaptive in ((8192, 1), (8192, 0.5), (2048, 1), (9, 1))
    ]
    assert sizes == [512, 128, 128, 64]


@given(nx=st.integers(1, 40), ny=st.integers(1, 40), block_cells=st.integers(1, 200))
def test_blocks_cover_every_cell_once(nx: int, ny: int, block_cells: int) -> None:
    sweep = Sweep.from_spec("", [f"x.count={nx}", f"y.count={ny}", f"block_cells={block_cells}"])
    cells = np.concatenate([sweep.block(n) for n in range(sweep.blocks)])
    np.testing.assert_array_equal(cells, np.arange(nx * ny))
    lanes = sweep.lanes(cells)
    grid = np.meshgrid(sweep.x.values(), sweep.y.values())
    np.testing.assert_array_equal(lanes["f_asym"], grid[0].ravel())
    np.testing.assert_array_equal(lanes["f_init_ratio"], grid[1].ravel())


def test_an_adaptive_sweep_is_planned_in_rounds_and_another_sweep() -> None:
    base, half = Sweep.from_spec("fig11d"), Sweep.from_spec("fig11d", ["adaptive=0.5"])
    assert half.sweep_id != base.sweep_id
    assert Sweep.from_spec("", half.settings()).sweep_id == half.sweep_id
    assert (half.budget, half.first_blocks.planned_cells) == (4096, 17 * 33)
    assert half.block(half.blocks - 1)[-1] == half.cells - 1
    assert half.first_blocks.adaptive
    nothing = np.full(half.cells, np.nan)
    more = half.more_blocks(half.first_blocks, nothing)
    assert more is not None and more.extends(half.first_blocks)


def test_an_exhaustive_sweep_is_what_it_was_before_there_were_adaptive_ones() -> None:
    base = Sweep.from_spec("fig11d")
    assert Sweep.from_spec("fig11d", ["adaptive=1"]).sweep_id == base.sweep_id
    assert not any("adaptive" in line for line in base.settings())
    assert base.budget == base.cells == base.first_blocks.planned_cells
    assert base.more_blocks(base.first_blocks, np.zeros(base.cells)) is None


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (["x.count=0"], "x.count = 0"),
        (["x.count=9999999999"], "x.count = 9999999999"),
        (["x.count=4000", "y.count=4000"], "16000000 cells"),
        (["x.count=2.5"], "x.count = '2.5'"),
        (["x.first=0"], "x.first = 0.0"),
        (["x.first=-1"], "x.first = -1.0"),
        (["x.first=nan"], "x.first = nan"),
        (["x.last=inf"], "x.last = inf"),
        (["x.last=0.5"], "x.last = 0.5"),
        (["x.scale=cubic"], "x.scale = 'cubic'"),
        (["x.name=gesture"], "x.name = 'gesture'"),
        (["x.colour=red"], "x.colour: no such setting"),
        (["y.name=f_asym"], "y.name = 'f_asym'"),
        (["y.first=-0.5"], "f_init_ratio = -0.5"),
        (["x.name=bow_bridge", "x.first=8", "x.last=16", "x.count=8", "x.scale=linear"], "whole numbers"),
        (["x.name=v_mid", "x.scale=linear", "x.first=0", "x.last=1"], "v_mid = 1.0"),
        (["f_asym=3"], "f_asym = '3': it is the x axis"),
        (["v_mid=1"], "v_mid = 1.0"),
        (["tau_f=0"], "tau_f = '0'"),
        (["model=erard"], "model = 'erard'"),
        (["periods=7"], "periods = 7"),
        (["block_cells=0"], "block_cells = 0"),
        (["block_cells=5000"], "block_cells = 5000"),
        (["adaptive=0"], "adaptive = 0"),
        (["adaptive=1.1"], "adaptive = 1.1"),
        (["adaptive=nan"], "adaptive = nan"),
        (["adaptive=half"], "adaptive = 'half'"),
        (["colour=red"], "colour = 'red'"),
        (["classifier.correlation=2"], "classifier.correlation"),
        (["nonsense"], "nonsense"),
    ],
)
def test_a_setting_that_cannot_be_is_refused_with_its_value(settings: list[str], message: str) -> None:
    with pytest.raises(ParameterError) as refusal:
        Sweep.from_spec("fig11d", settings)
    assert message in str(refusal.value)


@pytest.mark.parametrize("preset", ["nope", "../fig11d", "/etc/passwd", "fig11d.yaml"])
def test_a_preset_is_a_name_from_the_list_never_a_path(preset: str) -> None:
    with pytest.raises(ParameterError, match="no such preset"):
        Sweep.from_spec(preset)


def test_any_parameter_can_be_an_axis() -> None:
    sweep = Sweep.from_spec("", ["x.name=mu_s", "x.scale=linear", "x.first=0.4", "x.last=1", "y.count=3", "x.count=2"])
    assert set(sweep.lanes(sweep.block(0))) == {"mu_s", "f_init_ratio"}
    assert not any(line.startswith("mu_s=") for line in sweep.settings())


@given(st.text(max_size=30))
def test_no_text_breaks_the_reader(text: str) -> None:
    try:
        Sweep.from_spec("", [text])
    except ParameterError as error:
        assert str(error)


def test_a_setting_by_itself_wins_over_what_has_a_name_also_that_of_a_preset():
    """`guettler_cello` has a mu_s of its own; a rosin stands for another one."""
    rosin = ["friction=thermal", "rosin=rosin_hard"]
    found = [Sweep.from_spec("guettler_cello", [*rosin, *more]).parameters for more in ([], ["mu_s=1.05"])]
    assert [(p.mu_s, p.rosin_t_g) for p in found] == [(0.9, 35.0), (1.05, 35.0)]
    assert Sweep.from_spec("schelleng_cello", rosin).parameters.mu_s == 1.05
    assert Sweep.from_spec("guettler_cello", ["mu_s=0.8", *rosin]).parameters.mu_s == 0.8
    assert Sweep.from_spec("guettler_cello", [*rosin, "mu_s=0.8"]).parameters.mu_s == 0.8
