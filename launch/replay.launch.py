"""A recorded run through a new classifier and dashboard: `ros2 launch bow replay.launch.py run:=runs/RUN`.

Plays the bag's streams with `ros2 bag play` into a namespace of its own, where live graphs don't hear it. Watch it with
rerun, `ros2 topic echo /bow/replay/verdicts`, or anything else. To check a run, `bow replay RUN` needs no graph and is
faster; `bow replay RUN --graph` checks it through DDS, with flow control.
"""

import os
from typing import List

import yaml
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, SetEnvironmentVariable, Shutdown
from launch.launch_description_entity import LaunchDescriptionEntity
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "run": (None, "run directory, with bag/ in it"),
    "rate": ("1.0", "speed of the replay; the classifier loses nothing, but lags behind if it is too fast"),
    "namespace": ("bow/replay", "where the streams, the classifier and the dashboard live"),
    "view": ("false", "true = open the live viewer"),
    "discovery_range": ("LOCALHOST", "SUBNET = nodes on other machines hear it too"),
}

# What the classifier and the dashboard take in; the old verdicts, receipts and health messages stay in the bag.
PLAYED = ("plan", "bridge_force", "stick_slip", "basin_map", "inspect")

DISCOVERY_S = 3.0  # the first messages must not be gone before the classifier and the dashboard listen


def recorded_namespace(bag: str) -> str:
    """The namespace the bag was recorded in, from its list of topics."""
    try:
        with open(os.path.join(bag, "metadata.yaml"), encoding="utf-8") as file:
            topics = yaml.safe_load(file)["rosbag2_bagfile_information"]["topics_with_message_count"]
        names = [topic["topic_metadata"]["name"] for topic in topics]
    except (OSError, KeyError, TypeError, yaml.YAMLError) as error:
        raise RuntimeError(f"{bag} is not a complete rosbag2 directory ({error}); try `bow recover RUN`") from None
    found = [name[: -len("/bridge_force")] for name in names if name.endswith("/bridge_force")]
    if len(found) != 1:
        raise RuntimeError(f"{bag} should hold one topic bridge_force and holds {len(found)}: was it made by bow?")
    return found[0]


def graph(context: LaunchContext) -> List[LaunchDescriptionEntity]:
    """Turn the arguments into processes."""
    value = context.launch_configurations
    run = os.path.abspath(os.path.expanduser(value["run"]))
    bag = os.path.join(run, "bag")
    old, new = recorded_namespace(bag), "/" + value["namespace"].strip("/")
    if value["view"].lower() not in ("true", "false"):
        raise RuntimeError(f"view:={value['view']}: true or false is needed")
    # The pictures of the replay go beside the run, not into it: what a run directory holds was recorded.
    picture = {"runs_dir": os.path.join(os.path.dirname(run), "replays"), "view": value["view"].lower() == "true"}
    play = ["ros2", "bag", "play", bag, "--rate", value["rate"], "--delay", str(DISCOVERY_S)]
    play += ["--disable-keyboard-controls", "--topics", *(f"{old}/{name}" for name in PLAYED)]
    play += ["--remap", *(f"{old}/{name}:={new}/{name}" for name in PLAYED)]
    common = {"package": "bow", "namespace": new, "output": "screen", "emulate_tty": True}
    typed = {key: ParameterValue(given, value_type=type(given)) for key, given in picture.items()}
    return [
        SetEnvironmentVariable("ROS_AUTOMATIC_DISCOVERY_RANGE", value["discovery_range"]),
        Node(executable="classifier", name="classifier", **common),
        Node(executable="dashboard", name="dashboard", parameters=[typed], **common),
        ExecuteProcess(cmd=play, output="screen", on_exit=Shutdown(reason="the bag is at its end")),
    ]


def generate_launch_description() -> LaunchDescription:
    """Called by `ros2 launch`."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=graph)])
