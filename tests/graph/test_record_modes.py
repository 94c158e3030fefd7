"""`bow sweep --record verdicts` and `last`: processes are killed, and the map is that of a run with all its streams."""

from pathlib import Path

import numpy as np
import pytest
from bow_msgs.msg import StickSlip, Verdicts
from desk import desk
from graph import SMALL, halted, map_of, orphans, sweeping, verified

from bow_sim.graph.node_base import STREAM
from bow_sim.protocol import cdr
from bow_sweep.cell.computed import kernel
from bow_sweep.record.again import Again
from bow_sweep.record.bag_contents import Key
from bow_sweep.record.verify import verify

pytestmark = [pytest.mark.usefixtures("ros_domain"), pytest.mark.full]


def assert_proved(run: Path, undisturbed: Path, recorded: int) -> None:
    """Every cell of a run is accounted for, computed again as recorded, and on the map as in an undisturbed run."""
    result = verify(run, again=Again(kernel(), float("inf")))
    assert result["ok"], result["problems"]
    assert (result["computed_again"]["equal"], result["chunks_recorded"]) == (128, recorded)
    one, other = map_of(run), map_of(undisturbed)
    assert one.keys() == other.keys()
    for name in one.keys() - {"settings"}:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def test_without_streams_a_sweep_goes_on_after_its_recorder_was_killed(undisturbed: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    with halted(run, *SMALL, "--record", "verdicts", "--no-dashboard") as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 2)
        sweep.kill("recorder")
        sweep.go_on()
        assert sweep.wait() == 0, sweep.text
        assert "killed by SIGKILL" in sweep.text
        assert "every verdict, no samples" in sweep.text
    assert_proved(run, undisturbed, 0)
    assert orphans(run) == []


@pytest.mark.parametrize("role", ["simulator_1", "classifier"])
def test_without_streams_a_sweep_goes_on_after_another_was_killed(role: str, undisturbed: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    with halted(run, *SMALL, "--record", "verdicts", "--no-dashboard") as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 2)
        sweep.kill(role)
        sweep.go_on()
        assert sweep.wait() == 0, sweep.text
        assert "killed by SIGKILL" in sweep.text
    assert_proved(run, undisturbed, 0)


def test_who_listens_gets_the_streams_of_a_sweep_that_records_none(tmp_path: Path) -> None:
    """The classifier does not judge them, the recorder does not keep them; without a listener there are none."""
    judged: dict[Key, list[str]] = {}
    streams: dict[Key, int] = {}

    def take_verdicts(data: bytes) -> None:
        values = cdr.decode("Verdicts", data)
        if len(values["cells"]):  # no hello
            judged.setdefault((values["block"], values["chunk"]), []).append(values["incarnation"])

    def take_slips(data: bytes) -> None:
        values = cdr.unseal("StickSlip", data)
        if len(values["cells"]):
            streams[values["block"], values["chunk"]] = len(values["cells"])

    with desk(tmp_path) as here:
        here.node.create_subscription(Verdicts, "verdicts", take_verdicts, STREAM, raw=True)
        here.start_all()
        here.sweep("record=verdicts")
        simulators = {m.incarnation for m in here.health.values() if m.role == "simulator"}
        assert {sender for senders in judged.values() for sender in senders} <= simulators
        assert judged
        judged.clear()
        listener = here.node.create_subscription(StickSlip, "stick_slip", take_slips, STREAM, raw=True)
        here.until(lambda: listener.get_publisher_count() == 1, "the listener is matched")
        assert not streams
        finished = here.sweep("record=verdicts")
        here.until(lambda: streams.keys() == judged.keys() and len(judged) == 16 * 20, "every chunk has arrived")
    assert {sender for senders in judged.values() for sender in senders} <= simulators
    assert verified(finished)["chunks_recorded"] == 0


def test_a_sweep_of_the_last_chunks_is_gone_on_with_after_all_was_killed(undisturbed: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    with halted(run, *SMALL, "--record", "last", "--no-dashboard") as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 2)
        sweep.stop()  # at once
    with sweeping(run, "--resume", str(run), "--no-dashboard") as sweep:
        assert sweep.wait() == 0, sweep.text
    assert_proved(run, undisturbed, 16)
