"""A cell chosen while a sweep runs: the one that was meant, or a line that says why not; the bits are its block's."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import recording
from example_maps import basin_map
from hypothesis import given
from hypothesis import strategies as st

from bow_sim.kernel.block import Block
from bow_sim.protocol import cdr
from bow_sweep.coordinator import choice
from bow_sweep.coordinator.choice import ChoiceError, Inspector, cell_at, cell_of, waveform
from bow_sweep.coordinator.standard_messages import POINT, points_message
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run.directory import Run

SWEEP = Sweep.from_spec("fig11d", ["x.count=8", "y.count=4", "periods=10"])
X, Y = SWEEP.x.values(), SWEEP.y.values()


def test_a_point_of_the_map_is_the_cell_around_it() -> None:
    assert [cell_at(SWEEP, x, y, "basin_map") for x, y in ((0.5, 0.5), (0.99, 0.01), (1.0, 0.0), (7.5, 3.5))] == [
        0,
        0,
        1,
        31,
    ]
    assert cell_at(SWEEP, 8.0, 4.0, "") == 31, "the very corner, and a frame that is not given"


def test_a_click_on_a_point_of_the_published_map_is_its_cell() -> None:
    """The points that RViz shows have their cells' places."""
    message = points_message(basin_map(8, 4), recording_time())
    points = np.frombuffer(message.data, POINT).reshape(message.height, message.width)
    for cell, point in enumerate(points.ravel()):
        assert cell_at(SWEEP, float(point["x"]), float(point["y"]), message.header.frame_id) == cell
    assert points["transient_periods"].ravel()[:8].tolist() == [5.0 * (ix + 1) for ix in range(8)]
    assert [(field.name, field.offset) for field in message.fields] == [
        (str(name), POINT.fields[name][1])
        for name in POINT.names  # type: ignore[index, union-attr]
    ]


def recording_time() -> object:
    from builtin_interfaces.msg import Time

    return Time(sec=1)


@pytest.mark.parametrize(
    ("x", "y", "frame", "why"),
    [
        (-0.1, 1.0, "basin_map", "is beside the map, which reaches from (0, 0) to (8, 4)"),
        (1.0, 4.1, "basin_map", "beside the map"),
        (float("nan"), 1.0, "basin_map", "beside the map"),
        (1.0, float("inf"), "basin_map", "beside the map"),
        (1.0, 1.0, "map", "frame 'map': should be in 'basin_map', in which one unit is one cell"),
    ],
)
def test_a_point_that_is_no_cell_is_refused(x: float, y: float, frame: str, why: str) -> None:
    with pytest.raises(ChoiceError) as error:
        cell_at(SWEEP, x, y, frame)
    assert why in str(error.value)


@given(ix=st.integers(0, 7), iy=st.integers(0, 3), dx=st.floats(-0.49, 0.49), dy=st.floats(-0.49, 0.49))
def test_values_are_the_cell_that_is_nearest_on_its_scale(ix: int, iy: int, dx: float, dy: float) -> None:
    x = float(X[ix] * (X[1] / X[0]) ** dx)
    y = float(Y[iy] + dy * (Y[1] - Y[0]))
    assert cell_of(SWEEP, [f"f_asym={x!r}", f"f_init_ratio={y!r}"], 0) == iy * 8 + ix


def test_without_values_the_index_counts() -> None:
    assert cell_of(SWEEP, [], 31) == 31


@pytest.mark.parametrize(
    ("at", "cell", "why"),
    [
        ([], 32, "cell 32: this map has cells 0 ... 31"),
        (["f_asym=3"], 0, "f_init_ratio is not given; a cell of this map needs f_asym and f_init_ratio"),
        (["force=3", "f_init_ratio=1"], 0, "force: is no axis of this map; its axes are f_asym and f_init_ratio"),
        (["f_asym", "f_init_ratio=1"], 0, "'f_asym': must have the form name=value"),
        (["f_asym=much", "f_init_ratio=1"], 0, "f_asym = 'much': should be a number"),
        (["f_asym=40", "f_init_ratio=1"], 0, "f_asym = 40: the map reaches from 0.5 to 20; the nearest is 20"),
        (["f_asym=-1", "f_init_ratio=1"], 0, "f_asym = -1: the map reaches from 0.5 to 20; the nearest is 0.5"),
        (["f_asym=nan", "f_init_ratio=1"], 0, "f_asym = nan: the map reaches from 0.5 to 20"),
        (
            ["f_asym=3", "f_init_ratio=2.5"],
            0,
            "f_init_ratio = 2.5: the map reaches from 0 to 2; the nearest is",
        ),
    ],
)
def test_a_cell_that_does_not_exist_is_answered_with_what_would_be_right(at: list[str], cell: int, why: str) -> None:
    with pytest.raises(ChoiceError) as error:
        cell_of(SWEEP, at, cell)
    assert why in str(error.value)
    assert len(str(error.value).splitlines()) == 1


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Run]:
    made = Run.create(tmp_path / "run", recording.RUN, SWEEP)
    yield made
    made.close()


def test_a_cell_computed_alone_has_the_bits_of_its_block(run: Run) -> None:
    cell = 13
    block = next(number for number in range(run.blocks.count) if cell in run.blocks.block(number))
    cells = run.blocks.block(block)
    whole = Block(SWEEP.parameters, SWEEP.lanes(cells))
    row = int(np.flatnonzero(cells == cell)[0])
    chunks = [cdr.unseal("InspectedCell", data) for data in waveform(run, cell, "c" * 16, lambda: 10**9)]
    assert [chunk["chunk"] for chunk in chunks] == [0, 1]
    for chunk in chunks:
        assert (chunk["run_id"], chunk["block"], chunk["cell"]) == (recording.RUN, block, cell)
        assert chunk["name"] == choice.in_words(SWEEP, cell).partition(": ")[2]
        assert chunk["first_sample"] == chunk["chunk"] * SWEEP.parameters.chunk_samples
        np.testing.assert_array_equal(chunk["bridge_force"], whole.advance().bridge_force[row])


def test_cells_are_computed_one_after_the_other_and_too_many_are_refused(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, go_on = threading.Event(), threading.Event()
    published: list[bytes] = []
    problems: list[str] = []

    def computed(_run: Run, cell: int, *_: object) -> Iterator[bytes]:
        begun.set()
        assert go_on.wait(60)
        if cell == 2:
            raise ValueError("no such kernel")
        yield bytes([cell])

    monkeypatch.setattr(choice, "waveform", computed)
    inspector = Inspector("c" * 16, published.append, problems.append)
    inspector.inspect(run, 1)
    assert begun.wait(60)
    for cell in range(2, 2 + choice.MOST_WAITING):
        inspector.inspect(run, cell)
    with pytest.raises(ChoiceError, match="16 chosen cells wait already"):
        inspector.inspect(run, 99)
    go_on.set()
    inspector._waiting.put(None, timeout=60)
    assert inspector._thread is not None
    inspector._thread.join(60)
    assert published == [bytes([cell]) for cell in (1, *range(3, 2 + choice.MOST_WAITING))]
    assert problems == ["cell 2 is not inspected: no such kernel"]
