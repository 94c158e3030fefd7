"""Stand-ins for Jazzy's launch and launch_ros, which are not among the ROS wheels.

They know only the names and arguments that our files may use, and refuse all others.
"""

from __future__ import annotations

import runpy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from checkout import ROOT


@dataclass
class LaunchDescription:
    entities: list[Any]


@dataclass
class LaunchContext:
    launch_configurations: dict[str, str]


@dataclass
class DeclareLaunchArgument:
    name: str
    default_value: str | None = None
    description: str | None = None

    def __post_init__(self) -> None:
        assert isinstance(self.default_value, str | None), "a default is a text"


@dataclass(kw_only=True)
class OpaqueFunction:
    function: Any


@dataclass
class SetEnvironmentVariable:
    name: str
    value: str


@dataclass(kw_only=True)
class Shutdown:
    reason: str


@dataclass
class ParameterValue:
    value: Any
    value_type: Any = field(kw_only=True)


@dataclass(kw_only=True)
class ExecuteProcess:
    cmd: list[str]
    output: str = "log"
    on_exit: Shutdown | None = None


@dataclass(kw_only=True)
class Node:
    package: str
    executable: str
    name: str
    namespace: str
    parameters: list[dict[str, ParameterValue] | str] = field(default_factory=list)
    output: str = "log"
    emulate_tty: bool = False
    respawn: bool = False
    respawn_delay: float | None = None
    on_exit: Shutdown | None = None

    @property
    def given(self) -> dict[str, Any]:
        given = [one for one in self.parameters if isinstance(one, dict)]
        return {name: parameter.value for one in given for name, parameter in one.items()}

    @property
    def files(self) -> list[str]:
        return [one for one in self.parameters if isinstance(one, str)]

    def command(self, prefix: Path, scratch: Path) -> list[str]:
        """The command line that launch_ros makes of it: each of `parameters` is a file, in their order."""
        words = []
        for number, one in enumerate(self.parameters):
            file = Path(one) if isinstance(one, str) else scratch / f"{self.name}_{number}.yaml"
            if isinstance(one, dict):
                file.write_text(yaml.dump({"/**": {"ros__parameters": {name: p.value for name, p in one.items()}}}))
            words += ["--params-file", str(file)]
        renamed = ["-r", f"__node:={self.name}", "-r", f"__ns:=/{self.namespace.strip('/')}"]
        executable = prefix / "lib" / self.package / self.executable
        return [str(executable), "--ros-args", *renamed, *words]


STAND_INS = {
    "launch": (LaunchContext, LaunchDescription),
    "launch.actions": (DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, SetEnvironmentVariable, Shutdown),
    "launch.launch_description_entity": (type("LaunchDescriptionEntity", (), {}),),
    "launch_ros": (),
    "launch_ros.actions": (Node,),
    "launch_ros.parameter_descriptions": (ParameterValue,),
}


def launched(file: str, **given: object) -> list[Any]:
    """What `ros2 launch bow FILE name:=value ...` would start."""
    (*declared, last) = runpy.run_path(str(ROOT / "launch" / file))["generate_launch_description"]().entities
    values = {argument.name: argument.default_value for argument in declared}
    assert set(given) <= set(values), "an argument that is not declared"
    assert all(argument.description for argument in declared)
    values |= {name: str(value) for name, value in given.items()}
    assert None not in values.values(), "an argument without default was not given"
    return list(last.function(LaunchContext(values)))


def nodes(entities: list[Any]) -> dict[str, Node]:
    return {entity.name: entity for entity in entities if isinstance(entity, Node)}
