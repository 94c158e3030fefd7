"""The edges of a map: found, bisected, and named by what decides between their two motions."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import example_maps
import numpy as np
import pytest
from graph import run_sweep

from bow_sim.physics.parameters import Parameters
from bow_sweep.cli import main
from bow_sweep.edges.bisection import Edges, bisect
from bow_sweep.edges.boundary import EdgesError, edges_of, in_row, nearest, spread
from bow_sweep.edges.motions import OUTCOMES, compute
from bow_sweep.edges.parting import KINDS, kind_of, part, slope_of
from bow_sweep.maps.in_process import compute as compute_map
from bow_sweep.maps.map_file import MapFile, write_map_npz
from bow_sweep.plan.sweep import Sweep

N = 139


def column(model: str, v_mid: float, f_asym: float, count: int = 24, last: float = 2.0) -> Sweep:
    """A sweep over the ratio of the bow force, 0.02 ... 2, at one bow force."""
    x = ["x.name=f_init_ratio", "x.first=0.02", f"x.last={last!r}", f"x.count={count}", "x.scale=linear"]
    y = ["y.name=f_asym", f"y.first={f_asym}", f"y.last={f_asym}", "y.count=1"]
    return Sweep.from_spec("", [f"model={model}", f"v_mid={v_mid}", *x, *y])


@cache
def map_of(sweep: Sweep) -> MapFile:
    return MapFile.of(sweep, compute_map(sweep), "0123456789abcdef")


@cache
def first_edge() -> tuple[Sweep, Edges]:
    """The first edge of a column, between its first two cells."""
    sweep = column("stiff_cremer", 0.9, 3.7, 2, 0.02 + 1.98 / 23)
    return sweep, bisect(sweep, edges_of(map_of(sweep), "helmholtz"))


def test_the_deciding_step_is_the_first_at_which_one_slips_and_the_other_does_not() -> None:
    force = np.zeros((4, 5 * N), np.float32)
    slipping = np.zeros((4, 5 * N), bool)
    slipping[:, 200:230] = True
    other_force, other = force.copy(), slipping.copy()
    other[0, 210:] = False  # captured sooner
    other[1, 400] = True  # released
    other[2, 0] = True  # released at once
    other_force[0, 3 * N : 4 * N] = 0.31
    other_force[1, 2 * N : 3 * N] = 0.29
    found = part((force, other_force), (slipping, other), N)
    assert found.step.tolist() == [210, 400, 0, -1]
    assert found.release.tolist() == [False, True, True, False]
    assert found.period.tolist() == [3, -1, -1, -1]
    assert part((force, other_force), (slipping, other), N, speed=0.9).period.tolist() == [3, 2, -1, -1]


WIDTH = 0.1 * 0.5 ** np.arange(45)


def kind(step: list[int], parting: list[int]) -> str:
    steps, partings = np.array(step), np.array(parting)
    return KINDS[kind_of(steps, partings[-1], slope_of(WIDTH, partings), N)]


def test_the_kind_of_an_edge_follows_from_its_partings() -> None:
    steady = [10 * N + 3] * 45
    assert kind(steady, [12] * 45) == "decision"
    assert kind(steady, [13] * 45) == "grain"
    assert kind(steady, [-1] * 45) == "threshold"
    assert kind([-1] * 45, [-1] * 45) == "threshold"
    later = [int(3.0 * i * np.log(2)) for i in range(45)]
    assert kind([N * p for p in later], later) == "unstable"
    beyond = [p if p < 60 else -1 for p in later]
    assert kind([N * p if p < 60 else -1 for p in later], beyond) == "unstable"
    soon = [8 * i if i < 12 else -1 for i in range(45)]
    assert kind([N * p if p >= 0 else -1 for p in soon], soon) == "unstable"
    assert kind([N * p if p >= 0 else 80 for p in soon], soon) == "threshold"  # what decides does not move any more
    assert kind(steady, later) != "unstable"
    once = [15] * 26 + [70] * 19
    assert kind([N * p for p in once], once) == "decision"  # it has moved once, not again and again


def test_a_slope_is_that_of_the_partings_where_they_get_later_steadily() -> None:
    rise = np.array([int(20 + 5 * i * np.log(2)) for i in range(45)])
    assert slope_of(WIDTH, rise) == pytest.approx(5.0, abs=0.1)
    rise[:12] = 0  # wide brackets do not count
    assert slope_of(WIDTH, rise) == pytest.approx(5.0, abs=0.1)
    assert slope_of(WIDTH, np.full(45, -1)) == 0.0


def test_the_edges_of_a_map_are_its_neighbours_of_different_outcome() -> None:
    found = example_maps.map_file()  # row 1 of 8 x 4 cells has no Helmholtz motion
    edges = edges_of(found, "helmholtz")
    assert (edges.along == 1).all()
    assert sorted(zip(edges.ix, edges.iy, strict=True)) == [(x, y) for x in range(8) for y in (0, 1)]
    pending = edges_of(example_maps.map_file(computed=19), "helmholtz")
    assert sorted(zip(pending.ix, pending.iy, strict=True)) == [
        (x, y) for x in range(8) for y in (0, 1) if x < 3 or not y
    ]
    simulated = np.ones((4, 8), bool)
    simulated[0] = False  # what is predicted has no outcome of its own
    assert (edges_of(replace(found, simulated=simulated), "helmholtz").iy == 1).all()
    low_x, high_x, low_y, high_y = edges.ends(found.x, found.y)
    np.testing.assert_array_equal(low_x, high_x)
    assert (low_y < high_y).all()
    assert nearest(edges, found.axes, {"f_asym": 20, "f_init_ratio": 1.0}, 1)[0] == np.flatnonzero(
        (edges.ix == 7) & (edges.iy == 1)
    )
    assert len(in_row(edges, found.axes, {"f_asym": 0.5})) == 2
    for name, value in (("f_asym", 40.0), ("v_mid", 0.2), ("f_asym", -1.0)):
        with pytest.raises(EdgesError, match=name):
            in_row(edges, found.axes, {name: value})
    with pytest.raises(EdgesError, match="along x differ"):
        edges_of(found, "helmholtz", "x")
    with pytest.raises(EdgesError, match=r"bow_bridge.*whole numbers only"):
        edges_of(replace(found, y_name="bow_bridge"), "helmholtz", "y")
    assert spread(10, 3).tolist() == [0, 4, 9]
    assert spread(2, 3).tolist() == [0, 1]


def test_outcomes_tell_what_must_differ() -> None:
    helmholtz, extra, slip = 1, 6, 2
    regimes = np.array([[helmholtz, slip, slip, slip], [slip, slip, helmholtz, extra]], np.uint8)
    assert OUTCOMES["helmholtz"](regimes).tolist() == [0, 0, 1, 1]
    assert OUTCOMES["reached"](regimes).tolist() == [1, 0, 1, 1]
    assert OUTCOMES["regime"](regimes).tolist() == [slip, slip, helmholtz, helmholtz]


def test_an_edge_is_bisected_until_two_motions_differ_by_one_decision() -> None:
    sweep, edges = first_edge()
    assert edges.width[0] == pytest.approx(edges.width[0, 0] * 0.5 ** np.arange(45), rel=0.1)
    assert 0 < edges.width[0, -1] < 1e-14
    assert (edges.step[0, -1], edges.release[0, -1], edges.parting[0, -1]) == (884, True, 7)
    assert KINDS[edges.kind[0]] == "decision"
    assert 1e-7 < edges.settled[0] < 1e-3
    assert np.isnan(edges.growth[0])
    pair = compute(sweep, {"f_init_ratio": [edges.low[0], edges.high[0]], "f_asym": [3.7, 3.7]})
    assert OUTCOMES["helmholtz"](pair.regimes).tolist() == [1, 0]
    np.testing.assert_allclose(pair.force[0, :884], pair.force[1, :884], atol=1e-6)
    np.testing.assert_array_equal(pair.slipping[0, :884], pair.slipping[1, :884])
    assert pair.slipping[0, 884] != pair.slipping[1, 884]


def test_the_states_of_cells_are_those_of_their_transients() -> None:
    from bow_sim.kernel.block import transient

    p = Parameters(model="delta_cremer", f_asym=3.7, f_init_ratio=0.3, v_mid=0.2)
    sweep = column("delta_cremer", 0.2, 3.7)
    found = compute(sweep, {"f_init_ratio": [1.0, 0.3], "f_asym": [1.0, 3.7]})
    waveforms = transient(p)
    np.testing.assert_array_equal(found.slipping[1], waveforms["slipping"])
    np.testing.assert_array_equal(found.force[1], waveforms["bridge_force"].astype(np.float32))


@pytest.fixture
def run(tmp_path: Path) -> Path:
    sweep, _ = first_edge()
    write_map_npz(tmp_path / "map.npz", map_of(sweep))
    return tmp_path


def test_bow_edges_writes_table_arrays_and_picture(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["edges", str(run), "--halvings", "16"]) == 0
    out = capsys.readouterr().out
    assert "1 edge: decision 1, grain 0, unstable 0, threshold 0" in out
    (each,) = json.loads((run / "edges.json").read_text())["each"]
    assert (each["step"], each["event"], each["parting"], each["kind"]) == (884, "release", 7, "decision")
    assert each["fixed"] == {"f_asym": 3.7}
    _, edges = first_edge()
    with np.load(run / "edges.npz") as file:
        assert file["low"] <= edges.low
        assert edges.high <= file["high"]
        np.testing.assert_array_equal(file["step"], edges.step[:, :17])
        assert file["kind_names"][file["kind"][0]] == "decision"
    assert (run / "edges.png").read_bytes().startswith(b"\x89PNG")
    assert not list(run.glob(".*"))


@pytest.mark.parametrize(
    ("words", "status", "named"),
    [
        (["--limit", "0"], 2, "--limit 0: must be at least 1"),
        (["--halvings", "99"], 2, "--halvings 99: must be 1 ... 60"),
        (["--at", "f_asym"], 2, "should be name=value"),
        (["--at", "f_asym=9,f_init_ratio=0.1"], 2, "f_asym = 9: the map has 3.7 only"),
        (["--at", "v_mid=0.2"], 2, "v_mid = 0.2: is no axis of this map; it has f_init_ratio and f_asym"),
        (["--along", "y"], 1, "no two neighbouring cells along y differ"),
        (["--out", "nowhere"], 2, "--out nowhere: is no directory"),
    ],
)
def test_what_cannot_be_bisected_is_refused_in_one_line(
    words: list[str], status: int, named: str, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["edges", str(run), *words]) == status
    err = capsys.readouterr().err
    assert named in err
    assert err.count("\n") == 1
    assert [path.name for path in run.iterdir()] == ["map.npz"]


def test_an_edge_that_is_none_any_more_is_said(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sweep = column("stiff_cremer", 0.9, 3.7, 2, 0.03)
    found = map_of(sweep)  # both cells end in Helmholtz motion
    assert found.helmholtz[-1].all()
    helmholtz = found.helmholtz.copy()
    helmholtz[-1, 0, 0] = False
    write_map_npz(run / "map.npz", replace(found, helmholtz=helmholtz, regimes=None, confidence=None))
    assert main(["edges", str(run), "--halvings", "3"]) == 1
    err = capsys.readouterr().err
    assert "1 of 1 edges have one outcome on both sides here: another kernel made the map" in err
    assert "no edge is left" in err
    assert [path.name for path in run.iterdir()] == ["map.npz"]


def test_a_directory_that_is_no_run_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for place in (tmp_path, tmp_path / "nothing"):
        assert main(["edges", str(place)]) == 2
        assert "should be the directory of a run of `bow sweep`" in capsys.readouterr().err


@pytest.mark.full
@pytest.mark.parametrize(
    ("string", "outcome", "expected", "parting"),
    [
        (("stiff_cremer", -2, 8), "regime", "decision", 10),
        (("stiff_cremer", 0.9, 3.7), "helmholtz", "decision", 7),
        (("stiff_cremer", 0.2, 1.2), "helmholtz", "grain", 11),
        (("delta_cremer", 0.2, 2), "helmholtz", "grain", 14),
        (("delta_cremer", -2, 3), "helmholtz", "unstable", -1),
    ],
)
def test_the_first_edges_along_the_ratio(
    string: tuple[str, float, float], outcome: str, expected: str, parting: int
) -> None:
    sweep = column(*string)
    boundary = edges_of(map_of(sweep), outcome)
    edges = bisect(sweep, boundary, outcome)
    assert KINDS[edges.kind[0]] == expected
    assert edges.parting[0, -1] == parting
    if expected == "unstable":
        assert edges.growth[0] == pytest.approx(0.2, abs=0.1)
    else:
        assert (edges.step[0, 14:] == edges.step[0, -1]).all()  # brackets from 1e-5 to 1e-15
        assert edges.settled[0] > 1e-5
    alone = bisect(sweep, boundary.only(np.array([0])), outcome)
    np.testing.assert_array_equal(alone.step[0], edges.step[0])
    assert (alone.low[0], alone.high[0]) == (edges.low[0], edges.high[0])


@pytest.mark.full
def test_the_edges_of_a_real_run_with_a_body_and_hair_in_newton(
    tmp_path: Path, ros_domain: int, capsys: pytest.CaptureFixture[str]
) -> None:
    string = ["string=violin_d", "v_unit=0.1", "hair=hair_soft", "bridge=rigid", "body=signature", "periods=40"]
    axes = ["x.name=force", "x.first=0.1", "x.last=3", "x.scale=log", "y.name=beta", "y.first=0.06", "y.last=0.18"]
    plane = [word for setting in (*string, *axes) for word in ("--set", setting)]
    made = run_sweep(tmp_path / "run", *plane, "--nx", "12", "--ny", "6")
    before = {path: path.read_bytes() for path in made.rglob("*") if path.is_file()}
    copy = Path(shutil.copytree(made, tmp_path / "copy"))
    assert main(["edges", str(copy), "--limit", "9", "--outcome", "reached"]) == 0
    read = json.loads((copy / "edges.json").read_text())
    assert 0 < read["edges"] <= 9
    assert read["unlike"] == 0
    for each in read["each"]:
        assert each["along"] in ("force", "beta")
        assert each["width"] < 1e-10
    assert main(["verify", str(copy)]) == 0, capsys.readouterr()
    assert {path: path.read_bytes() for path in before} == before
