from dataclasses import replace

import numpy as np
import pytest
import read_rrd
from example_maps import HELMHOLTZ, SLIP, map_file

from bow_sweep.maps.map_file import MapFileError, write_map_npz
from bow_sweep.view.history import SUMMARY, main, write_history


def with_history():
    """Return a map that keeps the regimes of three tests."""
    regimes = np.full((3, 4, 8), SLIP, np.uint8)
    regimes[1, 3, 0] = HELMHOLTZ  # upper left; it regresses
    return replace(
        map_file(tests=3),
        regimes=regimes,
        helmholtz=regimes == HELMHOLTZ,
        confidence=np.full((3, 4, 8), 0.5, np.float32),
    )


def test_the_recording_steps_through_the_regimes_of_every_test(tmp_path):
    plane = with_history()
    path = tmp_path / "history.rrd"
    write_history(path, plane)
    assert not read_rrd.verify(path)
    times = [entry[0]["periods"] for entry in read_rrd.rows(path, "steps/regime", "SegmentationImage:buffer")]
    assert times == [5, 10, 15]
    seen = [read_rrd.image(path, "steps/regime", "SegmentationImage", "uint8", row)[0, 0] for row in range(3)]
    assert seen == [SLIP, HELMHOLTZ, SLIP]
    assert {f"summary/{name}" for name in SUMMARY} <= read_rrd.entities(path)
    regressions = read_rrd.image(path, "summary/regressions", "DepthImage", "float32")
    assert regressions[0, 0] == regressions.sum() == 1


def test_a_map_that_kept_no_history_has_none_to_show(tmp_path):
    with pytest.raises(MapFileError, match="keeps no regime of each test"):
        write_history(tmp_path / "history.rrd", map_file())


def test_a_place_that_cannot_be_written_is_named(tmp_path, monkeypatch):
    write_map_npz(tmp_path / "map.npz", with_history())
    (tmp_path / "history.rrd").mkdir()
    monkeypatch.setattr("sys.argv", ["history", str(tmp_path)])
    with pytest.raises(SystemExit, match=r"history.rrd: cannot be written"):
        main()
