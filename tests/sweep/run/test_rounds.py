"""Rounds of an adaptive sweep: recorded before they begin, the same after a crash, with a complete map at the end."""

import json
from pathlib import Path

import numpy as np
import pytest

from bow_classifier.verdict.regimes import REGIMES
from bow_sim.protocol.verdict_fields import PENDING, VERDICT_FIELDS
from bow_sweep.coordinator.results import map_of, write_results
from bow_sweep.maps.basin_map import Basin
from bow_sweep.maps.in_process import compute
from bow_sweep.maps.map_file import read_map_npz
from bow_sweep.plan.adaptive import fill, first_round
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run.directory import LEDGER, Run, RunError, is_finished, read_ledger
from bow_sweep.run.ledger import Grown, State

SWEEP = Sweep.from_spec("fig11d", ["x.count=16", "y.count=8", "block_cells=8", "periods=10", "adaptive=0.5"])
HELMHOLTZ, NEVER = REGIMES.index("helmholtz"), REGIMES.index("aperiodic")


def terrain(cells: np.ndarray) -> np.ndarray:
    """Return regimes: Helmholtz motion right of a sloping line."""
    y, x = np.divmod(cells, 16)
    return np.where(x > 5 + y / 2, HELMHOLTZ, NEVER)


def settle(run: Run, basin: Basin, state: State = State.DONE) -> None:
    """Settle all due blocks of a run: done or quarantined."""
    for number, block in enumerate(run.ledger.blocks):
        if block.state is State.DUE:
            cells = run.blocks.block(number)
            for test in range(2):
                values = {name: field.empty for name, field in VERDICT_FIELDS.items()}
                basin.take(test, cells, {**values, "regime": terrain(cells)})
            run.ledger.blocks[number].state = state
            run.record([{"event": state.value, "block": number, "attempt": 1}])
    run.ledger._open.clear()
    run.ledger._due.clear()


def begun(directory: Path) -> tuple[Run, Basin]:
    return Run.create(directory, "a" * 16, SWEEP), Basin(16, 8, 2)


def grow(run: Run, basin: Basin) -> bool:
    more = run.next_round(basin)
    if more:
        run.ledger.handle(Grown(run.blocks.count), 0)
    return more


def to_the_end(run: Run, basin: Basin) -> None:
    settle(run, basin)
    while grow(run, basin):
        settle(run, basin)


def test_a_round_is_on_disk_before_its_blocks_are(tmp_path: Path) -> None:
    run, basin = begun(tmp_path / "run")
    first = read_ledger(tmp_path / "run")[1]
    assert (first["event"], first["cells"]) == ("round", first_round((8, 16), 64).tolist())
    settle(run, basin)
    assert run.next_round(basin)
    last = read_ledger(tmp_path / "run")[-1]
    assert (last["round"], last["cells"], last["blocks"]) == (2, run.blocks.rounds[1].tolist(), run.blocks.count)
    assert len(run.ledger.blocks) < run.blocks.count
    run.close()


def test_the_account_grows_with_the_rounds_and_always_balances(tmp_path: Path) -> None:
    run, basin = begun(tmp_path / "run")
    planned = []
    while True:
        accounts = run.accounts()
        planned.append(accounts.pop("planned"))
        assert sum(accounts.values()) == planned[-1]
        settle(run, basin)
        if not grow(run, basin):
            break
    assert planned == sorted(set(planned))
    assert len(planned) > 2
    assert planned[-1] <= 64
    run.close()


def test_a_run_interrupted_in_a_round_is_resumed_with_the_same_rounds(tmp_path: Path) -> None:
    run, basin = begun(tmp_path / "one")
    to_the_end(run, basin)
    other, again = begun(tmp_path / "other")
    settle(other, again)
    while True:
        other.close()
        other = Run.resume(tmp_path / "other")
        settle(other, again)
        if not grow(other, again):
            break
    assert other.blocks.extends(run.blocks) and run.blocks.extends(other.blocks)
    np.testing.assert_array_equal(map_of(other, again).transient_periods, map_of(run, basin).transient_periods)
    run.close()
    other.close()


def test_a_run_interrupted_before_its_first_round_is_recorded_begins_with_it(tmp_path: Path) -> None:
    run, _ = begun(tmp_path / "run")
    run.close()
    path = tmp_path / "run" / LEDGER
    path.write_bytes(path.read_bytes().split(b"\n")[0] + b'\n{"event": "round", "ce')
    again = Run.resume(tmp_path / "run")
    assert again.blocks.extends(SWEEP.first_blocks)
    assert len(again.ledger.blocks) == SWEEP.blocks
    again.close()


@pytest.mark.parametrize("cells", [[0], [500], [3, 2], "x", []])
def test_a_ledger_with_an_impossible_round_is_refused(tmp_path: Path, cells: object) -> None:
    run, _ = begun(tmp_path / "run")
    run.record([{"event": "round", "round": 2, "cells": cells, "blocks": 9}])
    run.close()
    with pytest.raises(RunError, match=LEDGER):
        Run.resume(tmp_path / "run")


def test_a_run_is_not_finished_while_a_round_is_open(tmp_path: Path) -> None:
    run, basin = begun(tmp_path / "run")
    settle(run, basin)
    run.report(basin, 1.0, {})
    assert is_finished(tmp_path / "run", read_ledger(tmp_path / "run"))
    assert run.next_round(basin)
    assert not is_finished(tmp_path / "run", read_ledger(tmp_path / "run"))
    run.close()


def test_the_map_is_predicted_elsewhere_and_states_which_cells_were_simulated(tmp_path: Path) -> None:
    run, basin = begun(tmp_path / "run")
    to_the_end(run, basin)
    report = run.report(basin, 1.0, {})
    assert write_results(run, basin)() == ""
    found = read_map_npz(tmp_path / "run" / "map.npz")
    assert found.simulated is not None
    assert found.simulated.sum() == run.accounts()["done"] == report["cells"]["done"] == 128 - report["cells_predicted"]
    np.testing.assert_array_equal(found.regime == PENDING, ~found.simulated)
    truth = np.where(terrain(np.arange(128)) == HELMHOLTZ, 5, 0).reshape(8, 16)
    np.testing.assert_array_equal(found.transient_periods[found.simulated], truth[found.simulated])
    assert np.mean(found.transient_periods == truth) > 0.97
    assert report["helmholtz_fraction"] == pytest.approx(np.mean(found.transient_periods > 0))
    assert json.loads((tmp_path / "run" / "report.json").read_text())["rounds"] == len(run.blocks.rounds)
    run.close()


def test_a_quarantined_block_is_not_predicted(tmp_path: Path) -> None:
    run, basin = begun(tmp_path / "run")
    run.ledger.blocks[0].state = State.QUARANTINED
    lost = run.blocks.block(0)
    to_the_end(run, basin)
    length = map_of(run, basin).transient_periods.ravel()
    assert np.isnan(length[lost]).all()
    assert np.isnan(length).sum() == len(lost)
    assert not set(lost) & set(np.concatenate(run.blocks.rounds[1:]))
    run.close()


def test_a_sweep_in_this_process_simulates_what_the_rounds_ask_for() -> None:
    settings = ["x.count=24", "y.count=12", "x.first=2", "x.last=14", "periods=60"]
    whole = compute(Sweep.from_spec("fig11f", settings)).transient_periods
    told: list[tuple[float, float]] = []
    part = compute(Sweep.from_spec("fig11f", [*settings, "adaptive=0.5"]), lambda *now: told.append(now))
    known = ~np.isnan(part.transient_periods)
    assert 0.3 < known.mean() <= 0.5
    np.testing.assert_array_equal(part.transient_periods[known], whole[known])
    assert told[-1] == (known.sum(), 144)
    filled = fill(part.transient_periods.reshape(12, 24)).ravel()
    assert np.mean((filled > 0) == (whole > 0)) > 0.9
