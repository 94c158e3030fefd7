import argparse
import functools
import json
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest

from bow_classifier.verdict.regimes import REGIMES
from bow_sim.figures import page
from bow_sim.figures.linear import models
from bow_sim.figures.motion import motion
from bow_sim.figures.page import STYLE
from bow_sim.physics.modes import transverse_modes
from bow_sim.physics.parameters import Parameters
from bow_sweep.cli import figure
from bow_sweep.cli import validate as validate_command
from bow_sweep.figures import maps
from bow_sweep.maps.in_process import compute
from bow_sweep.maps.map_file import MapFile, MapFileError, write_map_npz
from bow_sweep.paper import claims_maps, claims_modes, claims_motion, claims_terrain, map_measures
from bow_sweep.paper.claim import FAIL, NEEDS_RUNS, PASS, REPORT
from bow_sweep.paper.maps import LAYOUT, letter_of, recognise
from bow_sweep.paper.validate import validate
from bow_sweep.plan.sweep import Sweep

X, Y = np.geomspace(0.5, 20, 128), np.linspace(0, 2, 64)
HELMHOLTZ, FLYBACK, SLIP = (REGIMES.index(name) for name in ("helmholtz", "multiple_flyback", "multiple_slip"))


def painted(letter: str, lengths: np.ndarray, black: int = SLIP, **changes: str) -> MapFile:
    """A map of Fig 11 that looks like this: (64, 128) transient lengths, what is black in regime `black`."""
    model, v_mid = LAYOUT[letter]
    settings = {**dict(s.split("=", 1) for s in Parameters(model=model, v_mid=v_mid).settings()), **changes}
    shape = lengths.shape
    good = lengths > 0
    tests = np.arange(5, 101, 5)
    return MapFile(
        run_id="r", sweep_id="s", x_name="f_asym", y_name="f_init_ratio",
        x=np.geomspace(0.5, 20, shape[1]), y=np.linspace(0, 2, shape[0]),
        transient_periods=lengths.astype(np.float32),
        regime=np.where(good, HELMHOLTZ, black).astype(np.uint8), regime_names=tuple(REGIMES),
        settings=tuple(f"{name}={value}" for name, value in settings.items()),
        test_periods=tests,
        correlation=np.broadcast_to(np.where(np.geomspace(0.5, 20, shape[1]) > 11.46, 0.5, 0.99), (20, *shape)),
        period=np.full((20, *shape), 139.0), slips=np.full((20, *shape), 5), corners=np.full((20, *shape), 5),
        helmholtz=good & (tests[:, None, None] >= lengths),
    )  # fmt: skip


def as_the_paper_says() -> dict[str, MapFile]:
    """Six maps drawn by hand after the paper's words."""
    rng = np.random.default_rng(1)
    x, y = np.meshgrid(X, Y)
    rough, smooth = rng.choice([20, 40, 60, 80], x.shape), np.round(60 - 8 * x.clip(0, 5), -1) // 5 * 5
    streaks = np.sin(12 * (np.log(x) + 0.6 * np.log(y + 0.05))) > 0
    specks = rng.random(x.shape) > 0.05
    stripe = (x > 4) & (x < 10)
    return {
        "a": painted("a", rough * stripe * specks),
        "b": painted("b", rough * stripe * specks),
        "c": painted("c", rough * ((x > 1) & (x < 13)) * streaks, FLYBACK),
        "d": painted("d", rough * ((x > 1) & (x < 13)) * specks),
        "e": painted("e", smooth * (((x > 0.8) & (x < 2.5)) | ((x > 2.5) & (x < 9) & streaks)), FLYBACK),
        "f": painted("f", smooth * ((x > 0.8) & (x < 9))),
    }


def as_chance_would_have_it(share: float) -> dict[str, MapFile]:
    """Six maps that say nothing."""
    rng = np.random.default_rng(2)
    noise = rng.random((64, 128)) < share
    maps = {letter: painted(letter, np.where(noise, 20.0, 0.0)) for letter in LAYOUT}
    return {letter: replace(plane, correlation=np.full((20, 64, 128), 0.5)) for letter, plane in maps.items()}


def verdicts(claims, maps=None) -> dict[str, str]:
    return {claim.key: claim.judge(maps or {}).verdict for claim in claims}


# ---- one string


@pytest.fixture(scope="module")
def report():
    return validate()


def test_every_claim_about_one_string_holds_and_maps_wait_for_runs(report):
    assert report.ok
    judged = {row.key: row.verdict for row in report.rows}
    strings = {claim.key for claim in (*claims_modes.CLAIMS.all, *claims_motion.CLAIMS.all)}
    assert {key for key, verdict in judged.items() if verdict in (PASS, REPORT)} == strings
    assert {key for key, verdict in judged.items() if verdict == REPORT} == {"flattening", "float32"}
    assert {verdict for key, verdict in judged.items() if key not in strings} == {NEEDS_RUNS}


def test_every_row_says_what_it_asks_and_why(report):
    assert len({row.key for row in report.rows}) == len(report.rows)
    for row in report.rows:
        assert row.claim and row.where and row.expected and row.measured, row.key
        assert len(row.reason) > 10 or row.key.endswith("onset"), row.key


def test_json_and_markdown_hold_the_same_table(report):
    read = json.loads(report.to_json())
    assert read["ok"] is True and read["counts"] == report.counts
    assert [row["key"] for row in read["rows"]] == [row.key for row in report.rows]
    assert read["rows"][0]["values"]["q"] == pytest.approx([27.5, 42.2, 45.7, 43.8, 40.2, 36.4, 32.9, 29.9], abs=0.06)
    lines = report.to_markdown().splitlines()
    cells = [line.replace(r"\|", "").split("|") for line in lines if line.startswith("|")]
    assert len(cells) == len(report.rows) + 2 and {len(row) for row in cells} == {8}
    assert "NaN" not in report.to_json()


def test_another_string_fails_the_claims_about_modes_and_friction(monkeypatch):
    changes = {"torsion_width": 0.5, "torsion_speed": 2.0, "torsion_gain": 0.999, "bridge_r": 400.0, "nut_power": 2.0,
               "nut_cutoff": 0.3}  # fmt: skip
    strings = [p.replace(**changes) for p in models()]
    monkeypatch.setattr(claims_modes, "models", lambda: strings)
    monkeypatch.setattr(claims_modes, "transverse", lambda: tuple(transverse_modes(p, 30) for p in strings))
    monkeypatch.setattr(claims_modes, "Parameters", functools.partial(Parameters, mu_s=0.9))
    changed = verdicts(claims_modes.CLAIMS.all)
    spared = {"fig3-delta", "fig4-high", "fig3-size", "fig3-stiff"}  # of filters and bridges: below
    assert {key for key, verdict in changed.items() if verdict == PASS} <= spared
    strings = [models()[1], models()[0].replace(bridge_w_c=20.0)]
    monkeypatch.setattr(claims_modes, "transverse", lambda: tuple(transverse_modes(p, 30) for p in strings))
    assert all(verdict == FAIL for key, verdict in verdicts(claims_modes.CLAIMS.all).items() if key in spared)


def test_another_transient_fails_the_claims_about_figs_5_to_8(monkeypatch):
    m = motion(1.0)  # never Helmholtz motion, and the same at both forces
    m = m._replace(v_1=m.v_1 + 1, v_centre=m.v)

    def other(_force: float = 5.5):
        return m

    monkeypatch.setattr(claims_motion, "passed", lambda _force: [False] * 20)
    monkeypatch.setattr(claims_motion, "motion", other)
    monkeypatch.setattr(
        claims_motion, "steady", lambda: (0, other()._replace(bridge_force=np.cos(np.arange(13900) / 9)))
    )
    changed = verdicts(claims_motion.CLAIMS.all)
    assert {key: verdict for key, verdict in changed.items() if verdict not in (FAIL, REPORT)} == {}


# ---- maps


def test_maps_after_the_papers_words_pass_and_chance_does_not():
    claims = claims_maps.CLAIMS.all
    paper = verdicts(claims, as_the_paper_says())
    assert {key for key, verdict in paper.items() if verdict == FAIL} <= {"fractions"}
    judged = {key for key, verdict in paper.items() if verdict != REPORT}
    for share in (0.5, 0.02):
        chance = verdicts(claims, as_chance_would_have_it(share))
        assert {key for key in judged if chance[key] != FAIL} == set(), share


def test_columns_swapped_fail_what_tells_the_models_apart():
    maps = as_the_paper_says()
    swapped = {letter: maps[other] for letter, other in zip("abcdef", "badcfe", strict=True)}
    failed = {key for key, verdict in verdicts(claims_maps.CLAIMS.all, swapped).items() if verdict == FAIL}
    assert {"specks-d", "cut-c", "cut-e", "curved", "easier-0.2", "easier--2"} <= failed


def test_a_coarse_map_is_measured_and_not_judged():
    coarse = painted("b", np.full((16, 32), 20.0))
    (claim,) = [claim for claim in claims_maps.CLAIMS.all if claim.key == "stripe-b"]
    row = claim.judge({"b": coarse})
    assert row.verdict == REPORT and "not judged: (b) coarser" in row.measured


def test_another_calibration_is_not_held_to_the_trials_fractions():
    (claim,) = [claim for claim in claims_maps.CLAIMS.all if claim.key == "fractions"]
    maps = as_the_paper_says()
    assert claim.judge(maps).verdict == FAIL
    assert claim.judge({**maps, "c": painted("c", np.zeros((64, 128)), bridge_r="63.5")}).verdict == REPORT


def test_a_computed_map_is_recognised_and_measured(tmp_path):
    sweep = Sweep.from_spec("fig11d", ["x.count=24", "y.count=12", "periods=40"])
    (tmp_path / "run").mkdir()
    write_map_npz(tmp_path / "run" / "map.npz", MapFile.of(sweep, compute(sweep), "r"))
    found = recognise([tmp_path / "run"])
    assert list(found.maps) == ["d"] and found.listed[0][1] == "Fig 11(d), 24 × 12 cells, periods = 40"
    assert 0.2 < found.maps["d"].helmholtz_fraction() < 0.6
    with pytest.raises(MapFileError, match=r"a second run of Fig 11\(d\)"):
        recognise([tmp_path / "run", tmp_path / "run" / "map.npz"])


def test_of_fig_10_and_fig_11d_the_longer_run_counts(tmp_path):
    paths = [tmp_path / "fig10.npz", tmp_path / "fig11d.npz"]
    for path, periods in zip(paths, ("40", "100"), strict=True):
        write_map_npz(path, painted("d", np.zeros((64, 128)), periods=periods))
    for runs in (paths, paths[::-1]):
        assert recognise(runs).maps["d"].periods == 100


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"settings": ("model=raman", "v_mid=0.2")}, "model = raman, v_mid = 0.2; should be delta_cremer"),
        ({"settings": ("model=stiff_cremer", "v_mid=0.25")}, "should be delta_cremer or stiff_cremer at 0.9, 0.2"),
        ({"settings": ("model=stiff_cremer", "v_mid=0.2", "mu_s=0.9")}, "mu_s = 0.9; should be 0.8"),
        ({"x_name": "v_b"}, "should be f_asym and f_init_ratio"),
        ({"x": np.geomspace(1, 20, 128)}, r"its axes are 1 \.\.\. 20 and 0 \.\.\. 2"),
        ({"transient_periods": np.full((64, 128), np.nan)}, "8192 cells are not computed"),
    ],
)
def test_what_is_no_map_of_the_paper_is_refused(change, words):
    plane = replace(painted("d", np.zeros((64, 128))), **change)
    with pytest.raises(MapFileError, match=words):
        letter_of(plane, "RUN")


# ---- measures


def test_a_vertical_stripe_is_explained_by_force_alone():
    x, y = np.meshgrid(X, Y)
    assert map_measures.explained((x > 4) & (x < 10), "x") == pytest.approx(1)
    assert map_measures.explained((x > 4) & (x < 10), "y") == 0
    assert map_measures.explained(y > 1, "y") == pytest.approx(1)
    assert map_measures.explained(np.zeros((3, 4), bool), "x") == 0


def test_the_largest_area_counts_neighbours_that_share_an_edge():
    mask = np.array([[1, 1, 0, 1], [0, 0, 1, 1], [1, 0, 1, 0]], bool)
    assert map_measures.largest_area(mask) == 4 / 12
    assert map_measures.largest_area(np.ones((3, 5), bool)) == 1
    assert map_measures.largest_area(np.zeros((3, 5), bool)) == 0


def test_unevenness_is_of_neighbours_that_both_came():
    assert map_measures.unevenness(np.array([[5, 10, 0, 90]])) == 0
    assert map_measures.unevenness(np.array([[5, 15, 20], [5, 15, np.nan]])) == pytest.approx(2 / 5)


@pytest.mark.parametrize("p", [0.0, 0.5, 1.0])
def test_curvature_finds_the_lines_that_were_drawn(p):
    x, y = np.meshgrid(X, Y)
    lines = np.sin(15 * (np.log(x) + p * np.log(y + 1e-9))) > 0
    shares = map_measures.curvature(painted("c", lines * 20.0), lines, (1, 10), claims_maps.EXPONENTS)
    assert claims_maps.EXPONENTS[int(np.argmax(shares))] == p


def test_the_force_limit_is_where_half_succeed():
    x, _ = np.meshgrid(X, Y)
    assert map_measures.force_limit(painted("f", (x < 9) * 20.0)) == pytest.approx(9, rel=0.05)


# ---- commands


def bow(*words) -> int:
    parser = argparse.ArgumentParser(prog="bow")
    commands = parser.add_subparsers(required=True)
    figure.add_command(commands)
    validate_command.add_command(commands)
    args = parser.parse_args([str(word) for word in words])
    return args.run(args)


def test_validate_prints_and_writes_and_exits_by_the_verdicts(tmp_path, capsys, monkeypatch):
    assert bow("validate", "--json", tmp_path / "v.json", "--markdown", tmp_path / "v.md") == 0
    out = capsys.readouterr().out
    assert "PASS" in out and "needs runs" in out
    assert json.loads((tmp_path / "v.json").read_text())["ok"]
    assert "| **pass** |" in (tmp_path / "v.md").read_text()
    monkeypatch.setattr(claims_modes, "Parameters", functools.partial(Parameters, mu_s=0.9))
    assert bow("validate") == 1
    assert "asked:" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["validate", "nowhere"], "nowhere: cannot be read as a map"),
        (["figure", "1", "--out", "f.png"], "figure 1: the paper's figures are 2 ... 12"),
        (["figure", "five", "--out", "f.png"], "figure five: the paper's"),
        (["figure", "9", "--out", "f.jpg"], "f.jpg: cannot draw as .jpg; should end in .png, .svg, .pdf"),
        (["figure", "9", "run", "--out", "f.png"], "only Figs 10 and 11 take one"),
        (["figure", "9", "--out", "no/such/f.png"], "--out no/such/f.png: cannot be written: No such file"),
        (["figure", "10", "--out", "f.png"], "figure 10: 0 runs given; should be one"),
        (["figure", "11", "--out", "f.png"], "figure 11: no runs given"),
    ],
)
def test_wrong_usage_is_one_clear_line(words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert bow(*words) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_maps_are_sorted_into_the_papers_layout(tmp_path, capsys, monkeypatch):
    drawn = []
    monkeypatch.setattr("bow_sweep.figures.maps.draw_maps", lambda planes, path: drawn.extend(planes))
    monkeypatch.setattr(
        "bow_sweep.figures.maps.draw_tests", lambda plane, path, periods: drawn.append((periods, plane))
    )
    for letter in "fca":
        (tmp_path / letter).mkdir()
        write_map_npz(tmp_path / letter / "map.npz", painted(letter, np.zeros((64, 128))))
    assert bow("figure", "11", *(tmp_path / letter for letter in "fca"), "--out", "f.png") == 0
    assert [title[:3] for title, _ in drawn] == ["(a)", "(c)", "(f)"]
    assert r"$v_\mathrm{mid}$ = −2" in drawn[2][0]
    assert bow("figure", "10", tmp_path / "c", "--out", "f.png") == 0
    assert drawn[3][0] == 40


def test_line_figures_and_maps_are_printed_in_one_style():
    assert maps.style is page.style
    with maps.style():
        assert {name: mpl.rcParams[name] for name in STYLE} == STYLE | {"font.family": ["DejaVu Sans"]}


@pytest.mark.parametrize("length", [0.0, 40.0])
def test_maps_without_streaks_fail_the_claims_about_streaks(length):
    maps = {letter: painted(letter, np.full((64, 128), length)) for letter in LAYOUT}
    assert verdicts(claims_terrain.CLAIMS.all, maps)["terrain-flyback"] == FAIL
