"""What is drawn of a run, and when; its status page."""

import time
from dataclasses import replace

import numpy as np
import pytest
from example_maps import RUN, basin_map, inspection, map_file, outline, plan, settings
from read_rrd import named, pending, rows, verify

from bow_sim.protocol import cdr
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sweep.maps.map_file import MAP, write_map_npz
from bow_sweep.maps.plane import Snapshot
from bow_sweep.view.live_run import FIRST_MAP_S, LAST_MAP_S, SPARSE_S, LiveRun
from bow_sweep.view.status_page import NodeStatus, is_complete, page, with_block_states
from bow_sweep.view.tests_over_time import LEDGER

OPEN, CLOSED = 1, 2


class Clock:
    """Time that passes when told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def live(tmp_path, clock):
    shown = LiveRun(tmp_path / "run", plan(), clock=clock)
    yield shown
    shown.close()


def node(name: str = "simulator_1", state: int = 2, heard: float = 100.0) -> NodeStatus:
    return NodeStatus(f"/bow/{name}", "simulator", state, "block 3", 12, 34_000_000, 1, 90_000_000, heard)


def test_a_sweep_is_over_when_the_plan_is_closed_and_the_map_is_whole(live, clock):
    live.map(basin_map(computed=16))
    clock.now += 1
    assert not live.tick([])
    live.plan(plan(CLOSED, done=4))
    assert not live.tick([])  # the last map is still under way
    live.map(basin_map())
    assert live.tick([])
    live.finish([])
    assert verify(live.recording.path) == ""
    assert pending(live.recording.path)[-1] == 0


def test_a_finished_map_has_its_terrain_and_its_playability(live):
    live.map(basin_map())
    live.finish([])
    kinds = {"black", "smooth", "speckle without black", "speckle with black", "streaky"}
    assert {kind for line in named(live.recording.path, "terrain") for kind in line} <= kinds
    text = rows(live.recording.path, "playability", "TextDocument:text")[-1][1][0]
    assert text.startswith("## Playability\nOf 32 cells")
    assert "largest contiguous area" in text


def test_a_run_that_is_over_has_every_test_when_its_map_is_written(live):
    result = map_file()
    known = replace(result, regimes=np.where(result.helmholtz, 1, 2), confidence=np.full(result.helmholtz.shape, 0.5))
    (live.recording.path.parent / LEDGER).touch()
    write_map_npz(live.recording.path.parent / MAP, known)
    live.map(basin_map())
    live.plan(plan(CLOSED, done=4))
    live.finish([])
    times = {when.get("test") for when, _ in rows(live.recording.path, "map/picture", "Image:buffer")}
    assert times == {0, *range(5, 105, 5)}


def test_a_run_that_is_interrupted_does_not_wait_for_its_map(live, monkeypatch):
    monkeypatch.setattr("bow_sweep.view.live_run.finished_map", lambda *_: pytest.fail("waits"))
    live.map(basin_map(computed=12))
    live.finish([])
    assert pending(live.recording.path)[-1] == 20


@pytest.mark.parametrize(("maps", "patience"), [(0, FIRST_MAP_S), (1, LAST_MAP_S)])
def test_a_last_map_that_never_comes_is_not_waited_for_long(live, clock, maps, patience):
    for _ in range(maps):
        live.map(basin_map(computed=16))
    live.plan(plan(CLOSED, done=4))
    clock.now += patience - 0.01
    assert not live.tick([])
    clock.now += 0.02
    assert live.tick([])


def test_a_sweep_that_is_given_up_does_not_wait_for_what_was_not_computed(live):
    live.map(basin_map(computed=16))
    live.plan(plan(CLOSED, done=2))
    assert live.tick([])


def test_what_came_last_is_drawn_at_the_end_however_fast_it_came(live):
    for computed in range(4, 33):
        live.map(basin_map(computed=computed))
    live.plan(plan(CLOSED, done=4))
    live.finish([])
    assert live.drawn < 29
    assert pending(live.recording.path)[-1] == 0


def test_a_long_sweep_gets_a_map_every_few_seconds_only(live, clock):
    clock.now += 3600
    before = live.drawn
    for tenth in range(600):  # one minute
        clock.now += 0.1
        live.map(basin_map(computed=tenth % 30))
        live.tick([])
    assert 60 / SPARSE_S - 1 <= live.drawn - before <= 60 / SPARSE_S + 1


def test_messages_of_another_run_are_ignored_and_counted(live):
    live.map(basin_map(run="f" * 16))
    live.map({**basin_map(), "sweep_id": "other"})
    live.map({**basin_map(), "slips": np.zeros(3, np.uint16)})
    live.inspect(cdr.unseal("InspectedCell", inspection(3, 0, run="f" * 16)))
    live.inspect(cdr.unseal("InspectedCell", inspection(99, 0)))
    live.plan(plan(CLOSED, epoch=0))
    live.plan({**plan(CLOSED), "rounds": np.ones(32, np.uint8)})  # the sweep is not adaptive
    assert live.ignored == 7
    assert not live.tick([])
    assert live.recording.scope.cells == []


def test_inspected_cells_are_shown(live):
    for cell in (3, 17):
        live.inspect(cdr.unseal("InspectedCell", inspection(cell, 0)))
    assert live.recording.scope.cells == [3, 17]
    assert live.ignored == 0


def test_accounts_are_written_once_a_second(live, clock):
    for _ in range(50):
        clock.now += 0.1
        live.tick([node()])
    live.finish([node()])
    texts = [value[0] for _, value in rows(live.recording.path, "account", "TextDocument:text")]
    assert 5 <= len(texts) <= 7
    assert "in progress" in texts[0]
    assert "interrupted" in texts[-1]


@pytest.mark.alone
def test_a_map_costs_a_sweep_next_to_nothing(tmp_path):
    """The budget is 0.3 s of CPU for the fifteen maps of a sweep. The first sweep of a process loads libraries too."""
    maps = [basin_map(128, 64, computed=n * 8192 // 15) for n in range(1, 16)]
    used = []
    for number in range(3):
        shown = LiveRun(tmp_path / str(number), plan(nx=128, ny=64))
        shown.map(maps[0])  # draws the axes
        began = time.process_time()
        for values in maps:
            shown._next_draw_at = 0.0
            shown.map(values)
        shown.finish([])
        used.append(time.process_time() - began)
        assert shown.drawn == 17
    assert min(used) < 0.3, used


def test_the_plan_knows_better_than_the_map_what_is_done():
    snapshot = Snapshot.from_message(basin_map(computed=20)).with_plan(settings())
    assert (snapshot.done, snapshot.outstanding) == (16, 16)
    newer = with_block_states(snapshot, outline(), [1, 2, 1, 0])
    assert (newer.done, newer.quarantined, newer.outstanding) == (16, 8, 8)
    assert newer.planned == 32


def test_blocks_that_do_not_divide_the_map_are_counted_right():
    snapshot = Snapshot.from_message(basin_map())
    tens = SweepOutline.of({**plan(), "spec.settings": settings(block_cells=10)})
    assert with_block_states(snapshot, tens, [1, 1, 1, 0]).outstanding == 2
    assert with_block_states(snapshot, tens, [0, 0, 0, 1]).done == 2


def test_what_an_adaptive_sweep_has_not_planned_is_not_outstanding():
    snapshot = Snapshot.from_message(basin_map()).with_plan(settings())
    rounds = np.zeros(32, np.uint8)
    rounds[:12], rounds[20:25] = 1, 2  # blocks of 8, 4 and 5
    adaptive = SweepOutline.of({**plan(), "spec.settings": [*settings(), "adaptive=0.5"], "rounds": rounds})
    grown = with_block_states(snapshot, adaptive, [1, 2, 0])
    assert (grown.done, grown.quarantined, grown.outstanding) == (8, 4, 5)
    assert with_block_states(snapshot, adaptive, [1, 2, 0, 0]) == snapshot  # a plan that contradicts itself


def test_a_map_is_complete_when_it_holds_every_test_of_what_is_done():
    whole, part = (Snapshot.from_message(basin_map(computed=n)).with_plan(settings()) for n in (32, 20))
    assert is_complete(with_block_states(whole, outline(), [1, 1, 1, 1]))
    assert not is_complete(with_block_states(part, outline(), [1, 1, 1, 0]))


def test_the_page_tells_the_whole_story():
    snapshot = with_block_states(
        Snapshot.from_message(basin_map(computed=20)).with_plan(settings(), "fig11d"), outline(), [1, 1, 2, 0]
    )
    nodes = [node(), node("simulator_2", heard=90.0), node("classifier", state=4)]
    text = page(snapshot, nodes, 100.0, "in progress", 12.3)
    assert "| 32 | 16 | 8 | 8 | 12 |" in text
    assert "| Helmholtz | 12 | 37.5% |" in text
    assert "Helmholtz motion came in 12 of 20 cells, after 32.5 periods in the median." in text
    assert "| simulator_1 | busy | block 3 | 12 | 34.0 | 1 | 90 |" in text
    assert "| simulator_2 | **silent for 10 s** |" in text
    assert "| classifier | **dead** |" in text
    assert text.startswith("## Stiff/Cremer string\n")
    assert "preset fig11d" in text
    assert "| tau_f | 400 | samples |" in text
    assert RUN in text
    assert "v_mid=0.2" in text


def test_a_page_of_nothing_is_a_page():
    text = page(Snapshot.empty(outline()), [], 0.0, "in progress", 0.0)
    assert "No node has been heard of." in text


def test_what_a_node_says_of_itself_cannot_break_the_table():
    rude = NodeStatus("/bow/x", "simulator", 9, "a | b\nc", 0, 0, 0, 0, 100.0)
    text = page(Snapshot.empty(outline()), [rude], 100.0, "in progress", 0.0)
    assert "| x | **9** | a / b c |" in text
