"""Any two parameters as a plane: usual axes, given values, layers of settings, and refusals that say what would do."""

from __future__ import annotations

import itertools
import shlex
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import yaml
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from outlines import outline

from bow_sim.physics import body
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.instruments import SI
from bow_sim.physics.parameters import FIELDS, SWEEPABLE
from bow_sim.physics.usual_axes import USUAL, usual
from bow_sim.protocol.axis_names import WHY_NOT
from bow_sim.protocol.sweep_spec import Axis
from bow_sweep.cli.parser import parser
from bow_sweep.maps.in_process import compute
from bow_sweep.plan.axes import THRESHOLDS
from bow_sweep.plan.preset_files import choose, save, schema
from bow_sweep.plan.sweep import Sweep
from bow_sweep.study.plan import Study
from bow_sweep.study.usual import overs_of

NAMES = sorted(SWEEPABLE | SI.keys() | {f"body_1_{kind}" for kind in body.KINDS})
PAIRED = [*NAMES, "model", "classifier.slip"]
RUN = "0123456789abcdef"
MODELS = ("raman", "delta_cremer", "stiff_cremer")


def planned(preset: str, *lines: str) -> Sweep:
    """A sweep, after checking that coordinator, nodes and `--resume` make the same one of its written form."""
    sweep = Sweep.from_spec(preset, lines)
    for base in ("", preset):
        again = Sweep.from_spec(base, sweep.settings())
        assert (again.settings(), again.sweep_id) == (sweep.settings(), sweep.sweep_id)
    found = outline(RUN, sweep.sweep_id, sweep.settings(), sweep.first_blocks.announce())
    assert (found.x, found.y) == (sweep.x, sweep.y)
    own = tuple(f"{name}=" for name in (sweep.x.name, sweep.y.name))
    for one, other in zip(found.parameters.settings(), sweep.parameters.settings(), strict=True):
        assert one == other or one.startswith(own)
    return sweep


def try_pair(preset: str, x: str, y: str) -> str:
    """Plan two parameters as a plane by their names alone; with the settings that a refusal names, if it names some."""
    lines = [f"x={x}", f"y={y}", "x.count=2", "y.count=2"]
    try:
        planned(preset, *lines)
    except ParameterError as error:
        reason = str(error)
        assert any(f"{key}.name = " in reason or f"at {key}." in reason for key in "xy"), reason
        added = reason.partition("; with the settings ")[2].partition(" it can be computed")[0].split()
        if added:
            planned(preset, *lines, *added)
        else:
            what_would_do = ("the axes should differ", "make a map for each", "give one of them", "as the other axis")
            assert any(words in reason for words in what_would_do), (x, y, reason)
        return reason
    return ""


def test_every_number_has_a_usual_axis() -> None:
    without = {name for name in NAMES if usual(name) is None}
    assert without == {name for name, quantity in SI.items() if quantity.back is not None and name != "beta"}
    assert set(USUAL) == (SWEEPABLE | {"beta", "bow_distance", "semitone"} | {f"body_{kind}" for kind in body.KINDS})
    for name, entry in USUAL.items():
        assert entry.first < entry.last, name
        assert entry.scale == "linear" or entry.first > 0, name


@settings(deadline=None, max_examples=25)
@given(preset=st.sampled_from(["fig11d", "schelleng", "guettler_cello", "playability"]), pair=st.data())
def test_two_parameters_make_a_plane_or_a_refusal_that_says_what_would_do(preset: str, pair: st.DataObject) -> None:
    x, y = pair.draw(st.sampled_from(PAIRED)), pair.draw(st.sampled_from(PAIRED))
    assume(x != y)
    try_pair(preset, x, y)


@pytest.mark.full
def test_every_second_pair_makes_a_plane_or_a_refusal_that_says_what_would_do() -> None:
    pairs = list(itertools.combinations(PAIRED, 2))[::2]
    refused = [reason for x, y in pairs if (reason := try_pair("fig11d", x, y))]
    for_good = [reason for reason in refused if "it can be computed" not in reason]
    assert len(for_good) < 0.12 * len(pairs)


def test_an_axis_takes_scale_and_range_from_its_parameter_not_from_the_preset() -> None:
    sweep = planned("fig11d", "x=stiffness_b", "y=mu_s", "y.count=5")
    assert sweep.x == Axis("stiffness_b", "log", 1e-6, 3e-4, 128)
    assert sweep.y == Axis("mu_s", "linear", 0.4, 1.2, 5)
    assert planned("fig11d", "x.name=mu_s", "x.last=2", "x.scale=log").x == Axis("mu_s", "log", 0.4, 2.0, 128)
    assert planned("fig11d", "x.first=0", "x.last=1e-4", "x.name=stiffness_b").x.scale == "linear"
    assert planned("fig11d", "x.first=2").x == Axis("f_asym", "log", 2.0, 20.0, 128)


def test_an_axis_of_whole_numbers_has_steps_of_whole_numbers() -> None:
    assert planned("fig11d", "x=bow_bridge").x == Axis("bow_bridge", "linear", 5.0, 36.0, 32)
    assert planned("fig11d", "x=bow_bridge", "x.count=8").x == Axis("bow_bridge", "linear", 5.0, 33.0, 8)
    assert planned("fig11d", "x=bow_bridge", "x.first=10", "x.last=13").x.count == 4
    with pytest.raises(ParameterError, match=r"x\.values: 5\.5: bow_bridge takes whole numbers"):
        Sweep.from_spec("fig11d", ["x=bow_bridge", "x.values=5,5.5"])


def test_a_range_in_si_units_is_that_of_the_paper_converted() -> None:
    sweep = planned("fig11d", "string=violin_g", "v_unit=0.1", "x=force", "y=f_0", "body=signature", "bridge=rigid")
    unit = 2 * 0.350 * 0.1
    assert (sweep.x.scale, sweep.x.first, sweep.x.last) == ("log", pytest.approx(0.5 * unit), pytest.approx(20 * unit))
    assert (sweep.y.first, sweep.y.last) == (pytest.approx(98), pytest.approx(392))
    mode = planned("fig11d", "string=violin_g", "body=signature", "bridge=rigid", "x=body_2_f")
    assert (mode.x.first, mode.x.last) == (pytest.approx(0.8 * 407, rel=1e-3), pytest.approx(1.25 * 407, rel=1e-3))


VALUES = (0.1, 0.30000000000000004, 1 / 3, 0.5)


def test_given_values_reach_the_cells_with_all_their_bits() -> None:
    text = f"y.values={list(VALUES)}"
    sweep = planned("fig11d", text, "x.count=3", "y.name=f_init_ratio")
    assert sweep.y == Axis("f_init_ratio", "values", 0.1, 0.5, 4, VALUES)
    lanes = sweep.lanes(np.arange(12))
    assert lanes["f_init_ratio"].tolist() == [value for value in VALUES for _ in range(3)]
    assert planned("fig11d", "x=mu_s", "x.values=1.2, 0.9,0.5").x.given == (1.2, 0.9, 0.5)
    assert planned("fig11d", "x=mu_s", "x.values=[0.9]").cells == 64


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["x.values=[]"], "x.values: '': should be finite numbers, as x.values=[0.1,0.2,0.5]"),
        (["x.values=[1,two]"], "x.values: 'two'"),
        (["x.values=[1,nan]"], "x.values: 'nan'"),
        (["x.values=[1,3,2]"], "x.values = [1.0, 3.0, 2.0]: should rise or fall throughout"),
        (["x.values=[1,1]"], "should rise or fall throughout, each value once"),
        (["x.values=[1,2,3]", "x.count=64"], "x.count = 64: x.values has 3; leave x.count out"),
        (["x.values=[0,1]"], "at x.first and y.first: f_asym = 0.0"),
        (["x.scale=values"], "x.scale = 'values': needs x.values"),
        ([f"x.values={','.join(map(str, range(5000)))}"], "x.values: 5000 values: should be at most 4096"),
        (["x=mu_s", "x.first=5"], "x.first = 5: the usual axis of mu_s is 0.4 ... 1.2; give x.last too"),
        (["x=f_init_ratio"], "y.name = 'f_init_ratio': both axes are this parameter; they should differ: set y.name"),
        (["x=force"], "y.name = 'f_asym': gives f_asym, as x.name = 'force' does"),
        (["x=period"], "chunks of the same length"),
        (["x=periods"], "bow study fig11d --over periods=50,100"),
        (["x=gesture"], "no number; make a map for each, as by bow study fig11d --over gesture=exponential,martele"),
        (["x=string"], "bow study fig11d --over string=violin_g,violin_d"),
        (["x=seed"], "it says how a map is computed, not what of; make a map for each"),
        (["x=classifier.slop"], "classifier.slop = nan: unknown threshold; there is slip"),
        (["x=classifier.slip", "x.last=2"], "x.name = 'classifier.slip': classifier.slip = 2.0: must be a number"),
        (["x=model", "x.values=[raman,erard]"], "model = 'erard': should be one of friedlander, raman"),
        (["x=model", "y=corner_width", "x.values=[raman]"], "'corner_width': has no effect here; it needs model="),
        (["x=model", "repeats=2"], "repeats = 2: cannot be beside x.name = 'model'; make a map for each value"),
        (["x=stifness_b"], "there is no such parameter; did you mean stiffness_b?"),
        (["x=corner_width", "y=nut_gain"], "no cell has both; make a map for each"),
        (["x=tau_f", "y=mu_s"], "with the settings f_init_ratio=0.5 it can be computed"),
        (["x=beta", "bow_bridge=20"], ""),
        (["x=bow_bridge", "beta=0.1"], "beta = '0.1': it is the x axis of the map"),
    ],
)
def test_an_axis_that_cannot_be_is_refused_with_what_would_do(lines: list[str], message: str) -> None:
    if not message:  # complete settings have the paper's own beside an axis in SI units
        planned("fig11d", *lines)
        return
    with pytest.raises(ParameterError) as refusal:
        Sweep.from_spec("fig11d", ["y=f_asym", *lines] if lines == ["x=force"] else lines)
    assert message in str(refusal.value)


@pytest.mark.parametrize(
    ("lines", "command"),
    [
        (["x=period"], "bow study fig11d --over period=80,139"),
        (["x.count=3", "x=mu_s", "y=period"], "bow study fig11d --set x.count=3 --set x=mu_s --over period=80,139"),
        (["x=period", "x.values=[80, 100]", "mu_s=0.9"], "bow study fig11d --set mu_s=0.9 --over period=80,100"),
        (["y=period", "y.first=80", "y.last=120", "y.count=3"], "bow study fig11d --over period=80:120:3"),
        (["x=period", "y=seed"], "bow study fig11d --set repeats=8 --over period=80,139 --over seed=1,2"),
    ],
)
def test_what_needs_a_study_is_refused_with_the_command_that_makes_it(lines: list[str], command: str) -> None:
    with pytest.raises(ParameterError) as refusal:
        Sweep.from_spec("fig11d", lines)
    assert str(refusal.value).endswith(f"as by {command}")
    asked = parser().parse_args(shlex.split(command)[1:])
    study = Study(asked.preset, tuple(asked.settings), overs_of(asked.preset, asked.settings, asked.over))
    periods = [member.sweep.parameters.period for member in study.members]
    assert len(periods) > 1
    assert periods[0] == 80


def test_every_threshold_has_a_usual_axis() -> None:
    for name in THRESHOLDS:
        planned("fig11d", f"x=classifier.{name}", "x.count=2", "y.count=2")


def test_settings_that_one_of_two_parameters_needs_are_named_where_both_together_cannot_be() -> None:
    assert "with the settings model=raman it can" in try_pair("playability", "bridge_gain", "tau_f")
    assert "x.last=12 it can" in try_pair("guettler", "semitone", "bow_distance")


def test_why_a_number_cannot_be_an_axis_is_known_of_all_that_cannot() -> None:
    numbers = {name for name, field in FIELDS.items() if "range" in field.metadata}
    assert set(WHY_NOT) == numbers - SWEEPABLE


def test_a_later_layer_takes_the_place_of_an_earlier_one(tmp_path: Path) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text("v_mid: 0.2\nx: {name: mu_d, values: [0.1, 1e-1, 2e-1]}\ny: mu_s\n")
    with pytest.raises(ParameterError, match="each value once"):
        Sweep.from_spec("", choose(str(mine)).settings)
    mine.write_text("v_mid: 0.2\nx: {name: mu_d, values: [0.1, 2e-1, 0.3]}\ny: mu_s\n")
    jsonschema.validate(yaml.safe_load(mine.read_text()), schema())
    of_file = choose(str(mine)).settings
    assert planned("", *of_file).x.given == (0.1, 0.2, 0.3)
    assert planned("", *of_file, "x.values=0.1,0.15").x.given == (0.1, 0.15)
    assert planned("", *of_file, "x.first=0.2", "x.count=4").x == Axis("mu_d", "linear", 0.2, 0.35, 4)
    assert planned("", *of_file, "x.name=v_mid").x == Axis("v_mid", "linear", -2.0, 0.9, 128)
    save(tmp_path / "saved.yaml", planned("", *of_file), "saved")
    written = yaml.safe_load((tmp_path / "saved.yaml").read_text())
    assert written["x"]["values"] == [0.1, 0.2, 0.3]
    jsonschema.validate(written, schema())
    assert planned("", *choose(str(tmp_path / "saved.yaml")).settings).x.given == (0.1, 0.2, 0.3)


def test_models_stand_in_the_order_of_the_hierarchy_and_a_setting_of_one_of_them_is_enough(
    tmp_path: Path,
) -> None:
    assert planned("fig11d", "x=model").x.count == 6
    sweep = planned("fig11d", "x=model", "x.values=[stiff_cremer, raman]", "y=stiffness_b", "y.count=2")
    assert sweep.x.values().tolist() == [1, 5]
    assert "x.values=[raman, stiff_cremer]" in sweep.settings()
    assert [sweep.block(number).tolist() for number in range(sweep.blocks)] == [[0, 2], [1, 3]]
    save(tmp_path / "two.yaml", sweep, "two models")
    assert yaml.safe_load((tmp_path / "two.yaml").read_text())["x"]["values"] == ["raman", "stiff_cremer"]
    assert planned("", *choose(str(tmp_path / "two.yaml")).settings).x == sweep.x


KINDS = [("y=classifier.slip",), ("x=model", "y=classifier.corner", "y.count=5"), ("x=model", "adaptive=0.6")]


@pytest.mark.parametrize("lines", KINDS)
def test_a_block_has_cells_of_one_kind(lines: tuple[str, ...]) -> None:
    sweep = planned("fig11d", "y.count=7", "block_cells=4", *lines)
    blocks = sweep.first_blocks
    cells = [blocks.block(number) for number in range(blocks.count)]
    for each in cells:
        assert 1 <= len(each) <= 4
        assert (np.diff(each.astype(int)) > 0).all()
        for name, values in sweep.lanes(each).items():
            assert len(np.unique(values)) == 1 or name not in ("model", "classifier.slip", "classifier.corner")
    np.testing.assert_array_equal(np.sort(np.concatenate(cells)), np.flatnonzero(blocks.planned))
    announced = outline(RUN, sweep.sweep_id, sweep.settings(), blocks.announce())
    assert [announced.block(number).tolist() for number in range(announced.blocks)] == [each.tolist() for each in cells]


@pytest.mark.full
def test_a_cell_of_a_map_of_models_or_thresholds_is_that_of_a_map_of_one() -> None:
    size, values = ("x.count=5", "periods=40"), (0.02, 0.1, 0.5)
    maps = {
        "classifier.slip": (compute(planned("fig11d", "y=classifier.slip", f"y.values={list(values)}", *size)), values),
        "model": (compute(planned("fig11d", "y=model", f"y.values={','.join(MODELS)}", *size)), MODELS),
    }
    for name, (found, each) in maps.items():
        for row, value in enumerate(each):
            one = compute(planned("fig11d", f"{name}={value}", "y.values=[1]", *size))
            for layer, alone in one.layers.items():
                np.testing.assert_array_equal(found.layers[layer][:, 5 * row : 5 * row + 5], alone, f"{name}: {layer}")


def test_what_gives_si_units_can_be_an_axis_beside_what_needs_them() -> None:
    thermal = ("string=violin_a", "v_unit=0.1", "friction=thermal")
    sweep = planned("fig11d", *thermal, "x=v_unit", "y=z_0")
    assert (sweep.parameters.v_unit, sweep.parameters.z_0) == (0.1, 0.203)


PLANES = (
    ("x=mu_s", "x.values=[0.5,0.6,0.9]", "y=stiffness_b"),
    ("x=bow_offset", "y=torsion_speed", "y.values=[2,2.4,4]"),
    ("x=beta", "x.values=[0.05,0.1,0.2]", "y=mu_d"),
    ("x=v_unit", "y=rosin_t_g", "friction=thermal", "string=violin_a", "v_unit=0.1"),
    ("x=body_2_f", "y=hair_k", "y.values=[1000,2000,1e5]", "body=signature", "hair=hair_soft", "string=violin_a"),
)


@pytest.mark.full
@pytest.mark.parametrize("lines", PLANES)
def test_a_cell_of_any_plane_is_the_cell_computed_alone(lines: tuple[str, ...]) -> None:
    sweep = planned("fig11d", *lines, "x.count=3", "y.count=3", "periods=10")
    found = compute(sweep)
    for cell in (0, 5, 8):
        x, y = (axis[np.array([cell])][0] for axis in sweep.axis_values(np.arange(9)).values())
        alone = [f"x.values=[{float(x)!r}]", f"y.values=[{float(y)!r}]", *(s for s in lines if "values" not in s)]
        single = compute(planned("fig11d", *alone, "periods=10"))
        for name, layer in found.layers.items():
            np.testing.assert_array_equal(layer[:, cell], single.layers[name][:, 0], name)


@pytest.mark.parametrize(("setting", "axis"), [("body_1_f=440", "body_1_ratio"), ("body_1_m=0.1", "body_1_k")])
def test_a_mode_that_is_given_in_another_way_than_its_axis_is_refused(setting: str, axis: str) -> None:
    string = ["string=violin_a", "body=wolf_83", setting]
    with pytest.raises(ParameterError, match=f"{setting.partition('=')[0]} is given too; give one of them"):
        Sweep.from_spec("fig11d", [*string, f"y.name={axis}", "y.first=0.8", "y.last=1.2"])
    other = Sweep.from_spec("fig11d", [*string, "y.name=body_1_q", "y.first=20", "y.last=40"])
    assert setting.partition("=")[0] in other.parameters.body_changes
