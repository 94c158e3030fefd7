"""A sweep on two machines, one of which holds only simulators; and one that no other machine hears or reaches."""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest
from compose import compose_services
from domains import own_domain
from graph import (
    PATIENCE_S,
    SMALL,
    Sweep,
    assert_same_map,
    bow,
    computed_by,
    entries_of,
    run_sweep,
    stations_of,
    sweeping,
    verified,
)
from machines import ADDRESSES, FAR, NEAR, Machines

from bow_sweep.run.ledger_file import done_at

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("ros_domain")]

LONG = ["fig11d", "--nx", "64", "--ny", "96", "--set", "block_cells=32"]
"""6144 cells in 192 blocks: enough that a simulator that comes late, on a busy machine, gets its share."""

LOOK = "import sys, rclpy; from bow_sim.graph import discovery; discovery.apply_defaults(); rclpy.init()\n" + (
    "import time; node = rclpy.create_node('eye'); end = time.monotonic() + float(sys.argv[1])\n"
    "awaited, late = set(sys.argv[2:]), end + 60\n"
    "while (now := time.monotonic()) < end or (now < late and not awaited <= set(node.get_node_names())):\n"
    "    rclpy.spin_once(node, timeout_sec=0.1)\n"
    "print(*[f'{space}/{name}' for name, space in node.get_node_names_and_namespaces()])"
)
"""Prints the nodes that are discovered within some seconds, and until those awaited are, a minute longer at most."""


def hold_until(sweep: Sweep, there_are_others: Callable[[], bool]) -> None:
    """Stop the sweep's own simulator, after its first block, until others have had a part of the work too."""
    own_name = re.compile("/bow/[0-9a-f]+/simulator_1")
    sweep.wait_until(lambda: any(map(own_name.fullmatch, computed_by(sweep.directory))))
    (own,) = sweep.children("simulator")
    own.send_signal(signal.SIGSTOP)
    sweep.wait_until(there_are_others)
    own.send_signal(signal.SIGCONT)


OLD = {
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA",
}
"""With these, the libraries take this machine for one with an older processor."""

COMPILE = "from bow_sweep.plan.sweep import Sweep; print(Sweep.from_spec('fig11d').fingerprint)"


@contextlib.contextmanager
def joined(two: Machines, sweep: Sweep, log: Path, **machine: str) -> Iterator[None]:
    """Start a simulator on the other machine, by the very line that the sweep prints."""
    sweep.wait_until(lambda: "join with: " in sweep.text)
    line = re.search("join with: (.*)", sweep.text)
    assert line
    words = [*(f"{name}='{value}'" for name, value in machine.items()), line[1]]
    with open(log, "wb") as output:
        command = two.command(FAR, "sh", "-c", f"exec env {' '.join(words)}")
        simulator = subprocess.Popen(command, stdout=output, stderr=output)
    try:
        hold_until(sweep, lambda: len(computed_by(sweep.directory)) == 2)
        yield
        assert simulator.poll() is None, log.read_text()
    finally:
        simulator.terminate()
        simulator.wait(30)


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sweep on one machine."""
    with own_domain():
        return run_sweep(tmp_path_factory.mktemp("alone") / "run", *LONG)


@pytest.mark.parametrize(("where", "machine"), [("SUBNET", {}), (ADDRESSES[FAR], OLD)], ids=["alike", "older"])
def test_simulators_of_another_machine_share_the_work_and_the_map_is_the_same(
    where: str, machine: dict[str, str], two: Machines, alone: Path, tmp_path: Path
) -> None:
    if machine:  # compiled before, so that it comes in time for its share
        subprocess.run([sys.executable, "-c", COMPILE], env={**os.environ, **machine}, check=True, timeout=300)
    run = tmp_path / "run"
    arguments = [*LONG, "--simulators", "1", "--network", where, "--out", str(run)]
    with (
        sweeping(run, *arguments, outer=two.command(NEAR)) as sweep,
        joined(two, sweep, tmp_path / "far.log", **machine),
    ):
        assert sweep.wait() == 0, sweep.text
    verified(run)
    assert_same_map(alone, run)
    shares = computed_by(run)
    assert sum(shares.values()) == 192
    (here,) = [name for name in shares if name.endswith("/simulator_1")]
    (there,) = [name for name in shares if name != here]
    assert min(shares[here], shares[there]) >= 5, shares


def test_machines_meet_at_a_discovery_server(
    two: Machines, alone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    server = Path(sys.executable).with_name("fast-discovery-server")
    if not server.exists():
        pytest.skip("no fast-discovery-server here")
    words = two.command(NEAR, str(server), "-i", "0", "-l", ADDRESSES[NEAR], "-p", "11811")
    monkeypatch.setenv("ROS_DISCOVERY_SERVER", f"{ADDRESSES[NEAR]}:11811")
    monkeypatch.setenv("ROS_SUPER_CLIENT", "TRUE")
    process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    run = tmp_path / "run"
    arguments = [*LONG, "--simulators", "1", "--out", str(run)]
    try:
        with sweeping(run, *arguments, outer=two.command(NEAR)) as sweep, joined(two, sweep, tmp_path / "far.log"):
            assert sweep.wait() == 0, sweep.text
    finally:
        process.kill()
        process.communicate()
    verified(run)
    assert_same_map(alone, run)
    assert min(computed_by(run).values()) >= 5
    assert len(computed_by(run)) == 2


def test_the_work_of_a_machine_that_is_cut_off_goes_to_the_others(two: Machines, alone: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    arguments = [*LONG, "--simulators", "1", "--network", "SUBNET", "--out", str(run)]
    with sweeping(run, *arguments, outer=two.command(NEAR)) as sweep, joined(two, sweep, tmp_path / "far.log"):
        sweep.wait_until(lambda: sweep.done_blocks() > 0 and len(computed_by(run)) == 2)
        two.run(FAR, "ip", "link", "set", "cable1", "down")
        assert sweep.wait() == 0, sweep.text
    verified(run)
    assert_same_map(alone, run)


def test_a_station_of_another_machine_keeps_its_waveforms_and_loses_its_work_when_it_is_cut_off(
    two: Machines, alone: Path, tmp_path: Path
) -> None:
    run, out, log = tmp_path / "run", tmp_path / "lab", tmp_path / "lab.log"
    arguments = [*LONG, "--simulators", "1", "--network", "SUBNET", "--out", str(run)]
    with sweeping(run, *arguments, outer=two.command(NEAR)) as sweep:
        far = start_station("lab", two, FAR, sweep)
        try:
            hold_until(sweep, lambda: "lab" in stations_of(run))
            assert far.poll() is None, log.read_text()
            two.run(FAR, "ip", "link", "set", "cable1", "down")
            assert sweep.wait() == 0, sweep.text
        finally:
            far.send_signal(signal.SIGINT)
            assert far.wait(PATIENCE_S) == 130, log.read_text()
    report = verified(run)
    assert_same_map(alone, run)
    assert {name: len(blocks) for name, blocks in report["unseen"].items()} == {"lab": stations_of(run)["lab"]}
    shutil.copytree(next(out.glob("*/bag/lab")), run / "bag" / "lab")
    assert bow("recover", str(run)).returncode == 0  # without the others a recorder may not end in time
    report = verified(run)
    assert report["unseen"] == {}
    assert report["verdicts_equal"] == report["chunks_planned"]


def test_of_four_stations_one_is_killed_one_suspended_and_one_cut_off(
    two: Machines, alone: Path, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    arguments = [*LONG, "--simulators", "1", "--no-dashboard", "--network", "SUBNET", "--out", str(run)]
    with sweeping(run, *arguments, outer=two.command(NEAR)) as sweep:
        places = {"killed": NEAR, "suspended": NEAR, "far": FAR}
        stations = {name: start_station(name, two, where, sweep) for name, where in places.items()}
        families: dict[str, list[psutil.Process]] = {}
        try:
            hold_until(sweep, lambda: places.keys() <= stations_of(run).keys())
            for name, process in stations.items():
                families[name] = [psutil.Process(process.pid), *psutil.Process(process.pid).children(recursive=True)]
            two.run(FAR, "ip", "link", "set", "cable1", "down")
            for name, sent in (("killed", signal.SIGKILL), ("suspended", signal.SIGSTOP)):
                for each in families[name]:
                    each.send_signal(sent)
            time.sleep(10)
            for each in families["suspended"]:
                each.send_signal(signal.SIGCONT)
            assert sweep.wait() == 0, sweep.text
        finally:
            for name in ("suspended", "far"):
                stations[name].send_signal(signal.SIGINT)
                stations[name].wait(PATIENCE_S)
            stations["killed"].wait(PATIENCE_S)
    assert_same_map(alone, run)
    shares = stations_of(run)
    assert shares.keys() == {"", *places}
    assert sum(shares.values()) == 192
    assert {name: len(blocks) for name, blocks in verified(run)["unseen"].items()} == {
        name: shares[name] for name in places
    }
    (whole,) = {made.parent.parent for made in tmp_path.glob("*/*/bag/killed")}
    assert bow("recover", str(whole)).returncode == 0  # it was killed while it wrote
    collected = bow("collect", str(run), *(str(made) for made in tmp_path.glob("*/*") if (made / "bag").is_dir()))
    assert collected.returncode == 0, collected.stderr
    report = verified(run)
    assert report["unseen"] == {}
    assert report["verdicts_equal"] == report["chunks_planned"]


def test_a_station_goes_on_with_a_run_whose_coordinator_is_killed_and_that_is_resumed(
    two: Machines, alone: Path, tmp_path: Path
) -> None:
    run, log = tmp_path / "run", tmp_path / "lab.log"
    common = ["--simulators", "1", "--no-dashboard", "--network", "SUBNET"]
    again = ["--resume", str(run), "--lost", "lab", *common]
    lab: subprocess.Popen[bytes] | None = None
    try:
        with sweeping(run, *LONG, *common, "--out", str(run), outer=two.command(NEAR)) as sweep:
            lab = start_station("lab", two, FAR, sweep)
            hold_until_lab_works(sweep, 0)
            sweep.kill("coordinator")
            assert sweep.wait() == 1, sweep.text
            assert "the coordinator ended (killed by SIGKILL)" in sweep.text
        with sweeping(run, *again, outer=two.command(NEAR)) as sweep:
            hold_until_lab_works(sweep, 1)
            assert log.read_text().count("this station waits for `bow sweep --resume RUN`") == 1
            sweep.wait_until(lambda: "the coordinator is heard again: this station goes on" in log.read_text())
            sweep.stop()  # all of it at once, as a power cut does
        until = time.monotonic() + PATIENCE_S
        while "is not heard for 6 s: this station waits" not in log.read_text():
            assert time.monotonic() < until, log.read_text()
            time.sleep(0.1)
        with sweeping(run, *again, outer=two.command(NEAR)) as sweep:
            hold_until_lab_works(sweep, 2).send_signal(signal.SIGCONT)
            assert sweep.wait() == 0, sweep.text
        assert lab.wait(PATIENCE_S) == 0, log.read_text()
    finally:
        if lab is not None and lab.poll() is None:
            lab.send_signal(signal.SIGINT)
            lab.wait(PATIENCE_S)
    text = log.read_text()
    assert text.count("this station waits for `bow sweep --resume RUN`") == 2, text
    assert "is not heard for 6 s" in text
    assert_same_map(alone, run)
    by_lab = {block for block, station in done_at(entries_of(run)).items() if station == "lab"}
    assert {name: set(blocks) for name, blocks in verified(run)["unseen"].items()} == {"lab": by_lab}


def hold_until_lab_works(sweep: Sweep, resumed: int) -> psutil.Process:
    """Stop the sweep's own simulator until station lab has done a block after so many resumptions; return it."""
    sweep.wait_until(lambda: bool(sweep.children("simulator")))
    (own,) = sweep.children("simulator")
    own.send_signal(signal.SIGSTOP)

    def works() -> bool:
        entries = entries_of(sweep.directory)
        starts = [number for number, entry in enumerate(entries) if entry["event"] == "resumed"]
        if len(starts) < resumed:
            return False
        latest = entries[starts[-1] :] if starts else entries
        return any(entry["event"] == "done" and entry.get("station") == "lab" for entry in latest)

    sweep.wait_until(works)
    return own


def test_the_containers_to_try_are_a_sweep_with_a_station(
    two: Machines, alone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their very commands, each on a machine of its own, with the folder that is their volume."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    services = compose_services()
    entry = services["try-sweep"]["entrypoint"]
    assert entry[:2] == ["bow", "sweep"]
    at = {services["try-sweep"]["hostname"]: ADDRESSES[NEAR]}  # Docker resolves the name
    station = [at.get(word, word) for each in ("entrypoint", "command") for word in services["try-station"][each]]
    is_healthy = services["try-sweep"]["healthcheck"]["test"][1:]
    run = tmp_path / "runs" / "try"
    with sweeping(run, *LONG, *entry[2:], outer=two.command(NEAR)) as sweep:
        sweep.wait_until(lambda: subprocess.run(is_healthy, check=False).returncode == 0)
        with open(tmp_path / "far.log", "wb") as output:
            far = subprocess.Popen(two.command(FAR, *station), stdout=output, stderr=output)
        try:
            hold_until(sweep, lambda: "far" in stations_of(run))
            assert sweep.wait() == 0, sweep.text
            assert far.wait(PATIENCE_S) == 0, (tmp_path / "far.log").read_text()
        finally:
            if far.poll() is None:
                far.send_signal(signal.SIGINT)
                far.wait(PATIENCE_S)
    assert_same_map(alone, run)
    (made,) = (tmp_path / "runs" / "stations").iterdir()
    assert bow("collect", str(run), str(made)).returncode == 0
    assert verified(run)["unseen"] == {}


def start_station(name: str, two: Machines, where: int, sweep: Sweep) -> "subprocess.Popen[bytes]":
    """Start a station on one of the machines, by the very line that the sweep prints; its bag goes beside the run."""
    sweep.wait_until(lambda: "of their own: " in sweep.text)
    line = re.search("of their own: (.*)", sweep.text)
    assert line
    out = sweep.directory.with_name(name)
    words = f"exec env {line[1].replace('NAME', name)} --network SUBNET --simulators 1 --out {out}"
    with open(out.with_suffix(".log"), "wb") as output:
        return subprocess.Popen(two.command(where, "sh", "-c", words), stdout=output, stderr=output)


def test_nobody_else_hears_or_reaches_a_sweep_unless_asked(two: Machines, tmp_path: Path) -> None:
    run = tmp_path / "run"
    wide = ["env", "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET", f"ROS_STATIC_PEERS={ADDRESSES[NEAR]}"]
    look = [sys.executable, "-c", LOOK]
    slow = ["fig11d", "--set", "block_cells=1"]
    with sweeping(run, *slow, "--out", str(run), outer=two.command(NEAR)) as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() > 0)
        assert "join with" not in sweep.text
        assert listening(two)
        nodes = {"coordinator", "recorder", "classifier", "simulator_1"}
        here = two.run(NEAR, *look, "6", *nodes).split()
        there = two.run(FAR, *wide, *look, "6").split()
        assert nodes <= {name.rpartition("/")[2] for name in here}
        assert there == ["//eye"]
        assert two.run(NEAR, "ss", "-Hltn") == ""
        sockets = listening(two)
        open_to_others = [port for address, port, _ in sockets if address != "127.0.0.1"]
        assert len(open_to_others) < len(sockets)
        # Fast DDS sends from sockets that are bound to every interface; but nobody reads from them.
        datagram = "import socket, sys\ns = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)\n" + (
            f"for port in sys.argv[1:]: s.sendto(b'RTPS' + bytes(60), ('{ADDRESSES[NEAR]}', int(port)))"
        )
        two.run(FAR, sys.executable, "-c", datagram, *map(str, open_to_others))
        time.sleep(1)
        waiting = {port: size for _, port, size in listening(two)}
        assert all(waiting[port] > 0 for port in open_to_others), waiting


def listening(two: Machines) -> list[tuple[str, int, int]]:
    """Return the UDP sockets of the first machine: address, port, bytes that came and were not read."""
    lines = [line.split() for line in two.run(NEAR, "ss", "-Hlun").splitlines()]
    return [(words[3].rpartition(":")[0], int(words[3].rpartition(":")[2]), int(words[1])) for words in lines]


def test_a_machine_that_is_not_known_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "bow_sweep", "sweep", *SMALL, "--out", str(tmp_path / "run")]
    for wrong in ("no.such.machine.invalid", "10.0.0.1;rm", "10.0.0.1,,10.0.0.2"):
        asked = [*words, "--network", wrong]
        result = subprocess.run(asked, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        assert result.returncode == 2
        assert "should be SUBNET, or machines" in result.stderr
        assert not (tmp_path / "run").exists()


def test_a_public_address_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "bow_sweep", "sweep", *SMALL, "--out", str(tmp_path / "run")]
    asked = [*words, "--network", "10.0.0.2,8.8.8.8"]
    result = subprocess.run(asked, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert result.returncode == 2
    assert re.search(r"8\.8\.8\.8, a public address.*--i-trust-this-network", result.stderr)
    assert not (tmp_path / "run").exists()
