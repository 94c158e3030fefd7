"""The whole graph on this machine: `ros2 launch bow sweep.launch.py preset:=fig11d`.

Without `preset` and `settings` it waits for goals on /bow/run_sweep. More simulators may join at any time, by
`ros2 run bow simulator`; with discovery_range:=SUBNET from other machines too, where
`ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET ros2 run bow simulator` starts one.
"""

import os
from typing import List

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable, Shutdown
from launch.launch_description_entity import LaunchDescriptionEntity
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "preset": (
        "",
        "named sweep to run at once: fig10, fig11a ... fig11f; empty = wait for goals, unless settings say else",
    ),
    "settings": ("", 'settings over the preset, separated by spaces: "v_mid=0.3 x.count=32"'),
    "namespace": ("bow", "where the graph lives; two graphs need two"),
    "simulators": (str(len(os.sched_getaffinity(0))), "how many simulators; the default is one per core"),
    "runs_dir": ("runs", "run directories are made in this one, each named by its run_id"),
    "once": ("false", "true = end everything when the first run is finished"),
    "view": ("false", "true = open the live viewer"),
    "discovery_range": ("LOCALHOST", "SUBNET = also find nodes on other machines, and listen to them"),
}


def graph(context: LaunchContext) -> List[LaunchDescriptionEntity]:
    """Turn the arguments into nodes."""
    value = context.launch_configurations
    try:
        simulators = int(value["simulators"])
    except ValueError:
        simulators = 0
    if simulators < 1:
        raise RuntimeError(f"simulators:={value['simulators']}: a whole number from 1 on is needed")
    directory = {"runs_dir": os.path.abspath(os.path.expanduser(value["runs_dir"]))}
    sweep = {"preset": value["preset"], "once": flag("once", value["once"]), **directory}
    if value["settings"].split():  # an empty list has no type in a parameter file
        sweep["settings"] = value["settings"].split()
    dashboard = {"view": flag("view", value["view"]), **directory}

    def node(executable: str, name: str, parameters: dict, **life: object) -> Node:
        return Node(
            package="bow",
            executable=executable,
            name=name,
            namespace=value["namespace"],
            parameters=[{key: typed(given) for key, given in parameters.items()}] if parameters else [],
            output="screen",
            emulate_tty=True,
            **life,
        )

    # The coordinator is the run; whoever else dies comes back, and its work is done again.
    again = {"respawn": True, "respawn_delay": 2.0}
    return [
        SetEnvironmentVariable("ROS_AUTOMATIC_DISCOVERY_RANGE", value["discovery_range"]),  # the nodes' profile follows
        node("recorder", "recorder", directory, **again),
        node("classifier", "classifier", {}, **again),
        node("dashboard", "dashboard", dashboard, **again),
        *(node("simulator", f"simulator_{i}", {}, **again) for i in range(1, simulators + 1)),
        node("coordinator", "coordinator", sweep, on_exit=Shutdown(reason="the coordinator ended")),
    ]


def flag(name: str, text: str) -> bool:
    """Read true or false."""
    if text.lower() not in ("true", "false"):
        raise RuntimeError(f"{name}:={text}: true or false is needed")
    return text.lower() == "true"


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
