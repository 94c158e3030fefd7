"""`bow compare`: several runs as a table, as JSON and as a picture."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from bow_classifier.verdict.regimes import REGIMES
from bow_sweep.cli import main
from bow_sweep.maps.basin_map import Basin
from bow_sweep.maps.compare import compare, difference, names, notes, settings_that_differ, sure
from bow_sweep.maps.map_file import MapFile, write_map_npz
from bow_sweep.maps.playability import MEASURES, playability
from bow_sweep.plan.sweep import Sweep

NX, NY = 64, 32
HELMHOLTZ = REGIMES.index("helmholtz")


def run_of(directory: Path, preset: str, share: float, *settings: str, missing: int = 0, seed: int = 1) -> Path:
    """A run directory whose map has speckle, a share of it coloured."""
    sweep = Sweep.from_spec(preset, [f"x.count={NX}", f"y.count={NY}", *settings])
    rng, basin = np.random.default_rng(seed), Basin(sweep.x.count, sweep.y.count, sweep.chunks)
    came = rng.random(sweep.cells) < share
    basin.transient_periods[:] = np.where(came, 5 * rng.integers(2, 15, sweep.cells), 0)
    basin.layers["regime"][-1] = np.where(came, HELMHOLTZ, REGIMES.index("multiple_flyback"))
    basin.tested[:] = sweep.chunks
    left_out = np.arange(sweep.cells) < missing
    directory.mkdir(parents=True)
    write_map_npz(directory / "map.npz", MapFile.of(sweep, basin, "0123", left_out))
    return directory


@pytest.fixture
def pair(tmp_path) -> list[Path]:
    return [run_of(tmp_path / "c", "fig11c", 0.3), run_of(tmp_path / "d", "fig11d", 0.6, seed=2)]


def bow(*words: object) -> int:
    return main([str(word) for word in words])


def test_the_table_has_every_measure_of_every_run_and_the_difference(pair, capsys):
    assert bow("compare", *pair) == 0
    shown = capsys.readouterr().out
    for measure in MEASURES:
        assert measure.title in shown
    assert "Delta/Cremer, v_mid 0.2, 64 × 32" in shown
    (line,) = [line for line in shown.splitlines() if "Helmholtz motion" in line]
    shares = [100 * playability(each.plane.transient_periods)["helmholtz"]["value"] for each in compare(pair)]
    for number in (f"{shares[0]:.1f} ±", f"{shares[1]:.1f} ±", f"+{shares[1] - shares[0]:.1f} ±", "*"):
        assert number in line
    assert "note" not in shown


def test_three_runs_fit_without_a_difference(pair, tmp_path, capsys):
    assert bow("compare", *pair, run_of(tmp_path / "e", "fig11e", 0.5)) == 0
    assert "difference" not in capsys.readouterr().out


def test_json_holds_the_same_numbers_and_differences_from_the_first(pair, capsys):
    assert bow("compare", *pair, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert [run["run"] for run in found["runs"]] == ["c", "d"]
    first, second = (run["playability"]["helmholtz"] for run in found["runs"])
    (step,) = found["differences"]
    assert step["helmholtz"]["value"] == pytest.approx(second["value"] - first["value"])
    assert step["helmholtz"]["error"] == pytest.approx(np.hypot(first["error"], second["error"]))
    assert step["helmholtz"]["sure"] is True
    assert found["runs"][0]["playability"]["black_is"]["speckle"] == {"multiple_flyback": 1}


def test_two_samples_of_one_plane_do_not_differ(tmp_path):
    one, other = compare([run_of(tmp_path / str(seed), "fig11d", 0.5, seed=seed) for seed in (3, 4)])
    step, error = difference(one, other, "helmholtz")
    assert abs(step) < 4 * error


def test_a_difference_that_coarser_grids_do_not_show_is_not_sure(pair):
    one, other = compare(pair)
    assert sure(one, other, "helmholtz")
    numbers = {**other.numbers, "helmholtz": {**other.numbers["helmholtz"]}}
    numbers["helmholtz"]["half_grid"] = one.numbers["helmholtz"]["half_grid"]
    assert not sure(one, replace(other, numbers=numbers), "helmholtz")


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_the_picture_is_drawn(pair, tmp_path, suffix, capsys):
    out = tmp_path / f"compared.{suffix}"
    assert bow("compare", *pair, "--out", out) == 0
    assert f"wrote {out}" in capsys.readouterr().out
    if suffix == "png":
        picture = imread(out)
        assert min(picture.shape[:2]) > 600
        blue = np.all(np.abs(picture[..., :3] - np.array((213, 94, 0)) / 255) < 0.02, axis=-1)
        assert blue.mean() > 0.05  # speckle with black


def test_json_stays_json_beside_a_picture(pair, tmp_path, capsys):
    assert bow("compare", *pair, "--json", "--out", tmp_path / "c.png") == 0
    json.loads(capsys.readouterr().out)


def test_runs_are_named_by_as_much_of_their_path_as_tells_them_apart():
    assert names([Path("/a/c"), Path("/a/d")]) == ["c", "d"]
    assert names([Path("/a/c"), Path("/b/c")]) == ["a/c", "b/c"]
    assert names([Path("/a/c"), Path("/a/c")]) == ["c", "c"]


def test_what_makes_a_comparison_doubtful_is_said(pair, tmp_path, capsys):
    other = [
        run_of(tmp_path / "fine", "fig11d", 0.5, "x.count=32"),
        run_of(tmp_path / "axes", "fig11d", 0.5, "x.last=10"),
        run_of(tmp_path / "short", "fig11d", 0.5, "periods=40"),
        run_of(tmp_path / "part", "fig11d", 0.5, missing=NX),
    ]
    assert notes(compare([pair[1], *other])) == [
        "part: 64 cells are not computed and left out",
        "fine has another grid than d: boundary and terrain depend on the grid",
        "axes is another plane than d: shares of the two are not comparable",
        "short is 40 periods long, d 100",
    ]
    assert bow("compare", pair[1], other[0]) == 0
    assert "note: fine has another grid" in capsys.readouterr().out


def test_a_run_without_its_settings_is_compared_all_the_same(pair, tmp_path):
    plane = replace(compare(pair)[0].plane, settings=())
    write_map_npz(tmp_path / "bare.npz", plane)
    assert compare([tmp_path / "bare.npz", pair[1]])[0].title == "64 × 32"


def test_what_cannot_be_compared_is_refused_with_status_2(pair, tmp_path, capsys):
    empty = run_of(tmp_path / "empty", "fig11d", 0.5, missing=NX * NY)
    for words, problem in (
        (pair[:1], "1 run given; should be two at least"),
        ([pair[0], tmp_path / "nowhere"], "nowhere: cannot be read as a map"),
        ([pair[0], empty], "empty: none of its cells is computed"),
        ([*pair, "--out", tmp_path / "c.gif"], "c.gif: cannot draw as .gif; should end in .png"),
        ([*pair, "--out", tmp_path / "no" / "c.png"], "cannot be written"),
    ):
        assert bow("compare", *words) == 2
        assert problem in capsys.readouterr().err


def test_help_teaches_the_five_kinds(capsys):
    with pytest.raises(SystemExit) as stopped:
        bow("compare", "--help")
    assert stopped.value.code == 0
    shown = capsys.readouterr().out
    for words in ("streaky", "speckle without black", "docile", "interleaved grids", "exit status: 0 done, 2 wrong"):
        assert words in shown


def test_the_settings_that_differ_come_first(pair, capsys):
    assert bow("compare", *pair) == 0
    shown = capsys.readouterr().out
    lines = [line.split() for line in shown.splitlines()]
    assert ["│", "preset", "│", "fig11c", "│", "fig11d", "│"] in lines
    assert ["│", "model", "│", "delta_cremer", "│", "stiff_cremer", "│"] in lines
    assert shown.index("settings that differ") < shown.index("Helmholtz motion")
    assert "made by" not in shown  # nothing is known of it
    assert bow("compare", pair[0], pair[0], "--json") == 0
    assert json.loads(capsys.readouterr().out)["settings"] == {}


def test_a_setting_that_differs_has_its_values_and_its_unit(pair, tmp_path):
    other = run_of(tmp_path / "other", "fig11d", 0.5, "tau_f=800", "x.last=10", "y.name=bridge_r", "y.first=5")
    found = {each.name: each for each in settings_that_differ(compare([pair[1], other]))}
    assert found["tau_f"].values == ("400.0", "800.0")
    assert found["tau_f"].unit == "samples"
    assert found["x.last"].values == ("20.0", "10.0")
    assert found["bridge_r"].values == ("25.0", "an axis")
    assert found["f_init_ratio"].values == ("an axis", "1.0")
    assert "preset" not in found


def test_an_older_run_without_a_setting_had_its_default(pair, tmp_path):
    plane = compare(pair)[1].plane
    older = replace(plane, settings=tuple(line for line in plane.settings if not line.startswith("hair_k")))
    write_map_npz(tmp_path / "older.npz", older)
    assert settings_that_differ(compare([pair[1], tmp_path / "older.npz"])) == []


def test_what_made_the_runs_is_compared(pair, capsys):
    for run, kernel in zip(pair, ("a", "b"), strict=True):
        report = {"fingerprint": kernel, "classifier": "c", "versions": {"numba": "0.68.1"}}
        (run / "report.json").write_text(json.dumps(report))
    assert bow("compare", *pair, "--json") == 0
    assert json.loads(capsys.readouterr().out)["made_by"] == {"kernel": {"values": ["a", "b"], "unit": ""}}
    (pair[0] / "report.json").write_text("torn")
    assert bow("compare", *pair) == 0
    assert "made by" not in capsys.readouterr().out
