from __future__ import annotations

import numpy as np
import pytest

from bow_classifier.task import Task
from bow_sim.physics.errors import ParameterError
from bow_sim.protocol.sweep_spec import axis_values

RUN, SWEEP = "0123456789abcdef", "fedcba9876543210"
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
TASK = Task.from_settings(RUN, SWEEP, SETTINGS)


@pytest.mark.parametrize("scale", ["log", "linear"])
def test_both_ends_of_an_axis_are_exact(scale):
    for first, last in ((0.5, 20.0), (0.1, 0.7), (3.0, 1.1)):
        for count in (1, 2, 7, 128):
            values = axis_values(scale, first, last, count)
            assert (values.dtype, values.shape, values[0]) == (np.float64, (count,), first)
            assert count == 1 or values[-1] == last
            steps = np.diff(np.log(values) if scale == "log" else values)
            assert np.allclose(steps, steps[:1])


def test_a_task_knows_blocks_and_bow_speeds():
    assert (TASK.planned.cells, TASK.blocks, TASK.chunks) == (3, 2, CHUNKS)
    assert TASK.block(1).tolist() == [2]
    assert TASK.bow_speed(TASK.block(1)).tolist() == [1.0]
    settings = [line for line in SETTINGS if not line.startswith("y.")]
    swept = [*settings, "y.name=v_b", "y.scale=linear", "y.first=1", "y.last=3", "y.count=2", "block_cells=4"]
    task = Task.from_settings(RUN, SWEEP, swept)
    np.testing.assert_allclose(task.bow_speed(task.block(0)), [1, 1, 1, 3])
    across = [line.replace("y.", "z.").replace("x.", "y.").replace("z.", "x.") for line in swept]
    np.testing.assert_allclose(Task.from_settings(RUN, SWEEP, across).bow_speeds, [1, 3] * 3)
    with pytest.raises(ParameterError, match="axis of v_b"):
        Task.from_settings(RUN, SWEEP, [line for line in swept if not line.startswith("y.last")])


def bowed_at(first, last, count, scale="linear"):
    """Return the settings of a map of bow position."""
    axis = (f"x.first={first}", f"x.last={last}", f"x.count={count}", f"x.scale={scale}")
    return (*SETTINGS, "x.name=bow_bridge", *axis, "block_cells=4")


def test_a_task_knows_bow_positions():
    assert TASK.bow_bridge(TASK.block(1)).tolist() == [15]
    elsewhere = Task.from_settings(RUN, SWEEP, [*SETTINGS, "bow_bridge=20"])
    assert elsewhere.bow_bridge(elsewhere.block(0)).tolist() == [20]
    task = Task.from_settings(RUN, SWEEP, [*bowed_at(5, 45, 5), "y.count=2"])
    assert task.bow_bridges.tolist() == [5, 15, 25, 35, 45] * 2
    assert task.bow_bridge(task.block(1)).tolist() == [45, 5, 15, 25]
    assert Task.from_settings(RUN, SWEEP, bowed_at(5, 36, 32)).bow_bridges.tolist() == list(range(5, 37))
    assert Task.from_settings(RUN, SWEEP, bowed_at(10, 40, 2, "log")).bow_bridges.tolist() == [10, 40]


@pytest.mark.parametrize(
    ("axis", "says"),
    [
        ((5, 20, 3), "bow_bridge = 12.5: must be a whole number"),
        ((0, 20, 5), "bow_bridge = 0.0: must be a whole number >= 1"),
        ((5, 139, 3), "bow_bridge = 139: must be less than period = 139"),
        ((5, 40, 3, "log"), "bow_bridge = 14.1"),
        ((5, "inf", 3), "inf: should be a finite number"),
    ],
)
def test_a_map_with_the_bow_between_samples_or_off_the_string_is_refused(axis, says):
    with pytest.raises(ParameterError, match=f"axis of bow_bridge: {says}"):
        Task.from_settings(RUN, SWEEP, bowed_at(*axis))
