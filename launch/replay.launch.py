"""A recorded run through a new classifier and dashboard: `ros2 launch bow replay.launch.py run:=runs/RUN`.

Plays the bag's streams with `ros2 bag play` into a namespace of their own, in which no live graph receives them. Watch
with rerun, `ros2 topic echo /bow/replay/verdicts`, or any other tool. To check a run, `bow replay RUN` needs no graph
and is faster; `bow replay RUN --graph` checks it through DDS, with flow control.
"""

import os
from typing import List

import yaml
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, SetEnvironmentVariable, Shutdown
from launch.launch_description_entity import LaunchDescriptionEntity
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from bow_sweep.processes import launch_arguments as read

PARAMETERS = os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "config", "nodes.yaml")

ARGUMENTS = {
    "run": (None, "run directory, with bag/ in it", None),
    "rate": ("1.0", "speed of the replay; the classifier loses nothing, but lags behind if it is too fast", None),
    "namespace": ("bow/replay", "where the streams, the classifier and the dashboard live", None),
    "dashboard": ("true", "false = no dashboard: the verdicts alone", read.SWITCH),
    "view": ("false", "true = open the live viewer", read.SWITCH),
    "params_file": (PARAMETERS, "parameters of the nodes, YAML; an argument given here has priority over it", None),
    "log_level": ("info", "what the nodes log", read.LEVELS),
    "use_sim_time": (
        "false",
        "true = the clocks of the nodes follow /clock, which the replay then publishes",
        read.SWITCH,
    ),
    "discovery_range": (
        os.environ.get(read.RANGE) or read.DEFAULT_RANGE,
        f"SUBNET = nodes on other machines hear it too; the default is what {read.RANGE} says",
        None,
    ),
}

# What the classifier and the dashboard subscribe to; old verdicts, receipts and health messages are not played.
PLAYED = ("plan", "bridge_force", "stick_slip", "basin_map", "inspect")

# Delay before the first message, so that the classifier and the dashboard are connected by then.
DISCOVERY_S = 3.0


def recorded_namespace(bag: str) -> str:
    """Return the namespace in which a bag was recorded, from its list of topics."""
    try:
        with open(os.path.join(bag, "metadata.yaml"), encoding="utf-8") as file:
            information = yaml.safe_load(file)["rosbag2_bagfile_information"]
        names = [topic["topic_metadata"]["name"] for topic in information["topics_with_message_count"]]
        formats = (information.get("custom_data") or {}).get("bow.version")
    except (OSError, KeyError, TypeError, yaml.YAMLError) as error:
        why = " ".join(str(error).split())
        raise RuntimeError(f"{bag} is not a complete rosbag2 directory ({why}); try `bow recover RUN`") from None
    if not formats or len({name for name in names if name.endswith("/plan")}) > 1:
        raise RuntimeError(f"{bag} holds messages of a bow before format 3; `bow replay RUN --graph` can play them")
    found = [name[: -len("/bridge_force")] for name in names if name.endswith("/bridge_force")]
    if len(found) != 1:
        raise RuntimeError(f"{bag} should hold one topic bridge_force and holds {len(found)}: was it made by bow?")
    return found[0]


def graph(context: LaunchContext) -> List[LaunchDescriptionEntity]:
    """Turn the arguments into processes; a wrong argument raises before any of them starts."""
    value = context.launch_configurations
    discovery_range = read.discovery_range(value["discovery_range"])
    file = read.readable_file("params_file", value["params_file"])
    new = "/" + read.namespace(value["namespace"]).strip("/")
    run = os.path.abspath(os.path.expanduser(value["run"]))
    bag = os.path.join(run, "bag")
    old = recorded_namespace(bag)
    # The pictures of the replay go beside the run directory, not into it: its files are those of the recorded run.
    dashboard = {"runs_dir": os.path.join(os.path.dirname(run), "replays"), **read.switch("view", value["view"])}
    play = ["ros2", "bag", "play", bag, "--rate", read.rate(value["rate"]), "--delay", str(DISCOVERY_S)]
    play += ["--disable-keyboard-controls", "--topics", *(f"{old}/{name}" for name in PLAYED)]
    play += ["--remap", *(f"{old}/{name}:={new}/{name}" for name in PLAYED)]
    clock = read.switch("use_sim_time", value["use_sim_time"])
    play += ["--clock"] if clock else []
    shown = read.is_on("dashboard", value["dashboard"])
    if dashboard.get("view") and not shown:
        raise RuntimeError("view:=true needs the dashboard that dashboard:=false leaves out; give one of them")
    common = {"package": "bow", "namespace": new, "output": "screen", "emulate_tty": True}
    common["ros_arguments"] = ["--log-level", read.log_level(value["log_level"])]

    def typed(parameters: dict) -> list:
        given = {key: ParameterValue(one, value_type=type(one)) for key, one in {**parameters, **clock}.items()}
        return [file, given] if given else [file]

    return [
        SetEnvironmentVariable(read.RANGE, discovery_range),
        Node(executable="classifier", name="classifier", parameters=typed({}), **common),
        *([Node(executable="dashboard", name="dashboard", parameters=typed(dashboard), **common)] if shown else []),
        ExecuteProcess(cmd=play, output="screen", on_exit=Shutdown(reason="the bag is at its end")),
    ]


def generate_launch_description() -> LaunchDescription:
    """Called by `ros2 launch`."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description, choices=choices and list(choices))
        for name, (default, description, choices) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=graph)])
