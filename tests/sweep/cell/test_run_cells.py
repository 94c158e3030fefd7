"""Cells of a run: chosen by their parameters, the same bits from the bag and from the kernel, and checked."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import recording

from bow_sim.kernel.block import transient
from bow_sim.protocol import cdr
from bow_sweep.cell import run_cells
from bow_sweep.cell.run_cells import RunCells
from bow_sweep.cell.waveform import CellError
from bow_sweep.maps.map_file import MAP, read_map
from bow_sweep.record.bag import bag_files


def damage(run: Path, cell: int) -> None:
    """Change one byte of the last sample of the third chunk of a cell, in the bag's file."""
    sweep = recording.small_sweep()
    block = next(number for number in range(sweep.blocks) if cell in sweep.block(number))
    row = sweep.block(block).tolist().index(cell)
    sample = recording.chunks(sweep, block)[2].bridge_force
    values = cdr.unseal("BridgeForce", sample)
    own = values["data"].reshape(-1, values["samples"])[row].tobytes()
    (path,) = bag_files(run / "bag")
    content = bytearray(path.read_bytes())
    at = content.index(own) + len(own) - 1
    content[at] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize("cell", [0, 4, 5, 11])
def test_a_cell_is_the_same_from_the_bag_and_computed_again(complete: Path, cell: int) -> None:
    with RunCells(complete) as cells:
        bag, computed = cells.record(cell), cells.record(cell, "computed")
    assert (bag.source, bag.checked) == ("bag", True)
    assert (computed.source, computed.checked) == ("computed", True)
    assert "equal to the bag" in computed.why
    assert bag.bridge_force.tobytes() == recording.recorded_force(complete, cell).tobytes()
    assert bag.differs_from(computed) is None
    alone = transient(bag.parameters)
    assert bag.bridge_force.tobytes() == alone["bridge_force"].astype(np.float32).tobytes()
    assert np.array_equal(bag.slipping, alone["slipping"])


def test_a_slip_that_a_border_of_chunks_cuts_is_one_slip(complete: Path) -> None:
    with RunCells(complete) as cells:
        everything = [cells.record(cell) for cell in range(cells.cells)]
    border = everything[0].parameters.chunk_samples
    across = [
        (record, at)
        for record in everything
        for at, (onset, duration) in enumerate(zip(record.onsets.tolist(), record.durations.tolist(), strict=True))
        if any(onset < k * border < onset + duration for k in range(1, 4))
    ]
    assert across
    for record in everything:
        assert (np.diff(record.onsets) > record.durations[:-1]).all()
    record, at = across[0]
    waves = transient(record.parameters)
    own = slice(record.onsets[at], record.onsets[at] + record.durations[at])
    assert record.slips[at] == pytest.approx((record.parameters.v_b - waves["v"][own]).sum())


def test_what_the_tests_said_is_what_the_map_says(complete: Path) -> None:
    found = read_map(complete)
    with RunCells(complete) as cells:
        record = cells.record(6)
    assert found.regimes is not None
    assert record.tests.regime.tolist() == found.regimes[:, 1, 2].tolist()
    assert record.tests.period.tobytes() == found.period[:, 1, 2].tobytes()
    assert record.tests.periods.tolist() == [5, 10, 15, 20]
    assert (record.x, record.y) == (found.x[2], found.y[1])
    assert [stretch[1] for stretch in record.tests.runs()][-1] == 20


def test_without_a_map_the_recorded_verdicts_are_the_map(whole: Path) -> None:
    found = read_map(whole)
    (whole / MAP).unlink()
    with RunCells(whole) as cells:
        made = cells.map
        assert cells.record(3).checked
    for name in ("transient_periods", "regime", "correlation", "period"):
        assert getattr(made, name).tobytes() == getattr(found, name).tobytes()
    assert made.run_id == found.run_id


def test_without_a_bag_a_cell_is_computed_and_nothing_is_claimed(whole: Path, complete: Path) -> None:
    shutil.rmtree(whole / "bag")
    with RunCells(whole) as cells, RunCells(complete) as there:
        record = cells.record(7)
        assert (record.source, record.checked) == ("computed", None)
        assert "no bag to hold it against; the kernel is the run's" in record.why
        assert record.differs_from(there.record(7)) is None
        with pytest.raises(CellError, match="has no bag/"):
            cells.record(7, "bag")


def test_another_kernel_is_named_and_never_taken_for_the_runs(whole: Path) -> None:
    shutil.rmtree(whole / "bag")
    for name in ("report.json", "ledger.jsonl"):
        path = whole / name
        path.write_text(path.read_text().replace("source-", "source-0000"))
    with RunCells(whole) as cells:
        record = cells.record(7)
    assert record.checked is None
    assert "the run's kernel is another one, by the sources of bow: source-0000" in record.why
    for name in ("report.json", "ledger.jsonl"):
        (whole / name).unlink()
    with RunCells(whole) as cells:
        assert "compilers and processor are not known" in cells.record(7).why


def test_another_waveform_than_the_recorded_one_is_called_so(complete: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from bow_sweep.cell import computed

    right = computed.compute

    def other(plane, cell, periods=None):
        wave = right(plane, cell, periods)
        wave.bridge_force.view(np.uint32)[1234] ^= 1
        return wave

    monkeypatch.setattr(computed, "compute", other)
    with RunCells(complete) as cells:
        record = cells.record(2, "computed")
    assert record.checked is False
    assert "differs from the bag from sample 1234 on" in record.why


def test_a_cell_that_is_damaged_in_the_bag_is_computed_and_held_against_the_checksums(whole: Path) -> None:
    damage(whole, 6)
    with RunCells(whole) as cells:
        with pytest.raises(CellError, match=r"block 1, chunk 2 of the bag is damaged.*checksum"):
            cells.record(6, "bag")
        record = cells.record(6)
        assert (record.source, record.checked) == ("computed", True)
        assert "block 1, chunk 2 of the bag is damaged" in record.why
        assert "checksums of all 4 chunks of block 1 hold" in record.why
        assert cells.record(0).source == "bag"


def test_recorded_checksums_of_another_waveform_do_not_hold(whole: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from bow_sweep.cell import computed

    damage(whole, 6)
    right = computed.chunk_checksums
    monkeypatch.setattr(computed, "chunk_checksums", lambda *given: [sum ^ 1 for sum in right(*given)])
    with RunCells(whole) as cells:
        record = cells.record(6)
    assert record.checked is False
    assert "the recorded checksum of chunk 0 of block 1 differs" in record.why


def test_a_bag_that_was_not_closed_is_read_too(whole: Path, complete: Path) -> None:
    (path,) = bag_files(whole / "bag")
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * 0.75)])
    with RunCells(whole) as cells, RunCells(complete) as there:
        sources = [cells.record(cell).source for cell in (0, 11)]
        assert sources == ["bag", "computed"]
        assert "of 4 chunks of its block 2; chunk" in cells.record(11).why
        assert all(cells.record(cell).differs_from(there.record(cell)) is None for cell in (0, 11))


def test_a_cell_that_simulators_died_of_is_computed_only_when_that_is_asked_for(tmp_path: Path) -> None:
    recording.quarantined_run(tmp_path / "run")
    recording.leave_all(tmp_path / "run", recording.small_sweep(), quarantined=[1])
    with RunCells(tmp_path / "run") as cells:
        assert cells.record(0).checked
        with pytest.raises(CellError, match="cell 6: its block was given up"):
            cells.record(6)
        record = cells.record(6, "computed")
    assert record.checked is None
    assert "the checksums of 1 of 4 chunks hold" in record.why


def test_a_second_look_is_the_same_record(complete: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_cells, "KEPT", 2)
    with RunCells(complete) as cells:
        first = cells.record(0)
        assert cells.record(0) is first
        cells.record(1), cells.record(2)
        assert cells.record(0) is not first


def test_the_nearest_cell_is_nearest_on_the_scale_of_the_axis(complete: Path) -> None:
    with RunCells(complete) as cells:
        x, y = cells.map.x, cells.map.y
        assert cells.nearest({"f_asym": x[2], "f_init_ratio": y[1]}) == 6
        middle = float(np.sqrt(x[1] * x[2]))  # the axis is logarithmic
        assert cells.nearest({"f_asym": 1.01 * middle, "f_init_ratio": 0.0}) == 2
        assert cells.nearest({"f_asym": 0.99 * middle, "f_init_ratio": 0.0}) == 1


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"f_asym": 200.0, "f_init_ratio": 1.0}, "f_asym = 200: the map reaches from 0.5 to 20; the nearest is 20"),
        ({"f_asym": -3.0, "f_init_ratio": 1.0}, "f_asym = -3: the map reaches from 0.5 to 20; the nearest is 0.5"),
        ({"f_asym": 3.0, "f_init_ratio": -9.0}, "the nearest is 0"),
        ({"f_asym": float("nan"), "f_init_ratio": 1.0}, "f_asym = nan"),
        ({"f_asym": 3.0}, "f_init_ratio: is not given; a cell needs f_asym and f_init_ratio"),
        ({"f_asim": 3.0}, "f_asim: is not a parameter; the axes of this map are f_asym and f_init_ratio"),
        ({"v_mid": 0.2, "f_asym": 3.0}, "v_mid: is 0.2 in all cells of this run"),
    ],
)
def test_what_is_not_in_the_map_is_refused_with_the_nearest(complete: Path, values, message: str) -> None:
    with RunCells(complete) as cells, pytest.raises(CellError) as refused:
        cells.nearest(values)
    assert message in str(refused.value)


def test_a_cell_that_does_not_exist_is_refused(complete: Path) -> None:
    with RunCells(complete) as cells:
        for cell in (-1, 12):
            with pytest.raises(CellError, match=f"cell {cell}: there is none; this map has cells 0 ... 11"):
                cells.record(cell)


def test_what_is_no_run_is_refused(tmp_path: Path, whole: Path) -> None:
    with pytest.raises(CellError, match="is no directory"):
        RunCells(tmp_path / "nowhere")
    with pytest.raises(CellError, match=r"has neither map.npz nor bag/"):
        RunCells(tmp_path)
    (whole / MAP).write_bytes(b"no map")
    with pytest.raises(CellError, match="cannot be read as a map"):
        RunCells(whole)


def test_a_map_beside_the_bag_of_another_run_is_refused(whole: Path, complete: Path, tmp_path: Path) -> None:
    other = recording.record(tmp_path / "other", recording.small_sweep("v_mid=0.5"))
    shutil.rmtree(whole / "bag")
    shutil.copytree(other / "bag", whole / "bag")
    arrays = dict(np.load(whole / MAP))
    arrays["run_id"] = np.array("f" * 16)
    np.savez(whole / MAP, **arrays)
    with pytest.raises(CellError, match=r"map.npz is of run f+, bag/ of run 0123"):
        RunCells(whole)


def test_a_cell_that_was_not_simulated_is_computed_and_judged_as_the_run_would_have(
    complete: Path, tmp_path: Path
) -> None:
    run = Path(shutil.copytree(complete, tmp_path / "run"))
    shutil.rmtree(run / "bag")
    found = read_map(run)
    arrays = dict(np.load(run / MAP))
    for name in ("regimes", "confidence", "correlation", "period", "slips", "corners", "helmholtz"):
        arrays[name][:, 1, 2] = {"regimes": 255}.get(name, 0)
    arrays["regime"][1, 2] = 255
    arrays["transient_periods"][1, 2] = 15  # as predicted
    np.savez(run / MAP, **arrays)
    with RunCells(run) as cells:
        record = cells.record(6)
        other = cells.record(5)
    assert "those shown are made here" in record.why
    assert "made here" not in other.why
    assert found.regimes is not None and found.confidence is not None
    for mine, right in (
        (record.tests.regime, found.regimes),
        (record.tests.confidence, found.confidence),
        (record.tests.period, found.period),
        (record.tests.helmholtz, found.helmholtz),
    ):
        assert mine.tobytes() == right[:, 1, 2].tobytes()
    assert record.transient_periods == found.transient_periods[1, 2]


def test_a_run_of_an_older_version_is_read(root: Path) -> None:
    with RunCells(root / "tests" / "data" / "run_version_2") as cells:
        record = cells.record(1)
        assert (record.source, record.checked) == ("bag", True)
        again = cells.record(1, "computed")
        assert again.source == "computed"
        first = slice(0, 5 * 139)  # its tables had other last bits, which grow later
        assert again.bridge_force[first] == pytest.approx(record.bridge_force[first], abs=1e-6)


def test_a_bag_of_a_later_version_is_refused_by_name(complete: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from bow_sweep.record import notes

    monkeypatch.setattr(notes, "FORMAT", notes.FORMAT - 1)
    with pytest.raises(CellError, match="written by a later bow"):
        RunCells(complete)
