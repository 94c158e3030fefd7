import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from example_maps import REGIMES, RUN, SWEEP, map_file

from bow_sweep.maps.map_file import TESTS, MapFileError, read_map_npz, write_map_npz


def names(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


def test_a_map_comes_back_as_it_was_written(tmp_path):
    path = tmp_path / "map.npz"
    written = map_file(computed=20)
    write_map_npz(path, written)
    read = read_map_npz(path)
    for name in ("run_id", "sweep_id", "x_name", "y_name", "regime_names", "settings", "preset"):
        assert getattr(read, name) == getattr(written, name), name
    for name in ("x", "y", "transient_periods", "regime", "test_periods", *TESTS):
        np.testing.assert_array_equal(getattr(read, name), getattr(written, name), err_msg=name)
    assert names(tmp_path) == ["map.npz"]


def test_the_file_holds_what_the_design_promises(tmp_path):
    write_map_npz(tmp_path / "map.npz", map_file())
    with np.load(tmp_path / "map.npz", allow_pickle=False) as file:
        assert file["f_asym"].shape == (8,)
        assert file["f_init_ratio"].shape == (4,)
        assert file["transient_periods"].shape == file["regime"].shape == (4, 8)
        assert (file["transient_periods"][1] == 0).all()  # never
        assert tuple(file["regime_names"]) == REGIMES
        for name in ("correlation", "slips", "corners", "period"):
            assert file[name].shape == (20, 4, 8), name
        assert (str(file["run_id"]), str(file["sweep_id"])) == (RUN, SWEEP)
        assert "v_mid=0.2" in file["settings"]


def test_an_axis_that_is_called_like_a_test_is_kept_apart(tmp_path):
    write_map_npz(tmp_path / "map.npz", replace(map_file(), x_name="period"))
    read = read_map_npz(tmp_path / "map.npz")
    assert read.x_name == "period"
    assert read.x == pytest.approx(map_file().x)
    assert read.period.shape == (20, 4, 8)


def test_arrays_that_do_not_fit_are_refused_and_nothing_is_written(tmp_path):
    with pytest.raises(MapFileError, match=r"slips: shape \(19, 4, 8\), should be \(20, 4, 8\)"):
        write_map_npz(tmp_path / "map.npz", replace(map_file(), slips=map_file().slips[1:]))
    assert names(tmp_path) == []


def test_an_older_map_survives_a_failed_write(tmp_path, monkeypatch):
    path = tmp_path / "map.npz"
    write_map_npz(path, map_file())
    before = path.read_bytes()
    monkeypatch.setattr(os, "replace", lambda *_: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        write_map_npz(path, map_file(computed=3))
    assert path.read_bytes() == before
    assert names(tmp_path) == ["map.npz"]


@pytest.mark.parametrize("content", [b"", b"no map", b"PK\x03\x04 cut off", b"\x93NUMPY\x01\x00"])
def test_a_file_that_is_not_a_map_is_refused_by_name(tmp_path, content):
    path = tmp_path / "map.npz"
    path.write_bytes(content)
    with pytest.raises(MapFileError, match=r"map\.npz"):
        read_map_npz(path)


def test_an_npz_of_something_else_is_refused_by_the_missing_array(tmp_path):
    np.savez(tmp_path / "other.npz", a=np.arange(3))
    with pytest.raises(MapFileError, match="no array 'run_id'"):
        read_map_npz(tmp_path / "other.npz")
    with pytest.raises(MapFileError, match="No such file"):
        read_map_npz(tmp_path / "none.npz")


def test_the_coordinators_verdicts_become_a_map():
    from bow_classifier.verdict.regimes import REGIMES as NAMES
    from bow_sweep.maps.basin_map import Basin
    from bow_sweep.maps.map_file import MapFile
    from bow_sweep.plan.sweep import Sweep

    sweep = Sweep.from_spec("", ["x.count=4", "y.count=2", "periods=10", "block_cells=4"])
    basin = Basin(4, 2, 2)
    for test in range(2):
        verdict = {
            "correlation": np.full(4, 0.99, np.float32),
            "period": np.full(4, 139.5, np.float32),
            "slips": np.full(4, 5, np.uint16),
            "corners": np.full(4, 5, np.uint16),
            "regime": np.array(
                [NAMES.index("helmholtz" if test >= late else "aperiodic") for late in (0, 1, 2, 0)], np.uint8
            ),
            "confidence": np.ones(4, np.float32),
            "beat": np.full(4, np.nan, np.float32),
            "transient": np.full(4, np.nan, np.float32),
        }
        basin.take(test, np.arange(4, dtype=np.uint32), verdict)
    missing = np.arange(8) >= 3  # cell 3 has verdicts, but its block was given up
    result = MapFile.of(sweep, basin, RUN, missing)
    assert result.transient_periods[0, :3].tolist() == [5, 10, 0]
    assert np.isnan(result.transient_periods.ravel()[3:]).all()
    assert result.helmholtz[:, 0, :3].tolist() == [[True, False, False], [True, True, False]]
    assert result.regimes[:, 0, 1].tolist() == [NAMES.index("aperiodic"), NAMES.index("helmholtz")]
    assert (result.confidence[:, 0, :3] == 1).all()
    assert result.test_periods.tolist() == [5, 10]
    assert result.sweep_id == sweep.sweep_id
    assert result.periods == 10
    assert result.simulated is None


def test_which_cells_were_simulated_is_kept(tmp_path):
    result = replace(map_file(), simulated=np.arange(32).reshape(4, 8) % 3 == 0)
    write_map_npz(tmp_path / "map.npz", result)
    assert np.array_equal(read_map_npz(tmp_path / "map.npz").simulated, result.simulated)
    with pytest.raises(MapFileError, match="simulated"):
        write_map_npz(tmp_path / "map.npz", replace(result, simulated=np.ones((3, 3), bool)))


def with_history():
    """A map in which cell (0, 0) passed, regressed and ends in double slip, and cell (1, 0) is flattened."""
    plain = map_file(tests=3)
    regimes = np.full((3, 4, 8), REGIMES.index("helmholtz"), np.uint8)
    regimes[1:, 0, 0] = REGIMES.index("multiple_slip")
    period, slips = plain.period.copy(), plain.slips.copy()
    period[2, 0, 1], slips[2, 0, 0] = 139 * 2 ** (1 / 120), 10
    return replace(
        plain, regimes=regimes, helmholtz=regimes == REGIMES.index("helmholtz"), regime=regimes[-1], period=period,
        slips=slips, confidence=np.full((3, 4, 8), 0.75, np.float32),
    )  # fmt: skip


def test_the_history_of_every_cell_is_kept_and_what_follows_from_it_is_written_too(tmp_path):
    write_map_npz(tmp_path / "map.npz", with_history())
    read = read_map_npz(tmp_path / "map.npz")
    for name in ("regimes", "confidence"):
        np.testing.assert_array_equal(getattr(read, name), getattr(with_history(), name))
    assert read.regressions[0, :2].tolist() == [1, 0]
    assert read.flattening[0, 1] == pytest.approx(10, abs=1e-3)
    assert np.isnan(read.flattening[0, 0])  # no Helmholtz motion at the end
    assert read.count[0, :2].tolist() == [2, 1]
    with np.load(tmp_path / "map.npz", allow_pickle=False) as file:
        for name in ("regressions", "flattening", "count"):
            np.testing.assert_array_equal(file[name], getattr(read, name), err_msg=name)


def test_a_map_from_before_there_was_a_history_is_read_without(tmp_path):
    write_map_npz(tmp_path / "map.npz", map_file())
    read = read_map_npz(tmp_path / "map.npz")
    assert read.regimes is None
    assert read.confidence is None


def test_helmholtz_motion_with_extra_slips_has_a_transient_length_like_any():
    from bow_classifier.verdict.regimes import REGIMES as NAMES
    from bow_sweep.maps.basin_map import Basin

    basin = Basin(2, 1, 2)
    for test, names_ in enumerate((["aperiodic", "helmholtz_extra_slips"], ["helmholtz_extra_slips", "multiple_slip"])):
        verdict = dict.fromkeys(("correlation", "period", "slips", "corners", "confidence"), 1)
        verdict |= dict.fromkeys(("beat", "transient"), np.nan)
        regime = np.array([NAMES.index(name) for name in names_], np.uint8)
        basin.take(test, np.arange(2), {**verdict, "regime": regime})
    assert basin.transient_periods.tolist() == [10, 5]
    assert basin.helmholtz_fraction() == 1


def guettlers(tests=3):
    """A map of Guettler's gesture: cell (0, 0) ends with 7.3 periods, (0, 1) was regular at once, (0, 2) never."""
    from bow_sweep.maps.basin_map import Basin
    from bow_sweep.maps.map_file import MapFile
    from bow_sweep.plan.sweep import Sweep

    sweep = Sweep.from_spec("", ["x.count=4", "y.count=2", "periods=15", "block_cells=4", "gesture=guettler"])
    basin = Basin(4, 2, tests)
    for test, transient in enumerate(([0, 0.01, 0, 2.5], [2.1, 0.01, 0, 2.5], [7.3, 0.01, 0, 2.5])):
        verdict = dict.fromkeys(("correlation", "period", "slips", "corners", "confidence", "beat"), np.nan)
        verdict |= {"slips": 5, "corners": 5, "regime": REGIMES.index("helmholtz"), "transient": transient}
        basin.take(test, np.arange(4), verdict)
    return basin, MapFile.of(sweep, basin, RUN, np.arange(8) >= 4)


def test_the_transient_of_guettlers_gesture_is_that_of_the_latest_verdict_whatever_the_tests_say(tmp_path):
    basin, result = guettlers()
    assert result.transient_periods[0].tolist() == pytest.approx([7.3, 0.01, 0, 2.5])
    assert basin.helmholtz_fraction() == 3 / 8
    write_map_npz(tmp_path / "map.npz", result)
    read = read_map_npz(tmp_path / "map.npz")
    assert read.transient[:, 0, 0].tolist() == pytest.approx([0, 2.1, 7.3])
    assert read.beat is None, "there is no wolf in the whole map"


def test_the_transient_known_at_each_test_is_shown_at_that_test():
    from bow_sweep.view.tests_over_time import at_each_test

    _, result = guettlers()
    shown = [snapshot.transient_periods[0, 0] for _, snapshot in at_each_test(result)]
    assert shown[1:] == pytest.approx([0, 2.1, 7.3])


def test_perfect_cells_are_counted_for_guettlers_gesture_only():
    from bow_sim.protocol.repeats import Repeats
    from bow_sweep.run.directory import findings

    lengths, regimes = guettlers()[1].transient_periods, np.zeros(4, np.uint8)
    assert findings(lengths, regimes, "guettler", Repeats(), None)["perfect_fraction"] == 1 / 8
    assert "perfect_fraction" not in findings(lengths, regimes, "accelerate_to", Repeats(), None)


def test_the_beats_of_wolves_are_kept(tmp_path):
    beat = np.full((3, 4, 8), np.nan, np.float32)
    beat[2, 1, 3] = 12.5
    write_map_npz(tmp_path / "map.npz", replace(with_history(), beat=beat))
    assert read_map_npz(tmp_path / "map.npz").beat[2, 1, 3] == 12.5
    with pytest.raises(MapFileError, match="beat"):
        write_map_npz(tmp_path / "map.npz", replace(with_history(), beat=beat[:2]))
