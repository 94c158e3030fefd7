"""Stations by launchers that others have: a launch file for hosts, a Slurm job, a systemd unit, containers."""

from __future__ import annotations

import configparser
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from checkout import ROOT
from compose import compose_services
from graph import PATIENCE_S, SMALL, verified
from launch_stand_ins import launched, put_in_place

from bow_sweep.cli import station as station_command
from bow_sweep.cli.parser import parser

RUN_ID = "a123456789abcdef"

SRUN = """#!/bin/bash
for word; do case $word in --ntasks=*) tasks=${word#*=};; esac; done
while [[ $1 == --* ]]; do shift; done
for ((task = 0; task < tasks; task++)); do SLURM_PROCID=$task "$@" & done
wait
"""

SCONTROL = '#!/bin/bash\n[ "$1 $2" = "show hostnames" ] && printf "%s\\n" ${3//,/ }\n'

BOW = """#!/bin/bash
printf '%s\\n' "$*" >> "$SAID"
if [ "$1" = sweep ]; then
    out=; while [ $# -gt 0 ]; do if [ "$1" = --out ]; then out=$2; fi; shift; done
    if [ -n "$STATUS" ]; then exit "$STATUS"; fi
    if [ -n "$out" ]; then mkdir -p "$out"; echo '{}' > "$out/ledger.jsonl"; fi  # not where it goes on with a run
    for ((i = 0; i < 600 && $(grep -c '^station' "$SAID") < 2; i++)); do sleep 0.1; done
elif [ "$1" = station ]; then
    while [ $# -gt 0 ]; do if [ "$1" = --out ]; then mkdir -p "$2/RUN_ID/bag/x"; fi; shift; done
fi
"""


def scripts(folder: Path, **texts: str) -> None:
    """Write executable files."""
    folder.mkdir()
    for name, text in texts.items():
        (folder / name).write_text(text)
        (folder / name).chmod(0o755)


def submit(folder: Path, nodes: str, *words: str, **more: str) -> subprocess.CompletedProcess[str]:
    """Run the job script as Slurm would on these nodes."""
    variables = {"PATH": f"{folder / 'bin'}:{os.environ['PATH']}", "SLURM_JOB_ID": "7", "SLURM_JOB_NODELIST": nodes}
    return subprocess.run(
        [ROOT / "examples" / "slurm.sh", *words],
        env={**os.environ, **variables, **more},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


def test_the_job_gives_the_first_node_the_sweep_and_each_other_a_station(tmp_path: Path) -> None:
    scripts(tmp_path / "bin", srun=SRUN, scontrol=SCONTROL, bow=BOW.replace("RUN_ID", RUN_ID))
    said, run, local = tmp_path / "said", tmp_path / "run-7", tmp_path / "run-7.stations"
    result = submit(tmp_path, "n1,n2,n3", "fig11d", "--nx", "8", SAID=str(said), STATUS="")
    assert result.returncode == 0, result.stderr
    lines = sorted(said.read_text().splitlines())
    assert lines == [
        f"collect {run} {local}/{RUN_ID}/",
        f"station job7_node_1 --run {run} --network n1 --out {local}",
        f"station job7_node_2 --run {run} --network n1 --out {local}",
        f"sweep fig11d --nx 8 --out {run} --network n2,n3",
    ]
    for line in lines:
        parser().parse_args(shlex.split(line))


def test_a_job_goes_on_with_a_run_that_has_begun(tmp_path: Path) -> None:
    """What the stations of the job before have left is collected first; those of this one have bags of their own."""
    scripts(tmp_path / "bin", srun=SRUN, scontrol=SCONTROL, bow=BOW.replace("RUN_ID", RUN_ID))
    said, run, local = tmp_path / "said", tmp_path / "mine", tmp_path / "mine.stations"
    run.mkdir()
    (run / "ledger.jsonl").write_text("{}")
    (local / RUN_ID / "bag" / "job6_node_1").mkdir(parents=True)
    words = ["fig11d", "--i-trust-this-network"]  # as given at first: Slurm queues a job again with the same words
    more = {"SLURM_RESTART_COUNT": "1", "RUN": "mine"}
    result = submit(tmp_path, "n1,n2,n3", *words, SAID=str(said), STATUS="", **more)
    assert result.returncode == 0, result.stderr
    first, *lines = said.read_text().splitlines()
    assert first == lines.pop() == f"collect {run} {local}/{RUN_ID}/"
    trust = "--i-trust-this-network"
    assert sorted(lines) == [
        f"station job7_again_1_node_1 --run {run} --network n1 --out {local} {trust}",
        f"station job7_again_1_node_2 --run {run} --network n1 --out {local} {trust}",
        f"sweep --resume {run} {trust} --network n2,n3",
    ]


def test_a_job_outlives_a_node_that_is_not_its_first() -> None:
    """Slurm ends the job otherwise; tried with a node whose slurmd was killed."""
    text = (ROOT / "examples" / "slurm.sh").read_text()
    assert "\n#SBATCH --no-kill\n" in text
    assert re.search(r"^srun .*--no-kill", text, re.MULTILINE)


def test_a_job_whose_sweep_does_not_start_ends_with_its_status(tmp_path: Path) -> None:
    scripts(tmp_path / "bin", srun=SRUN, scontrol=SCONTROL, bow=BOW.replace("RUN_ID", RUN_ID))
    result = submit(tmp_path, "n1,n2", "nothing", SAID=str(tmp_path / "said"), STATUS="2")
    assert result.returncode == 2
    assert "the sweep did not start" in result.stderr
    assert "station" not in (tmp_path / "said").read_text()


@pytest.mark.full
@pytest.mark.usefixtures("ros_domain")
def test_a_job_on_two_nodes_leaves_one_whole_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)
    scripts(tmp_path / "bin", srun=SRUN, scontrol=SCONTROL)
    bow = str(Path(sys.executable).parent / "bow")
    words = [*SMALL, "--simulators", "1", "--no-dashboard", "--i-trust-this-network"]
    result = submit(tmp_path, "localhost,localhost", *words, BOW=bow)
    assert result.returncode == 0, result.stdout + result.stderr
    assert verified(tmp_path / "run-7")["cells"]


def test_the_launch_file_starts_a_station_on_each_host(monkeypatch: pytest.MonkeyPatch) -> None:
    put_in_place(monkeypatch)
    hosts = "lab1 me@Lab-2.example.org 10.0.0.3"
    started = launched("stations.launch.py", hosts=hosts, run=RUN_ID, out="my runs", simulators=3)
    names = []
    for process, host in zip(started, hosts.split(), strict=True):
        *ssh, to, remote = process.cmd
        assert ssh[0] == "ssh" and to == host
        program, *words = shlex.split(remote)  # as the shell of the other machine does
        chosen = parser().parse_args(words)
        assert (program, chosen.command, chosen.joined, chosen.network) == ("bow", "station", RUN_ID, "SUBNET")
        assert (chosen.out, chosen.simulators) == (Path("my runs"), 3)
        names.append(chosen.name)
    assert names == ["lab1", "lab_2", "host_10_0_0_3"]
    for wrong in ("", "lab1 me@lab1", "-oProxyCommand=x"):
        with pytest.raises(RuntimeError, match="hosts"):
            launched("stations.launch.py", hosts=wrong, run=RUN_ID)


def test_the_unit_starts_a_station_that_its_file_names() -> None:
    unit = configparser.ConfigParser(strict=False, interpolation=None)
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    unit.read_string(text := (ROOT / "examples" / "bow-station.service").read_text())
    (named,) = set(re.findall("[0-9a-f]{16}", text))
    assert station_command.RUN_ID.fullmatch(named)
    line = unit["Service"]["ExecStart"]
    for name, value in {
        "NAME": "lab2",
        "RUN": RUN_ID,
        "NETWORK": "10.0.0.1",
        "STATE_DIRECTORY": "/var/lib/bow",
    }.items():
        line = line.replace(f"${{{name}}}", value)
    program, *words = shlex.split(line)
    chosen = parser().parse_args(words)
    assert Path(program).name == "bow"
    assert (chosen.name, chosen.joined, chosen.network) == ("lab2", RUN_ID, "10.0.0.1")
    assert chosen.out == Path("/var/lib/bow")
    assert unit["Service"]["SuccessExitStatus"] == "130", "that of a station that is interrupted"
    assert unit["Service"]["RestartPreventExitStatus"] == "2", "with wrong arguments it would start for ever"


def test_systemd_finds_no_fault_in_the_unit(tmp_path: Path) -> None:
    if shutil.which("systemd-analyze") is None:
        pytest.skip("there is no systemd-analyze here (Debian: systemd)")
    text = (ROOT / "examples" / "bow-station.service").read_text()
    unit = tmp_path / "bow-station.service"
    for wrong in ("", "Restarts=on-failure\n"):
        unit.write_text(text.replace("/opt/bow/bin/bow", sys.executable).replace("[Install]", f"{wrong}[Install]"))
        found = subprocess.run(["systemd-analyze", "verify", unit], capture_output=True, text=True, check=False)
        faults = [line for line in found.stderr.splitlines() if unit.name in line]
        assert len(faults) == bool(wrong), found.stderr


def test_the_services_of_the_compose_file_are_commands_of_ours_and_share_no_host() -> None:
    services = compose_services(NAME="lab2", RUN=RUN_ID, NETWORK="10.0.0.1", ROS_DOMAIN_ID="7", RUNS="/data")
    chosen = {}
    for name, service in services.items():
        program, *words = [*service["entrypoint"], *service["command"]]
        assert program == "bow"
        chosen[name] = parser().parse_args(words)
        assert (service["stop_signal"], service["init"]) == ("SIGINT", True)
        assert service["volumes"][0] == "/data:/work/runs"
        assert service["environment"]["ROS_DOMAIN_ID"] == 7
        assert service["ipc"] == "private", (
            "with one /dev/shm, one would remove the files of another, whose processes it does not see"
        )
    assert (chosen["sweep"].command, chosen["sweep"].network) == ("sweep", "10.0.0.1")
    station = chosen["station"]
    assert (station.name, station.joined, station.network) == ("lab2", RUN_ID, "10.0.0.1")
    assert {name for name, each in services.items() if each.get("network_mode") == "host"} == {"sweep", "station"}
    tried = [services["try-sweep"], services["try-station"]]
    assert len({each["hostname"] for each in tried}) == 2, "processes are known by host and number"
    assert chosen["try-sweep"].out == Path(chosen["try-station"].joined)
    assert chosen["try-station"].network == tried[0]["hostname"], "a network that is internal drops multicast"
    assert tried[0]["healthcheck"]["test"][-1] == f"{chosen['try-sweep'].out}/ledger.jsonl"
    assert tried[1]["depends_on"] == {"try-sweep": {"condition": "service_healthy"}}


def test_a_station_service_without_a_run_is_refused_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    service = compose_services()["station"]
    args = parser().parse_args([*service["entrypoint"][1:], *service["command"]])
    assert args.run(args) == 2
    assert "--run RUN_ID: should be the identity of a run" in capsys.readouterr().err
