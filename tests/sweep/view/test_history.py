from dataclasses import replace

import numpy as np
import pytest
import read_rrd
from example_maps import HELMHOLTZ, SLIP, map_file
from live_viewer import SLACK, eventually, headless_viewer, needs_vulkan, painted

from bow_sweep.figures.colours import GREY, regime_colours, transient_colours, viridis
from bow_sweep.maps.map_file import MapFileError, write_map_npz
from bow_sweep.view.history import STEPS, SUMMARY, main, write_history


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
    found = read_rrd.rows(path, "steps/regime/picture", "Image:buffer")
    assert [when["periods"] for when, _ in found] == [5, 10, 15]
    slip, helmholtz = (list(colour) for colour in np.array(regime_colours(plane.regime_names))[[SLIP, HELMHOLTZ]])
    assert [buffer[0][:3] for _, buffer in found] == [slip, helmholtz, slip]
    for part in ("picture", "axes/lines", "axes/labels", "axes/scale"):
        assert {f"summary/{name}/{part}" for name in SUMMARY} <= read_rrd.entities(path)
        assert {f"steps/{name}/{part}" for name in STEPS} <= read_rrd.entities(path)
    regressions = read_rrd.image(path, "summary/regressions/picture", "DepthImage", "float32")
    assert regressions[0, 0] == regressions.sum() == 1


@pytest.mark.full
def test_never_is_black_and_every_cell_has_the_colour_of_its_legend(tmp_path):
    needs_vulkan()
    plane = with_history()
    plane = replace(plane, transient_periods=np.minimum(plane.transient_periods, plane.periods))
    path = tmp_path / "history.rrd"
    write_history(path, plane)
    regime = np.array(regime_colours(plane.regime_names))[plane.regimes[-1]]
    half = np.broadcast_to(viridis(0.5).astype(int), (*plane.shape, 3))
    none = np.broadcast_to(np.array(GREY), (*plane.shape, 3))
    transient = transient_colours(plane.transient_periods, plane.periods).astype(int)
    assert (transient[plane.transient_periods == 0] == 0).all()
    assert (plane.transient_periods == 0).sum() == 8
    wanted = {
        "/summary/transient": transient,
        "/steps/regime": regime,
        "/steps/confidence": half,
        "/summary/flattening": none,
    }
    with headless_viewer() as viewer:
        viewer.open(str(path))

        def is_right() -> bool:  # as soon as the notices in the corner of the window have gone
            viewer.show(*wanted)
            pictures = viewer.pictures(*wanted)
            return all(
                (abs(painted(pictures[origin], plane.shape) - want[:, :, None]).max(axis=-1) <= SLACK).all()
                for origin, want in wanted.items()
            )

        eventually(is_right, "every cell has the colour of its legend")
        assert {view.origin: view.reports for view in viewer.client.get_state().views if view.reports} == {}


def test_a_map_that_kept_no_history_has_none_to_show(tmp_path):
    with pytest.raises(MapFileError, match="keeps no regime of each test"):
        write_history(tmp_path / "history.rrd", map_file())


def test_a_place_that_cannot_be_written_is_named(tmp_path, monkeypatch):
    write_map_npz(tmp_path / "map.npz", with_history())
    (tmp_path / "history.rrd").mkdir()
    monkeypatch.setattr("sys.argv", ["history", str(tmp_path)])
    with pytest.raises(SystemExit, match=r"history.rrd: cannot be written"):
        main()
