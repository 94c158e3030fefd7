"""The runs of a measured string, as messages, without a graph."""

from __future__ import annotations

from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
from measured import BETA, F0, RATE, blocks, played

from bow_classifier.measured.samples import SamplesError, samples_in, samples_of
from bow_classifier.measured.session import PATIENCE_S, Session
from bow_classifier.measured.tuning import Given
from bow_sim.protocol import cdr
from bow_sim.protocol.states import BlockState, PlanState, ReceiptKind
from bow_sim.protocol.sweep_outline import SweepOutline


class Readers:
    """A classifier and a recorder that answer everything at once, as long as they are there."""

    def __init__(self, session: Session, recorder: bool = True) -> None:
        self.session, self.recorder = session, recorder
        self.missing: list[str] = []
        self.got: dict[str, list[dict]] = {"plan": [], "bridge_force": [], "stick_slip": []}
        self.said: list[str] = []

    def go_on(self, now: float) -> None:
        self.session.pass_time(now, self.recorder, lambda *_: self.missing, 0)
        names = {"plan": "Plan", "bridge_force": "BridgeForce", "stick_slip": "StickSlip"}
        while self.session.out:
            topic, data = self.session.out.popleft()
            if topic not in names:
                self.said.append(str(data))
                continue
            values = (cdr.decode if topic == "plan" else cdr.unseal)(names[topic], data)
            self.got[topic].append(values)
            if topic == "stick_slip":
                run = {"run_id": values["run_id"], "chunk": values["chunk"]}
                self.session.verdicts({**run, "regime": np.array([1])}, now)
                if self.recorder:
                    self.answer(run["run_id"], ReceiptKind.STREAMS, values["chunk"], now)
            elif topic == "plan" and len(self.got["plan"]) > 1 and self.recorder:
                self.answer(values["run_id"], ReceiptKind.BLOCK, 0, now)

    def answer(self, run: str, kind: int, chunk: int, now: float) -> None:
        self.session.receipt({"run_id": run, "kind": np.array([kind]), "chunk": np.array([chunk])}, now)


def play(readers: Readers, wave: np.ndarray) -> None:
    for block, now in blocks(wave):
        readers.session.take(block, now)
        readers.go_on(now)


@pytest.fixture
def session() -> Session:
    return Session("/force", Given(RATE, F0, BETA), "0" * 16)


@pytest.mark.parametrize("recorder", [True, False], ids=["recorded", "not recorded"])
def test_a_stretch_is_a_run_whose_last_plan_says_how_long_it_was(session: Session, recorder: bool) -> None:
    readers = Readers(session, recorder)
    play(readers, played(0.8))
    session.stop()
    for step in range(5):
        readers.go_on(1 + step / 10)
    plans = readers.got["plan"]
    chunks = len(readers.got["bridge_force"])
    assert 0.8 * F0 / 5 - 2 < chunks <= 0.8 * F0 / 5
    assert [values["chunk"] for values in readers.got["bridge_force"]] == list(range(chunks))
    assert [plan["state"] for plan in plans] == [PlanState.OPEN, PlanState.OPEN, PlanState.CLOSED]
    opened, ended = SweepOutline.of(plans[0]), SweepOutline.of(plans[0]).followed(plans[-1])
    assert opened.chunks > ended.chunks == chunks
    assert plans[-1]["block_states"].tolist() == [BlockState.DONE]
    assert all(not opened.objection("BridgeForce", values) for values in readers.got["bridge_force"])
    assert all(not opened.objection("StickSlip", values) for values in readers.got["stick_slip"])
    assert ("not recorded" in readers.said[-1]) is not recorder
    assert session.run_id == ""


def test_the_log_names_what_lasts(session: Session) -> None:
    readers = Readers(session)
    play(readers, played(0.8))
    assert readers.said[0].startswith("run ")
    assert "measured /force: 48000 Hz, f0 44" in readers.said[0]
    assert readers.said[1] == "0.00 s: helmholtz"
    assert len(readers.said) == 2


def test_nothing_is_sent_before_the_readers_hear(session: Session) -> None:
    readers = Readers(session)
    readers.missing = ["no recorder has taken up the run"]
    play(readers, played(0.8))
    assert (len(readers.got["plan"]), readers.got["bridge_force"]) == (1, [])
    readers.go_on(0.8 + PATIENCE_S)
    readers.go_on(0.8 + PATIENCE_S)
    assert readers.got["bridge_force"]
    assert any("begins all the same: no recorder" in line for line in readers.said)


def test_a_node_that_ends_before_its_readers_hear_closes_the_run_as_given_up(session: Session) -> None:
    readers = Readers(session)
    readers.missing = ["no recorder has taken up the run"]
    play(readers, played(0.8))
    session.stop()
    readers.go_on(0.9)
    session.give_up()
    readers.missing = []
    readers.go_on(1.0)
    last = readers.got["plan"][-1]
    assert (last["state"], last["block_states"].tolist()) == (PlanState.CLOSED, [BlockState.QUARANTINED])
    assert "is given up" in readers.said[-1]
    assert session.run_id == ""


def test_a_recorder_that_comes_later_gets_a_run_of_its_own(session: Session) -> None:
    readers = Readers(session, recorder=False)
    play(readers, played(0.8))
    readers.recorder = True
    for step in range(9):
        readers.go_on(0.9 + step / 10)
    first, second = Counter(plan["run_id"] for plan in readers.got["plan"])
    assert first != second == session.run_id
    assert any("a recorder has come" in line for line in readers.said)


def test_lost_samples_end_a_run(session: Session) -> None:
    readers = Readers(session)
    play(readers, played(0.8))
    session.lose("3 messages of /force were lost")
    for step in range(5):
        readers.go_on(0.9 + step / 10)
    assert readers.got["plan"][-1]["state"] == PlanState.CLOSED
    assert "3 messages of /force were lost; " in readers.said[-1]


def layout(*sizes: int, offset: int = 0) -> SimpleNamespace:
    dims = [SimpleNamespace(label="d", size=size) for size in sizes]
    return SimpleNamespace(dim=dims, data_offset=offset)


def test_samples_are_a_row() -> None:
    assert samples_of(SimpleNamespace(data=[9.0, 1.0, 2.0], layout=layout(offset=1))).tolist() == [1, 2]
    assert samples_of(SimpleNamespace(data=[1.0, 2.0], layout=layout(2, 1))).tolist() == [1, 2]
    assert samples_of(SimpleNamespace(data=3.0)).tolist() == [3]
    with pytest.raises(SamplesError, match=r"2 dimensions \(d: 2, d: 2\); should be a row"):
        samples_of(SimpleNamespace(data=[1.0] * 4, layout=layout(2, 2)))


@pytest.mark.parametrize("kind", ["Float32", "Float64"])
@pytest.mark.parametrize("labels", [[], ["samples"], ["s", "channels"]], ids=len)
def test_bytes_of_a_message_are_read_as_ros_writes_them(kind: str, labels: list[str]) -> None:
    std_msgs = pytest.importorskip("std_msgs.msg")
    from rclpy.serialization import serialize_message

    dims = [std_msgs.MultiArrayDimension(label=label, size=3 if not n else 1) for n, label in enumerate(labels)]
    message = getattr(std_msgs, f"{kind}MultiArray")(data=[1.5, -2.0, 3.0])
    message.layout.dim = dims
    name = f"std_msgs/msg/{kind}MultiArray"
    assert samples_in(name, serialize_message(message)).tolist() == [1.5, -2, 3]
    assert samples_in(f"std_msgs/msg/{kind}", serialize_message(getattr(std_msgs, kind)(data=0.5))).tolist() == [0.5]
    with pytest.raises(SamplesError, match="not such a message"):
        samples_in(name, serialize_message(message)[:-3])
