"""Sweeps in a ROS graph, from a script: the maps are those of a sweep in this process, and they are recorded."""

from __future__ import annotations

import asyncio
from pathlib import Path

import numpy as np
import psutil
import pytest

import bow
from bow_sim.physics.errors import ParameterError
from bow_sweep.processes.supervisor import GraphError

SMALL = {"nx": 4, "ny": 4, "periods": 20}


def test_a_graph_that_is_not_open_says_how_to_open_it() -> None:
    with pytest.raises(GraphError, match=r"with bow\.graph\(\) as g"):
        bow.graph().sweep("fig11d", **SMALL)
    with pytest.raises(ValueError, match="simulators = 0"):
        bow.graph(simulators=0)


@pytest.mark.full
def test_sweeps_share_a_graph_and_give_the_maps_of_this_process(
    ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    before = set(psutil.Process().children())
    with bow.graph(simulators=1, own=True) as g:
        assert not g.standing
        with pytest.raises(ParameterError, match="f_asym"):
            g.sweep("fig11d", f_asym=-1.0, out="wrong", **SMALL)
        assert not Path("wrong").exists()
        m = g.sweep("fig11d", out="run", progress=False, **SMALL)
        several = asyncio.run(await_two(g))
        with pytest.raises(asyncio.TimeoutError):
            asyncio.run(asyncio.wait_for(g.sweep_async("fig11d", nx=64, ny=64, out="late"), 0.5))
        again = g.sweep("fig11d", out="again", progress=False, **SMALL)
    assert set(psutil.Process().children()) == before
    right = bow.sweep("fig11d", progress=False, **SMALL)
    for found in (m, again, *several):
        np.testing.assert_array_equal(found.regime, right.regime)
        np.testing.assert_array_equal(found.transient_periods, right.transient_periods)
    assert m.directory == tmp_path / "run"
    assert (tmp_path / "run" / "bag").is_dir()
    assert all(found.directory.parent == tmp_path / "runs" for found in several), "a new name for each, as of bow sweep"


async def await_two(g: bow.Graph) -> list[bow.Map]:
    """Ask for two sweeps at once: they run one after the other."""
    return await asyncio.gather(*(g.sweep_async("fig11d", **SMALL) for _ in range(2)))
