"""The outline of a sweep: what its settings say of axes, blocks and cells, and which messages belong to it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from outlines import outline

from bow_sim.physics.errors import ParameterError
from bow_sim.protocol import cdr
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sim.protocol.sweep_spec import Axis
from bow_sim.protocol.verdict_fields import VERDICT_FIELDS
from bow_sweep.plan.sweep import Sweep

RUN, SWEEP, CLASSIFIER = "0123456789abcdef", "fedcba9876543210", "c" * 16
CHUNKS = 5
SETTINGS = (
    "block_cells=2",
    f"periods={5 * CHUNKS}",
    "x.count=3",
    "x.first=0.5",
    "x.last=20",
    "x.name=f_asym",
    "x.scale=log",
    "y.count=1",
    "y.first=0",
    "y.last=2",
    "y.name=f_init_ratio",
    "y.scale=linear",
)


def of(*settings: str, rounds: np.ndarray | None = None) -> SweepOutline:
    return outline(RUN, SWEEP, [*SETTINGS, *settings], rounds, CLASSIFIER)


@pytest.mark.parametrize("scale", ["log", "linear"])
def test_both_ends_of_an_axis_are_exact(scale: str) -> None:
    for first, last in ((0.5, 20.0), (0.1, 0.7), (3.0, 1.1)):
        for count in (1, 2, 7, 128):
            values = Axis("f_asym", scale, first, last, count).values()
            assert (values.dtype, values.shape, values[0]) == (np.float64, (count,), first)
            assert count == 1 or values[-1] == last
            steps = np.diff(np.log(values) if scale == "log" else values)
            assert np.allclose(steps, steps[:1])


@pytest.mark.parametrize("preset", ["fig11d", "schelleng"])
def test_the_outline_is_that_of_the_sweep_that_was_planned(preset: str) -> None:
    sweep = Sweep.from_spec(preset, ["block_cells=100"])
    found = outline(RUN, sweep.sweep_id, sweep.settings())
    assert (found.parameters, found.x, found.y) == (sweep.parameters, sweep.x, sweep.y)
    assert (found.shape, found.cells) == ((sweep.y.count, sweep.x.count), sweep.cells)
    assert (found.blocks, found.chunks) == (sweep.blocks, sweep.chunks)
    assert found.chunk_samples == sweep.parameters.chunk_samples
    last = sweep.block(sweep.blocks - 1)
    assert found.block(sweep.blocks - 1).tolist() == last.tolist()
    for name, values in sweep.lanes(last).items():
        assert found.values(name, last).tobytes() == values.tobytes()


def test_every_cell_has_its_own_value_of_a_swept_parameter_and_the_common_one_of_any_other() -> None:
    assert of().values("v_b", np.array([2])).tolist() == [1.0]
    assert of("bow_bridge=20").values("bow_bridge", np.arange(3)).tolist() == [20, 20, 20]
    speed = ("y.name=v_b", "y.scale=linear", "y.first=1", "y.last=3", "y.count=2")
    assert of(*speed).values("v_b", np.array([0, 1, 2, 3])).tolist() == [1, 1, 1, 3]
    across = [setting.replace("y.", "x.") for setting in speed]
    assert of(*across, "y.count=2").values("v_b", np.array([3, 2])).tolist() == [3, 1]
    bridge = ("x.name=bow_bridge", "x.first=5", "x.last=45", "x.count=5", "x.scale=linear", "y.count=2")
    assert of(*bridge).values("bow_bridge", np.arange(4, 8)).tolist() == [45, 5, 15, 25]


@pytest.mark.parametrize(
    ("axis", "reason"),
    [
        ((5, 20, 3), "x.count = 3: bow_bridge takes whole numbers"),
        ((0, 20, 5), "at x.first and y.first: bow_bridge = 0.0: must be a whole number >= 1"),
        ((5, 139, 3), "bow_bridge = 139: must be less than period = 139"),
        ((5, 40, 3, "log"), "x.count = 3: bow_bridge takes whole numbers"),
        ((5, "inf", 3), "x.last = inf: should be a finite number"),
    ],
)
def test_a_map_with_the_bow_between_samples_or_off_the_string_is_refused(axis: Any, reason: str) -> None:
    first, last, count, scale = (*axis, "linear")[:4]
    with pytest.raises(ParameterError, match=reason):
        of("x.name=bow_bridge", f"x.first={first}", f"x.last={last}", f"x.count={count}", f"x.scale={scale}")


@pytest.mark.parametrize(
    ("setting", "reason"),
    [
        ("x.name=period", "x.name = 'period': cannot be swept"),
        ("y.name=f_asym", "y.name = 'f_asym': both axes are this parameter"),
        ("x.scale=cubic", "x.scale = 'cubic'"),
        ("x.first=0", "x.first = 0.0: should be above 0"),
        ("x.colour=red", "x.colour: no such setting"),
        ("adaptive=0.5", "Plan.rounds has 0 values, at adaptive = 0.5"),
        ("adaptive=2", "adaptive = 2: should be above 0 and at most 1"),
    ],
)
def test_a_plan_that_cannot_be_run_is_refused(setting: str, reason: str) -> None:
    with pytest.raises(ParameterError, match=reason):
        of(setting)


def test_every_setting_of_an_axis_must_be_announced() -> None:
    for name in ("x.first", "y.last", "x.scale", "y.name"):
        with pytest.raises(ParameterError, match=f"there is no setting {name}"):
            outline(RUN, SWEEP, [line for line in SETTINGS if not line.startswith(name)])


def test_a_plan_grows_by_whole_rounds_and_never_changes_the_blocks_that_are_known() -> None:
    rounds = np.array([1, 0, 0], np.uint8)
    known = of("adaptive=0.9", rounds=rounds)
    assert (known.blocks, known.block(0).tolist()) == (1, [0])
    grown = known.grown(np.array([1, 0, 2], np.uint8))
    assert (grown.blocks, grown.block(1).tolist()) == (2, [2])
    assert known.grown(rounds) is known
    with pytest.raises(ParameterError, match="do not contain the 2 known ones"):
        grown.grown(rounds)


def fields(name: str, **changes: Any) -> dict[str, Any]:
    """The fields of a message on the second block, two chunks into the sweep."""
    values: dict[str, Any] = {
        "run_id": RUN,
        "sweep_id": SWEEP,
        "block": 1,
        "chunk": 2,
        "attempt": 1,
        "incarnation": "s" * 16,
        "cells": [2],
    }
    if name == "Verdicts":
        values |= {"chunk_checksum": 1, "classifier": CLASSIFIER}
        values |= {field: kind.array((1,)) for field, kind in VERDICT_FIELDS.items()}
    else:
        values |= {"first_sample": 2 * 695, "samples": 695, "data": np.zeros(695, np.float32)}
        values |= {"slipping": [0], "offsets": [0, 0], "onset": [], "duration": [], "slip": []}
    return values | changes


@pytest.mark.parametrize("name", ["BridgeForce", "StickSlip", "Verdicts"])
def test_a_message_of_the_sweep_belongs_to_it(name: str) -> None:
    assert of().objection(name, cdr.unseal(name, cdr.encode(name, fields(name)))) == ""


@pytest.mark.parametrize(
    ("name", "changes", "reason"),
    [
        ("StickSlip", {"run_id": "f" * 16}, "should be of run '0123456789abcdef'"),
        ("StickSlip", {"sweep_id": "f" * 16}, "sweep 'ffffffffffffffff'"),
        ("Verdicts", {"block": 2}, "the sweep has 2 blocks of 5 chunks"),
        ("StickSlip", {"chunk": 5}, "the sweep has 2 blocks of 5 chunks"),
        ("StickSlip", {"cells": [1]}, "its cells are not the 1 cells of block 1, 2 ... 2"),
        ("Verdicts", {"cells": [1]}, "its cells are not the 1 cells of block 1"),
        ("StickSlip", {"samples": 694}, "694 samples from sample 1390 on, should be 695 from sample 1390 on"),
        ("StickSlip", {"first_sample": 0}, "695 samples from sample 0 on"),
        ("Verdicts", {"classifier": "d" * 16}, "classifier = 'dddddddddddddddd': should be 'cccccccccccccccc'"),
    ],
)
def test_a_message_that_does_not_belong_is_refused_with_the_reason(name: str, changes: Any, reason: str) -> None:
    data = cdr.encode(name, fields(name, **changes))
    with pytest.raises(cdr.WireError, match=rf"^{name}: .*{reason}"):
        of().unseal(name, data)
