"""The whole graph on this machine: `ros2 launch bow sweep.launch.py preset:=fig11d`.

Without `preset` and `settings` it waits for goals on /bow/run_sweep. More simulators may join at any time, by
`ros2 run bow simulator`; with discovery_range:=SUBNET from other machines too, where
`ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET ros2 run bow simulator` starts one. All other parameters of the nodes are in a
file, config/nodes.yaml unless params_file names another; an argument given here has priority over it.
"""

import os
from typing import List

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable, Shutdown
from launch.launch_description_entity import LaunchDescriptionEntity
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from bow_sweep.processes import launch_arguments as read

PARAMETERS = os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "config", "nodes.yaml")
MOST_SIMULATORS = 100  # a DDS domain has ports for 120 processes of one machine

ARGUMENTS = {
    "preset": (
        "",
        "named sweep to run at once: fig10, fig11a ... fig11f; empty = as params_file says, which is to wait for goals",
        None,
    ),
    "settings": ("", 'settings over the preset, separated by spaces: "v_mid=0.3 x.count=32"', None),
    "resume": ("", "directory of an unfinished run to go on with; everything ends when it is finished", None),
    "namespace": ("bow", "where the graph lives; two graphs need two", None),
    "simulators": (
        str(min(len(os.sched_getaffinity(0)), MOST_SIMULATORS)),
        "how many simulators; the default is one per core",
        None,
    ),
    "runs_dir": ("runs", "run directories are made in this one, each named by its run_id", None),
    "once": ("false", "true = end everything when the first run is finished", read.SWITCH),
    "dashboard": ("true", "false = no dashboard, and no dashboard.rrd", read.SWITCH),
    "view": ("false", "true = open the live viewer", read.SWITCH),
    "params_file": (PARAMETERS, "parameters of the nodes, YAML; an argument given here has priority over it", None),
    "log_level": ("info", "what the nodes log", read.LEVELS),
    "use_sim_time": (
        "false",
        "true = the clocks of the nodes follow /clock; nothing that they do depends on it",
        read.SWITCH,
    ),
    "discovery_range": (
        os.environ.get(read.RANGE) or read.DEFAULT_RANGE,
        f"SUBNET = also find nodes on other machines, and listen to them; the default is what {read.RANGE} says",
        None,
    ),
}


def graph(context: LaunchContext) -> List[LaunchDescriptionEntity]:
    """Turn the arguments into nodes; a wrong argument raises before any of them starts."""
    value = context.launch_configurations
    simulators = read.count("simulators", value["simulators"], MOST_SIMULATORS)
    discovery_range = read.discovery_range(value["discovery_range"])
    file = read.readable_file("params_file", value["params_file"])
    namespace = read.namespace(value["namespace"])
    directory = {"runs_dir": read.writable_directory("runs_dir", value["runs_dir"])}
    level = read.log_level(value["log_level"])
    clock = read.switch("use_sim_time", value["use_sim_time"])
    shown, view = (read.is_on(name, value[name]) for name in ("dashboard", "view"))
    if view and not shown:
        raise RuntimeError("view:=true needs the dashboard that dashboard:=false leaves out; give one of them")
    sweep = {**directory, **read.switch("once", value["once"])}
    if value["preset"]:
        sweep["preset"] = value["preset"]
    if value["settings"].split():  # an empty list has no type in a parameter file
        sweep["settings"] = value["settings"].split()
    if value["resume"]:
        if value["preset"] or value["settings"].split():
            raise RuntimeError(f"resume:={value['resume']}: a run has its settings; give no preset and no settings")
        resumed = read.run_directory("resume", value["resume"])
        sweep |= {"resume": resumed, "once": True}
        directory = {**directory, "run_dir": resumed}
    dashboard = {**directory, **read.switch("view", value["view"])}

    def node(executable: str, name: str, parameters: dict, **restart: object) -> Node:
        own = {**parameters, **clock}
        given = [{key: typed(one) for key, one in own.items()}] if own else []
        return Node(
            package="bow",
            executable=executable,
            name=name,
            namespace=namespace,
            parameters=[file, *given],
            ros_arguments=["--log-level", level],
            output="screen",
            emulate_tty=True,
            **restart,
        )

    # A run ends with its coordinator. Other nodes are restarted when they exit; their unfinished work is done again.
    again = {"respawn": True, "respawn_delay": 2.0}
    return [
        SetEnvironmentVariable(read.RANGE, discovery_range),  # the nodes choose their DDS profile by it
        node("recorder", "recorder", directory, **again),
        node("classifier", "classifier", {}, **again),
        *([node("dashboard", "dashboard", dashboard, **again)] if shown else []),
        *(node("simulator", f"simulator_{i}", {}, **again) for i in range(1, simulators + 1)),
        node("coordinator", "coordinator", sweep, on_exit=Shutdown(reason="the coordinator ended")),
    ]


def typed(given: object) -> ParameterValue:
    """Give a parameter its type: launch would read the directory 2024 as a number, and the preset `on` as a boolean."""
    return ParameterValue(given, value_type=List[str] if isinstance(given, list) else type(given))


def generate_launch_description() -> LaunchDescription:
    """Called by `ros2 launch`."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description, choices=choices and list(choices))
        for name, (default, description, choices) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=graph)])
