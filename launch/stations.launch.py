"""Stations of a run on a list of machines: `ros2 launch bow stations.launch.py hosts:="lab1 lab2" run:=RUN_ID`.

`bow sweep fig11d --network WHERE` on this machine prints RUN_ID. On each host, reached by ssh without a password, `bow
station` joins the run with simulators, a recorder and a classifier of its own; Ctrl-C here ends them all, and the run
goes on without them. A station is named by its host: lab-2.example.org is lab_2.
"""

import re
import shlex
from typing import List

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.launch_description_entity import LaunchDescriptionEntity

from bow_sim.protocol.stations import StationError, check_name

ARGUMENTS = {
    "hosts": (None, "machines, as ssh knows them, separated by spaces: lab1 me@lab2"),
    "run": (None, "identity of the run, 16 hexadecimal digits, as `bow sweep --network` prints it"),
    "network": ("SUBNET", "where the hosts find the run's machine: SUBNET, or its name or address"),
    "simulators": ("", "how many on each host; empty = one a core"),
    "out": ("runs", "directory on each host in which RUN_ID/ is made"),
    "program": ("bow", "the command on the hosts, with its directory if that is not on their PATH"),
}


def station_of(host: str) -> str:
    """Return the name of a host's station; raises RuntimeError where two rules of naming cannot both be kept."""
    short = host.rpartition("@")[2]
    plain = short if re.fullmatch("[0-9.]+", short) else short.partition(".")[0]
    name = re.sub("[^a-z0-9_]", "_", plain.lower())
    try:
        return check_name(name if name[:1].isalpha() else f"host_{name}")
    except StationError as error:
        raise RuntimeError(f"hosts: {host!r} has no name for a station: {error}") from None


def stations(context: LaunchContext) -> List[LaunchDescriptionEntity]:
    """Turn the arguments into one ssh a host; a wrong argument raises before any of them starts."""
    value = context.launch_configurations
    hosts = value["hosts"].split()
    names = [station_of(host) for host in hosts]
    if not hosts or len(set(names)) < len(names):
        raise RuntimeError(f"hosts:={value['hosts']!r}: should be machines with different names, separated by spaces")
    if any(host.startswith("-") for host in hosts):
        raise RuntimeError(f"hosts:={value['hosts']!r}: a machine's name does not begin with -")
    options = ["--run", value["run"], "--network", value["network"], "--out", value["out"]]
    if value["simulators"]:
        options += ["--simulators", value["simulators"]]
    ssh = ["ssh", "-tt", "-o", "BatchMode=yes"]  # with a terminal, so that the station ends with its ssh
    return [
        ExecuteProcess(cmd=[*ssh, host, shlex.join([value["program"], "station", name, *options])], output="screen")
        for host, name in zip(hosts, names, strict=True)
    ]


def generate_launch_description() -> LaunchDescription:
    """Called by `ros2 launch`."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=stations)])
