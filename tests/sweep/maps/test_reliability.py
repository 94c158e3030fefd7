"""What repeats say of a map: shares that end alike, regimes, spread of transients; in map.npz, picture and report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import recording
from recording import whats
from small_graph import SmallGraph

import bow
from bow.tables import columns
from bow_sweep.cell.parting import median_parting, onsets_of, parting, partings
from bow_sweep.cell.run_cells import RunCells
from bow_sweep.cli import main
from bow_sweep.figures.colours import GREY
from bow_sweep.figures.reliability import draw_repeats, reliability_colours, repeats_figure
from bow_sweep.maps.map_file import MapFileError, read_map
from bow_sweep.maps.reliability import Reliability, in_words
from bow_sweep.plan.sweep import Sweep
from bow_sweep.record.replay import replay
from bow_sweep.record.verify import verify

HELMHOLTZ, SLIP, APERIODIC = 1, 2, 5
REPEATED = recording.small_sweep("repeats=3", "jitter=0.2", "seed=5")


def of(regimes: list[list[int]], lengths: list[list[float]], done: list[list[bool]] | None = None) -> Reliability:
    """Of a plane of one row, from lists with a row for the cells and one for each repeat."""
    given = np.array(regimes), np.array(lengths, np.float32)
    known = np.ones(given[0].shape, bool) if done is None else np.array(done)
    return Reliability.of((1, given[0].shape[1]), *(each.ravel() for each in (*given, known)))


def test_shares_are_those_of_the_repeats_and_the_cell_itself_does_not_count() -> None:
    found = of(
        [[HELMHOLTZ, SLIP], [HELMHOLTZ, SLIP], [SLIP, SLIP], [APERIODIC, SLIP], [HELMHOLTZ, SLIP]],
        [[20, 0], [20, 0], [0, 0], [0, 0], [25, 0]],
    )
    assert found.reliability.tolist() == [[0.5, 1.0]]
    assert found.same_transient.tolist() == [[0.25, 1.0]]
    assert found.repeat_regimes[:, 0, 0].tolist() == [0, 0.5, 0.25, 0, 0, 0.25, *[0] * (len(found.repeat_regimes) - 6)]
    assert found.reliable.tolist() == [[False, True]]


def test_nine_of_ten_is_reliable() -> None:
    repeats = [[HELMHOLTZ]] * 9 + [[SLIP]]
    assert of([[HELMHOLTZ], *repeats], [[10]] * 11).reliable.all()
    assert not of([[HELMHOLTZ], *repeats[1:], [SLIP]], [[10]] * 11).reliable.any()


def test_never_is_the_longest_transient() -> None:
    lengths = [10, 15, 20, 25, 30, 35, 40, 45, 50, 0]
    found = of([[HELMHOLTZ]] * 11, [[99], *[[length] for length in lengths]])
    assert (found.transient_low.item(), found.transient_high.item()) == (10, 50)
    found = of([[HELMHOLTZ]] * 11, [[99], *[[length] for length in [*lengths[:8], 0, 0]]])
    assert (found.transient_low.item(), found.transient_high.item()) == (10, 0)


def test_what_is_not_done_does_not_count() -> None:
    found = of(
        [[HELMHOLTZ, HELMHOLTZ, HELMHOLTZ], [SLIP, HELMHOLTZ, SLIP], [HELMHOLTZ, HELMHOLTZ, SLIP]],
        [[20, 20, 20], [0, 20, 0], [20, 20, 0]],
        [[True, False, True], [False, True, False], [True, True, False]],
    )
    assert np.array_equal(found.reliability, [[1, np.nan, np.nan]], equal_nan=True)
    assert np.array_equal(found.transient_low, [[20, 20, np.nan]], equal_nan=True)
    assert found.repeats_done.tolist() == [[1, 2, 0]]
    assert found.known.tolist() == [[True, False, False]]
    assert found.findings(REPEATED.repeats, np.ones((1, 3), bool))["verdict_changed"] == 0


def test_a_plane_without_repeats_has_no_reliability() -> None:
    assert of([[HELMHOLTZ]], [[5]]) is None


def test_findings_are_shares_of_cells_and_of_repeats() -> None:
    found = of([[HELMHOLTZ, SLIP], [SLIP, SLIP], [HELMHOLTZ, SLIP]], [[20, 0], [0, 0], [25, 0]])
    made = found.findings(Sweep.from_spec("", ["repeats=2"]).repeats, np.array([[True, False]]))
    assert made == {
        "repeats": 2,
        "jitter": 0.01,
        "seed": 0,
        "reliable": 0.5,
        "reliable_helmholtz": 0.0,
        "verdict_changed": 0.25,
        "transient_changed": 0.5,
    }
    assert in_words(made)[0].endswith("reliable in 0.500 of the cells, 0.000 of those with Helmholtz motion")


def test_an_interrupted_sweep_with_repeats_ends_as_an_undisturbed_one_and_is_verified(tmp_path: Path) -> None:
    run, whole = tmp_path / "run", tmp_path / "whole"
    SmallGraph(run, REPEATED, cut_after=17).run()
    SmallGraph(run, REPEATED, again=True).run()
    SmallGraph(whole, REPEATED).run()
    account = verify(run)
    assert account["ok"], whats(account)
    assert (account["cells"], account["cells_planned"]) == (48, 48)
    one, other = read_map(run), read_map(whole)
    assert one.shape == (3, 4)
    for name, values in one.reliability.arrays().items():
        assert values.tobytes() == getattr(other.reliability, name).tobytes()
    report = json.loads((run / "report.json").read_text())
    assert sum(report["regimes"].values()) == 12
    assert report["repeats"] == one.reliability.findings(REPEATED.repeats, one.transient_periods > 0)
    assert 0 < report["repeats"]["verdict_changed"] < 1
    again = replay(run)
    assert again["ok"]
    assert (again["cells"], again["repeats"]) == (48, report["repeats"])


@pytest.fixture(scope="module")
def repeated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("repeated") / "run"
    SmallGraph(run, REPEATED).run()
    return run


def test_the_cells_of_a_map_with_repeats_are_those_of_the_map_without(repeated: Path, tmp_path: Path) -> None:
    plain = tmp_path / "plain"
    SmallGraph(plain, recording.small_sweep()).run()
    one, other = read_map(repeated), read_map(plain)
    assert other.reliability is None
    for name in ("transient_periods", "regimes", "correlation", "period", "slips", "corners", "confidence"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()


@pytest.mark.parametrize("name", ["reliability", "same_transient", "repeats_done", "transient_high"])
def test_a_changed_value_of_the_repeats_is_found(repeated: Path, name: str) -> None:
    path = repeated / "map.npz"
    before = path.read_bytes()
    with np.load(path) as file:
        arrays = dict(file)
    arrays[name][1, 2] += 1
    np.savez(path, **arrays)
    try:
        assert whats(verify(repeated)) == f"{name} differs from the verdicts in 1 places, first at cell 6"
        del arrays[name]
        np.savez(path, **arrays)
        assert f"holds no {name}" in whats(verify(repeated))
        if name != "reliability":
            with pytest.raises(MapFileError, match=f"map.npz: {name} is missing"):
                read_map(repeated)
    finally:
        path.write_bytes(before)


def test_a_repeat_is_read_from_the_bag_computed_again_and_compared_with_its_cell(repeated: Path) -> None:
    with RunCells(repeated) as cells:
        assert (cells.cells, cells.repeats) == (12, 3)
        itself, recorded = cells.record(6), cells.record(2 * 12 + 6, "bag")
        computed = cells.record(2 * 12 + 6, "computed")
        with pytest.raises(ValueError, match=r"cell 48: there is none; .* 0 \.\.\. 11, and 3 repeats of each"):
            cells.record(48)
    assert recorded.checked and computed.checked
    assert recorded.bridge_force.tobytes() == computed.bridge_force.tobytes() != itself.bridge_force.tobytes()
    assert recorded.title.startswith("cell 30, repeat 2: f_asym")
    assert (recorded.x, recorded.y) == (itself.x, itself.y)
    assert recorded.parameters == itself.parameters.replace(
        **{name: float(values[0]) for name, values in REPEATED.lanes(np.array([30])).items()}
    )
    share = read_map(repeated).reliability.repeat_regimes[recorded.tests.regime[-1], 1, 2]
    assert share > 0
    assert 0 < parting(itself, recorded, itself.period) < 20
    assert parting(itself, itself, itself.period) == np.inf


def test_motions_part_at_the_first_slip_that_begins_more_than_three_samples_apart(repeated: Path) -> None:
    with RunCells(repeated) as cells:
        base = cells.record(6)
    onsets = np.array([100, 239, 378])
    one = replace(base, onsets=onsets)
    assert parting(one, replace(base, onsets=onsets + np.array([0, 3, -3])), 139) == np.inf
    assert parting(one, replace(base, onsets=onsets + np.array([0, 3, -4])), 139) == 374 / 139
    assert parting(one, replace(base, onsets=onsets[:2]), 139) == 378 / 139
    assert parting(replace(base, onsets=onsets[:0]), one, 139) == 100 / 139


def test_the_partings_of_a_run_are_those_of_its_waveforms(repeated: Path, tmp_path: Path) -> None:
    with RunCells(repeated) as cells:
        assert cells.bag is not None
        found = partings(cells.bag)
        records = [cells.record(cell, "bag") for cell in range(48)]
        for block, numbers in ((0, range(5)), (3, range(15, 20))):
            for onsets, number in zip(onsets_of(cells.bag, block), numbers, strict=True):
                assert onsets.tolist() == records[number].onsets.tolist()
    assert found.shape == (3, 3, 4)
    expected = [parting(records[cell % 12], records[cell], 139) for cell in range(12, 48)]
    assert found.ravel().tolist() == np.float32(expected).tolist()
    assert 0 < np.isfinite(found).mean() <= 1


@pytest.mark.parametrize("record", ["last", "verdicts"])
def test_slips_that_are_not_recorded_are_computed_again_and_must_have_the_recorded_checksum(
    repeated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, record: str
) -> None:
    with RunCells(repeated) as cells:
        assert cells.bag is not None
        right = partings(cells.bag)
        sweep = cells.sweep
    run = recording.record(tmp_path / "run", replace(sweep, record=record))
    with RunCells(run) as cells:
        assert cells.bag is not None
        np.testing.assert_array_equal(partings(cells.bag), right)
        known = cells.bag.checksum
        monkeypatch.setattr(cells.bag, "checksum", lambda block, chunk: known(block, chunk) ^ (block == 0))
        found = partings(cells.bag)
    assert np.isnan(found[:, 0]).all()  # block 0 has cells 0 ... 4
    np.testing.assert_array_equal(found[:, 2], right[:, 2])


def test_the_median_of_partings_is_one_of_them_and_never_is_the_last() -> None:
    inf, nan = np.inf, np.nan
    columns = np.array([[3, 1, 2], [inf, 1, inf], [4, 1, nan], [nan, nan, nan], [2, 8, 4]], np.float32).T
    assert median_parting(columns[:, None])[0].tolist()[:3] == [2, inf, 1]
    assert np.isnan(median_parting(columns[:, None])[0, 3])
    assert median_parting(columns[:, None])[0, 4] == 4


def test_the_dataset_and_the_table_of_a_map_have_what_repeats_say_of_each_cell(repeated: Path) -> None:
    found, sure = bow.open(repeated), read_map(repeated).reliability
    for name in ("reliability", "same_transient", "repeats_done", "transient_low", "transient_high"):
        assert found.ds[name].dims == ("f_init_ratio", "f_asym")
        assert found.ds[name].values.tobytes() == getattr(sure, name).tobytes()
        assert columns(found)[name].tobytes() == getattr(sure, name).tobytes()


def test_the_picture_of_the_repeats_says_where_motions_never_part(repeated: Path, tmp_path: Path) -> None:
    plane = read_map(repeated)
    parted = np.full((3, 4), 10.0)
    parted[0, 0], parted[2, 3] = np.inf, np.nan
    texts = [text.get_text() for text in repeats_figure(plane, parted, 50).texts]
    assert "never  9.1 %" in texts
    draw_repeats(plane, None, tmp_path / "repeats.png")
    assert (tmp_path / "repeats.png").stat().st_size > 1000


def test_the_command_says_what_the_repeats_say(repeated: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(["repeats", str(repeated), "--npz", str(tmp_path / "p.npz")]) == 0
    said = capsys.readouterr().out
    assert "3 repeats with forces up to 20 % off: reliable in" in said
    assert "motions part after" in said
    with np.load(tmp_path / "p.npz") as file:
        assert file["parting"].shape == (3, 3, 4)
    plain = tmp_path / "plain"
    SmallGraph(plain, recording.small_sweep()).run()
    assert main(["repeats", str(plain)]) == 2
    assert "its cells were not repeated; sweep again with --set repeats=8" in capsys.readouterr().err


def test_the_surer_a_cell_the_brighter_and_unknown_is_grey() -> None:
    shares = np.array([0, 0.5, 0.9, 1, np.nan], np.float32)
    brightness = reliability_colours(shares).astype(int).sum(axis=-1)
    assert (np.diff(brightness[:4]) > 0).all()
    assert reliability_colours(shares)[4].tolist() == list(GREY)
