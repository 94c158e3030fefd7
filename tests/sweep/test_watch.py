"""What the supervisor hears and does: processes whose work is over go, and nobody's word but our run's sends them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from bow_msgs.msg import Health, Plan

from bow_sim import wire
from bow_sweep import leftovers
from bow_sweep.supervisor import Child, Supervisor
from bow_sweep.watch import STUCK_S, SupervisorNode

RUN = "a" * 16


def plan(run_id: str, state: int) -> bytes:
    kinds = {"string": "", "string[]": [], "uint8[]": [], "uint8": 0, "uint32": 1}
    values = {field: kinds[kind] for field, kind in wire.FIELDS["Plan"].items()}
    return wire.encode("Plan", {**values, "run_id": run_id, "state": state})


@pytest.mark.parametrize(
    ("data", "closed"),
    [
        (plan(RUN, Plan.CLOSED), True),
        (plan(RUN, Plan.OPEN), False),
        (plan("b" * 16, Plan.CLOSED), False),
        (plan(RUN, Plan.CLOSED)[:40], False),
    ],
)
def test_only_the_plan_of_our_run_sends_simulators_home(data: bytes, closed: bool) -> None:
    node = SimpleNamespace(closed=False, get_namespace=lambda: f"/bow/{RUN}")
    SupervisorNode._on_plan(node, data)  # type: ignore[arg-type]
    assert node.closed is closed


def test_who_does_not_find_the_others_is_named_once_consumers_first() -> None:
    node = SimpleNamespace(worked=set(), _starting={})

    def says(pid: int, role: str, state: int, now: float, run: str = RUN) -> None:
        message = Health(pid=pid, role=role, state=state, run_id=run)
        SupervisorNode._note_start(node, message, now)  # type: ignore[arg-type]

    def stuck(now: float) -> set[int]:
        return SupervisorNode.stuck(node, now)  # type: ignore[arg-type]

    says(1, "recorder", Health.STARTING, 0)
    says(2, "simulator", Health.STARTING, 0)
    says(3, "classifier", Health.STARTING, 0)
    says(4, "simulator", Health.STARTING, 0, run="")  # waits for a plan
    says(1, "recorder", Health.STARTING, STUCK_S)
    says(3, "classifier", Health.BUSY, 1)
    assert stuck(STUCK_S) == set()
    assert stuck(STUCK_S + 1) == {1}
    assert stuck(STUCK_S + 1) == set()
    says(5, "recorder", Health.STARTING, STUCK_S + 2)
    says(5, "recorder", Health.BUSY, STUCK_S + 3)
    assert stuck(2 * STUCK_S + 1) == set()
    assert stuck(2 * STUCK_S + 2) == {2}
    assert stuck(3 * STUCK_S + 3) == set()
    assert node.worked == {3, 5}


def test_a_note_names_segments_and_nothing_else(tmp_path: Path) -> None:
    files = {"/dev/shm/fastrtps_0123456789abcdef_el", str(lent_by(1234))}
    note = tmp_path / "note"
    assert leftovers.noted(note) == set()
    leftovers.note(note, files)
    with open(note, "a") as file:
        file.write("/etc/passwd\n/dev/shm/fastrtps_0123456789abcdef_el/../x\n/tmp/fast_datasharing_01\n\n\x00")
    assert leftovers.noted(note) == files
    leftovers.note(tmp_path / "nowhere" / "note", files)


def lent_by(pid: int, number: str = "f1.4e") -> Path:
    """Return the file, as Fast DDS names it, that a process would lend."""
    name = f"fast_datasharing_01.0f.be.ef.{pid % 256:02x}.{pid // 256 % 256:02x}.{number}.00.00.00.00_0.0.14.3"
    return Path("/dev/shm") / name


def test_what_a_process_lends_goes_with_it_and_not_before() -> None:
    keeps = "import mmap, os, sys; m = mmap.mmap(os.open(sys.argv[1], os.O_RDWR), 0); print(flush=True); input()"
    start = Path("/dev/shm/fast_datasharing_01.0f.be.ef.00.00.f1.4e.00.00.00.00_0.0.14.3")
    start.write_bytes(bytes(4096))
    with subprocess.Popen(
        [sys.executable, "-c", keeps, start], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        start.rename(lent_by(process.pid))  # its mapping follows the name
        others = lent_by(process.pid, "00.00")  # of a process of the same number, elsewhere
        others.write_bytes(b"x")
        try:
            files = leftovers.files_of(process.pid)
            assert files == {str(lent_by(process.pid))}
            assert leftovers.files_of(process.pid, files) == set()
            assert leftovers.remove(files) == 0
            process.kill()
            process.wait()
            assert leftovers.files_of(process.pid) == set()
            assert leftovers.remove(files) == 1
            assert leftovers.remove(files) == 0
            assert others.exists()
        finally:
            others.unlink()
            lent_by(process.pid).unlink(missing_ok=True)


PATIENT = """
import signal, time
signal.signal(signal.SIGINT, signal.SIG_DFL)  # where the tests run in the background, it is ignored
print("listens", flush=True)
time.sleep(60)
"""


def test_those_released_end_and_are_not_taken_for_dead(tmp_path: Path) -> None:
    supervisor = Supervisor("/bow/x", tmp_path, {})
    for name in ("simulator_1", "simulator_2", "recorder"):
        process = subprocess.Popen([sys.executable, "-c", PATIENT], stdout=subprocess.PIPE)
        assert process.stdout
        with process.stdout as output:
            assert output.readline() == b"listens\n"
        supervisor.children.append(Child(name.partition("_")[0], name, process, tmp_path / f"{name}.log"))
    simulators = supervisor.children[:2]
    supervisor.release(("simulator",))
    supervisor.release(("simulator",))
    for child in simulators:
        child.process.wait(10)
    assert supervisor.buried() == []
    assert [child.name for child in supervisor.children] == ["recorder"]
    assert supervisor.stop(idle=True) == []
    assert supervisor.children == []
