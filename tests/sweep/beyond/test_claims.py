"""The claims beyond the paper, and `bow validate --beyond`."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bow_classifier.verdict.regimes import REGIMES
from bow_sweep.beyond import claims_linear
from bow_sweep.beyond.claim import MET, MISSED, NEEDS_RUNS
from bow_sweep.beyond.report import CLAIMS, check, write
from bow_sweep.beyond.sweeps import SWEEPS, differences
from bow_sweep.cli import main
from bow_sweep.maps.in_process import compute
from bow_sweep.maps.map_file import MapFile, write_map_npz

BY_KEY = {claim.key: claim for claim in CLAIMS}
HELMHOLTZ, SLIP = REGIMES.index("helmholtz"), REGIMES.index("multiple_slip")


def small_map(name: str) -> MapFile:
    sweep = SWEEPS[name].sweep(small=True)
    return MapFile.of(sweep, compute(sweep), "0" * 16)


def verdict(key: str, maps: dict[str, MapFile] | None = None) -> str:
    row, finding = BY_KEY[key].judge(maps or {})
    assert finding is None or row.found
    return row.verdict


@pytest.mark.parametrize("key", ["two-peaks", "reflection"])
def test_the_linear_theory_of_a_string_with_a_body_is_met(key: str) -> None:
    assert verdict(key) == MET


def test_a_body_that_gives_energy_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = claims_linear.bridge_response
    monkeypatch.setattr(claims_linear, "bridge_response", lambda body, samples: 1.001 * honest(body, samples))
    assert verdict("reflection") == MISSED


@pytest.mark.full
@pytest.mark.parametrize(
    "key",
    [
        "off",
        "steady-sliding",
        "thermal-violin",
        "thermal-double-slip",
        "guettler-ideal",
        "linearised",
        "exponent-sliding",
        "exponent-motion",
    ],
)
def test_claims_about_strings_have_the_verdict_that_the_documentation_gives(key: str, root: Path) -> None:
    (line,) = (line for line in (root / "docs/validation.md").read_text().splitlines() if BY_KEY[key].claim in line)
    assert f"**{verdict(key)}**" in line


@pytest.mark.full
def test_soft_hair_makes_a_wedge_of_tatters() -> None:
    soft, rigid = small_map("guettler_b"), small_map("guettler_rigid")
    assert verdict("guettler-hair", {"guettler_b": soft, "guettler_rigid": rigid}) == MET
    assert verdict("guettler-hair", {"guettler_b": rigid, "guettler_rigid": rigid}) == MISSED


@pytest.mark.full
def test_the_wolf_of_1983_beats_as_it_did() -> None:
    assert verdict("wolf-beat", {"wolf": small_map("wolf")}) == MET


def painted(name: str, regime: np.ndarray) -> MapFile:
    """A map of a sweep that looks like this: regimes of shape (ny, nx) at the last test."""
    sweep = SWEEPS[name].sweep(small=True)
    shape, tests = (sweep.y.count, sweep.x.count), sweep.chunks
    zeros = np.zeros((tests, *shape))
    return MapFile(
        run_id="0" * 16, sweep_id=sweep.sweep_id, x_name=sweep.x.name, y_name=sweep.y.name,
        x=sweep.x.values(), y=sweep.y.values(), transient_periods=np.zeros(shape, np.float32),
        regime=regime.astype(np.uint8), regime_names=tuple(REGIMES), settings=sweep.settings(),
        test_periods=np.arange(1, tests + 1) * 5, correlation=zeros.astype(np.float32),
        period=(zeros + 139).astype(np.float32), slips=zeros.astype(np.uint16), corners=zeros.astype(np.uint16),
        helmholtz=zeros.astype(bool),
    )  # fmt: skip


def mode_at_f_0(first: float, with_mode: float) -> MapFile:
    x = SWEEPS["mode_at_f_0"].sweep(small=True).x.values()
    return painted("mode_at_f_0", np.where(x > np.array([[first], [with_mode]]), HELMHOLTZ, SLIP))


def test_a_claim_over_a_map_is_met_by_the_map_it_describes_and_missed_by_others() -> None:
    assert verdict("mode-at-f0", {"mode_at_f_0": mode_at_f_0(2.0, 6.0)}) == MET
    assert verdict("mode-at-f0", {"mode_at_f_0": mode_at_f_0(2.0, 2.0)}) == MISSED
    assert verdict("mode-at-f0", {"mode_at_f_0": painted("mode_at_f_0", np.full((2, 17), SLIP))}) == MISSED
    assert verdict("mode-at-f0") == NEEDS_RUNS


def test_guettlers_plane_of_warm_rosin_is_drawn_without_his_bounds(tmp_path: Path) -> None:
    maps = {name: painted(name, np.full((16, 16), HELMHOLTZ)) for name in ("guettler_rigid", "guettler_thermal")}
    check(maps, tmp_path, ["guettler-thermal"], small=True)
    assert (tmp_path / "figures/guettler-thermal.png").read_bytes().startswith(b"\x89PNG")


def test_every_claim_has_a_name_of_its_own_and_its_sweeps_can_be_run() -> None:
    assert len(BY_KEY) == len(CLAIMS)
    assert {name for claim in CLAIMS for name in claim.needs} == set(SWEEPS)
    for wanted in SWEEPS.values():
        assert wanted.sweep(small=True).cells <= wanted.sweep().cells


def test_a_map_with_another_setting_is_no_map_of_the_sweep() -> None:
    plane, sweep = mode_at_f_0(2.0, 6.0), SWEEPS["mode_at_f_0"].sweep(small=True)
    assert differences(plane, sweep) == []
    changed = replace(plane, settings=tuple(s.replace("v_mid=0.2", "v_mid=0.9") for s in plane.settings))
    assert differences(changed, sweep) == ["v_mid = 0.9, should be 0.2"]


def test_the_page_has_a_row_a_figure_and_the_numbers_of_each_claim(tmp_path: Path) -> None:
    report = check({"mode_at_f_0": mode_at_f_0(2.0, 2.0)}, tmp_path, ["mode-at-f0", "wolf-beat"], small=True)
    assert not report.ok
    assert report.counts == {MET: 0, "near": 0, MISSED: 1, "reported": 0, NEEDS_RUNS: 1}
    write(report, tmp_path)
    page, table = (tmp_path / "index.html").read_text(), (tmp_path / "claims.md").read_text()
    assert 'src="figures/mode-at-f0.png"' in page
    assert (tmp_path / "figures/mode-at-f0.png").read_bytes().startswith(b"\x89PNG")
    assert page.count("<h2") == 2 == sum(line.startswith(("| 1", "| 2")) for line in table.splitlines())
    assert "coarse maps" in report.to_text()
    rows = {row["key"]: row for row in json.loads((tmp_path / "claims.json").read_text())["rows"]}
    assert rows["mode-at-f0"]["values"]["limit with the mode"]["verdict"] == MISSED
    assert "off: " in report.to_text(100)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--claim", "wolf"], "--claim wolf: no such claim; one of off, "),
        (["some-run"], "--beyond makes its own runs in --out DIR and writes its table there; give no RUN"),
        (["--json", "f.json"], "give no RUN, --json or --markdown"),
        (["--simulators", "0"], "--simulators 0: should be at least 1"),
        (["--out", "file"], "--out file: is a file; should be a directory"),
        (["--out", "other", "--small"], "other/mode_at_f_0: not the sweep mode_at_f_0: v_mid = 0.9, should be 0.2"),
    ],
)
def test_wrong_usage_is_one_clear_line(words, message, capsys, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    (tmp_path / "other" / "mode_at_f_0").mkdir(parents=True)
    plane = mode_at_f_0(2.0, 6.0)
    changed = replace(plane, settings=tuple(s.replace("v_mid=0.2", "v_mid=0.9") for s in plane.settings))
    write_map_npz(tmp_path / "other" / "mode_at_f_0" / "map.npz", changed)
    before = sorted(tmp_path.rglob("*"))
    assert main(["validate", "--beyond", *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_options_of_the_second_page_are_refused_on_the_first(capsys) -> None:
    assert main(["validate", "--no-runs"]) == 2
    assert "--no-runs is for the claims beyond the paper; give it with --beyond" in capsys.readouterr().err


def test_without_runs_the_claims_about_maps_say_which_they_need(capsys, tmp_path) -> None:
    words = ["--claim", "mode-at-f0", "--no-runs", "--out", str(tmp_path / "page")]
    assert main(["validate", "--beyond", *words]) == 0
    assert "no run of mode_at_f_0" in capsys.readouterr().out
    assert (tmp_path / "page" / "index.html").exists()


@pytest.mark.full
@pytest.mark.usefixtures("ros_domain")
def test_the_runs_are_made_through_the_graph_once_and_taken_the_next_time(capfd, tmp_path) -> None:
    words = ["validate", "--beyond", "--small", "--claim", "mode-at-f0", "--out", str(tmp_path / "page")]
    assert main(words) == 0
    assert "1 of 1 runs are to be made" in capfd.readouterr().err
    run = tmp_path / "page" / "mode_at_f_0"
    written = (run / "map.npz").stat().st_mtime_ns
    assert main(words) == 0
    assert "to be made" not in capfd.readouterr().err
    assert (run / "map.npz").stat().st_mtime_ns == written
    assert any((run / "bag").glob("*.mcap"))
    (run / "map.npz").unlink()  # as where the command was interrupted before its end
    assert main(words) == 0
    assert (run / "map.npz").exists()
    assert main(["verify", str(run)]) == 0
