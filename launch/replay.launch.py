"""A recorded run through a new classifier and dashboard: `ros2 launch bow replay.launch.py run:=runs/RUN`.

Plays the bag's streams with `ros2 bag play` into a namespace of its own, where live graphs don't hear it. Watch it with
rerun, `ros2 topic echo /bow/replay/verdicts`, or anything else. To check a run, `bow replay RUN` needs no graph and is
faster; `bow replay RUN --graph` checks it through DDS, with flow control.
"""

import os
import re
from typing import List

import yaml
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, SetEnvironmentVariable, Shutdown
from launch.launch_description_entity import LaunchDescriptionEntity
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
RANGES = ("LOCALHOST", "SUBNET", "SYSTEM_DEFAULT")
PARAMETERS = os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "config", "nodes.yaml")

ARGUMENTS = {
    "run": (None, "run directory, with bag/ in it"),
    "rate": ("1.0", "speed of the replay; the classifier loses nothing, but lags behind if it is too fast"),
    "namespace": ("bow/replay", "where the streams, the classifier and the dashboard live"),
    "view": ("false", "true = open the live viewer"),
    "params_file": (PARAMETERS, "parameters of the nodes, YAML"),
    "discovery_range": (
        os.environ.get(RANGE) or "LOCALHOST",
        f"SUBNET = nodes on other machines hear it too; the default is what {RANGE} says",
    ),
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
        why = " ".join(str(error).split())
        raise RuntimeError(f"{bag} is not a complete rosbag2 directory ({why}); try `bow recover RUN`") from None
    found = [name[: -len("/bridge_force")] for name in names if name.endswith("/bridge_force")]
    if len(found) != 1:
        raise RuntimeError(f"{bag} should hold one topic bridge_force and holds {len(found)}: was it made by bow?")
    return found[0]


def graph(context: LaunchContext) -> List[LaunchDescriptionEntity]:
    """Turn the arguments into processes; what is wrong is said before any of them starts."""
    value = context.launch_configurations
    reach = discovery_range(value["discovery_range"])
    file = readable("params_file", value["params_file"])
    place = namespace(value["namespace"])
    run = os.path.abspath(os.path.expanduser(value["run"]))
    bag = os.path.join(run, "bag")
    old, new = recorded_namespace(bag), "/" + place.strip("/")
    # The pictures of the replay go beside the run, not into it: what a run directory holds was recorded.
    picture = {"runs_dir": os.path.join(os.path.dirname(run), "replays"), **switched_on("view", value["view"])}
    play = ["ros2", "bag", "play", bag, "--rate", speed(value["rate"]), "--delay", str(DISCOVERY_S)]
    play += ["--disable-keyboard-controls", "--topics", *(f"{old}/{name}" for name in PLAYED)]
    play += ["--remap", *(f"{old}/{name}:={new}/{name}" for name in PLAYED)]
    common = {"package": "bow", "namespace": new, "output": "screen", "emulate_tty": True}
    typed = {key: ParameterValue(given, value_type=type(given)) for key, given in picture.items()}
    return [
        SetEnvironmentVariable(RANGE, reach),
        Node(executable="classifier", name="classifier", parameters=[file], **common),
        Node(executable="dashboard", name="dashboard", parameters=[file, typed], **common),
        ExecuteProcess(cmd=play, output="screen", on_exit=Shutdown(reason="the bag is at its end")),
    ]


def speed(text: str) -> str:
    """Read a speed."""
    try:
        if 0 < float(text) < 1e6:
            return text
    except ValueError:
        pass
    raise RuntimeError(f"rate:={text}: a number above 0 is needed, 1.0 for the speed of the recording")


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


def switched_on(name: str, text: str) -> dict:
    """Read true or false; false leaves a parameter as the file has it."""
    if text.lower() not in ("true", "false"):
        raise RuntimeError(f"{name}:={text}: true or false is needed")
    return {name: True} if text.lower() == "true" else {}


def generate_launch_description() -> LaunchDescription:
    """Called by `ros2 launch`."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=graph)])
