"""The whole graph on this machine: `ros2 launch bow sweep.launch.py preset:=fig11d`.

Without `preset` and `settings` it waits for goals on /bow/run_sweep. More simulators may join at any time, by
`ros2 run bow simulator`; with discovery_range:=SUBNET from other machines too, where
`ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET ros2 run bow simulator` starts one. All other parameters of the nodes are in a
file, config/nodes.yaml unless params_file names another; what is given here goes before it.
"""

import os
import re
from typing import List

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable, Shutdown
from launch.launch_description_entity import LaunchDescriptionEntity
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
RANGES = ("LOCALHOST", "SUBNET", "SYSTEM_DEFAULT")
PARAMETERS = os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "config", "nodes.yaml")
MOST_SIMULATORS = 100  # a DDS domain has ports for 120 processes of one machine

ARGUMENTS = {
    "preset": (
        "",
        "named sweep to run at once: fig10, fig11a ... fig11f; empty = as params_file says, which is to wait for goals",
    ),
    "settings": ("", 'settings over the preset, separated by spaces: "v_mid=0.3 x.count=32"'),
    "namespace": ("bow", "where the graph lives; two graphs need two"),
    "simulators": (
        str(min(len(os.sched_getaffinity(0)), MOST_SIMULATORS)),
        "how many simulators; the default is one per core",
    ),
    "runs_dir": ("runs", "run directories are made in this one, each named by its run_id"),
    "once": ("false", "true = end everything when the first run is finished"),
    "view": ("false", "true = open the live viewer"),
    "params_file": (PARAMETERS, "parameters of the nodes, YAML"),
    "discovery_range": (
        os.environ.get(RANGE) or "LOCALHOST",
        f"SUBNET = also find nodes on other machines, and listen to them; the default is what {RANGE} says",
    ),
}


def graph(context: LaunchContext) -> List[LaunchDescriptionEntity]:
    """Turn the arguments into nodes; what is wrong is said before any of them starts."""
    value = context.launch_configurations
    simulators = int(value["simulators"]) if re.fullmatch("[0-9]{1,9}", value["simulators"]) else 0
    if not 1 <= simulators <= MOST_SIMULATORS:
        raise RuntimeError(
            f"simulators:={value['simulators']}: a whole number from 1 on, to {MOST_SIMULATORS}, is needed"
        )
    reach = discovery_range(value["discovery_range"])
    file = readable("params_file", value["params_file"])
    place = namespace(value["namespace"])
    directory = {"runs_dir": writable("runs_dir", value["runs_dir"])}
    sweep = {**directory, **switched_on("once", value["once"])}
    if value["preset"]:
        sweep["preset"] = value["preset"]
    if value["settings"].split():  # an empty list has no type in a parameter file
        sweep["settings"] = value["settings"].split()
    dashboard = {**directory, **switched_on("view", value["view"])}

    def node(executable: str, name: str, parameters: dict, **life: object) -> Node:
        given = [{key: typed(one) for key, one in parameters.items()}] if parameters else []
        return Node(
            package="bow",
            executable=executable,
            name=name,
            namespace=place,
            parameters=[file, *given],
            output="screen",
            emulate_tty=True,
            **life,
        )

    # The coordinator is the run; whoever else dies comes back, and its work is done again.
    again = {"respawn": True, "respawn_delay": 2.0}
    return [
        SetEnvironmentVariable(RANGE, reach),  # the nodes' profile follows
        node("recorder", "recorder", directory, **again),
        node("classifier", "classifier", {}, **again),
        node("dashboard", "dashboard", dashboard, **again),
        *(node("simulator", f"simulator_{i}", {}, **again) for i in range(1, simulators + 1)),
        node("coordinator", "coordinator", sweep, on_exit=Shutdown(reason="the coordinator ended")),
    ]


def discovery_range(text: str) -> str:
    """Read how far the graph reaches."""
    if text.upper() not in RANGES:
        why = ": with it no node finds another" if text.upper() == "OFF" else ""
        where = f"discovery_range:={text} ({RANGE} is its default)"
        raise RuntimeError(f"{where}{why}; LOCALHOST, for this machine alone, or SUBNET is needed")
    return text.upper()


def namespace(text: str) -> str:
    """Read a namespace."""
    if not re.fullmatch("/?([A-Za-z_][A-Za-z0-9_]*/)*[A-Za-z_][A-Za-z0-9_]*/?", text):
        raise RuntimeError(f"namespace:={text}: letters, digits and _ are needed, parted by /, as in bow or lab/bow")
    return text


def readable(name: str, text: str) -> str:
    """Read the path of a file that is there."""
    path = os.path.abspath(os.path.expanduser(text))
    try:
        with open(path, "rb"):
            return path
    except OSError as error:
        raise RuntimeError(f"{name}:={text}: cannot be read: {error.strerror}; a file is needed") from None


def writable(name: str, text: str) -> str:
    """Read the path of a directory, and make it."""
    path = os.path.abspath(os.path.expanduser(text))
    try:
        os.makedirs(path, exist_ok=True)
        if not os.access(path, os.W_OK | os.X_OK):
            raise PermissionError(0, "nobody else may write there")
    except OSError as error:
        why = f"cannot be made or written: {error.strerror}"
        raise RuntimeError(f"{name}:={text}: {why}; a directory of yours is needed") from None
    return path


def switched_on(name: str, text: str) -> dict:
    """Read true or false; false leaves a parameter as the file has it."""
    if text.lower() not in ("true", "false"):
        raise RuntimeError(f"{name}:={text}: true or false is needed")
    return {name: True} if text.lower() == "true" else {}


def typed(given: object) -> ParameterValue:
    """Keep a text a text: launch would read the directory 2024 as a number, and the preset `on` as a boolean."""
    return ParameterValue(given, value_type=List[str] if isinstance(given, list) else type(given))


def generate_launch_description() -> LaunchDescription:
    """Called by `ros2 launch`."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=graph)])
