"""Stand-ins for Jazzy's launch, launch_ros, launch_xml and launch_yaml, which are not among the ROS wheels.

They know only the names and arguments that our files may use, and refuse all others.
"""

from __future__ import annotations

import re
import runpy
import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree

import pytest
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
    choices: list[str] | None = None

    def __post_init__(self) -> None:
        assert isinstance(self.default_value, str | None), "a default is a text"
        assert self.choices is None or self.choices, "no choice at all"
        if self.choices and self.default_value is not None:
            assert self.default_value in self.choices

    def check(self, value: str) -> None:
        """Refuse what is not among the choices, in launch's words."""
        if self.choices is not None and value not in self.choices:
            raise RuntimeError(
                f'Argument "{self.name}" provided value "{value}" is not valid. Valid options are: {self.choices}'
            )


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
    ros_arguments: list[str] = field(default_factory=list)
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
        first = ["--ros-args", *self.ros_arguments] if self.ros_arguments else []
        return [str(executable), *first, "--ros-args", *renamed, *words]


STAND_INS = {
    "launch": (LaunchContext, LaunchDescription),
    "launch.actions": (DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, SetEnvironmentVariable, Shutdown),
    "launch.launch_description_entity": (type("LaunchDescriptionEntity", (), {}),),
    "launch_ros": (),
    "launch_ros.actions": (Node,),
    "launch_ros.parameter_descriptions": (ParameterValue,),
}


def put_in_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the stand-ins what a launch file imports."""
    for name, classes in STAND_INS.items():
        module = ModuleType(name)
        for one in classes:
            setattr(module, one.__name__, one)
        monkeypatch.setitem(sys.modules, name, module)


def launched(file: str, **given: object) -> list[Any]:
    """What `ros2 launch bow FILE name:=value ...` would start."""
    (*declared, last) = runpy.run_path(str(ROOT / "launch" / file))["generate_launch_description"]().entities
    values = {argument.name: argument.default_value for argument in declared}
    assert set(given) <= set(values), "an argument that is not declared"
    assert all(argument.description for argument in declared)
    values |= {name: str(value) for name, value in given.items()}
    assert None not in values.values(), "an argument without default was not given"
    for argument in declared:
        argument.check(values[argument.name])
    return list(last.function(LaunchContext(values)))


def nodes(entities: list[Any]) -> dict[str, Node]:
    return {entity.name: entity for entity in entities if isinstance(entity, Node)}


# ---- launch files in XML and YAML: the tags and attributes that our files may use, and no others

ATTRIBUTES = {
    "arg": {"name", "default", "description"},
    "choice": {"value"},
    "set_env": {"name", "value"},
    "node": {"pkg", "exec", "name", "namespace", "output", "ros_args", "respawn", "respawn_delay", "if"},
    "param": {"name", "value", "type", "from"},
    "include": {"file"},
}
CHILDREN = {"launch": {"arg", "set_env", "node", "include"}, "arg": {"choice"}, "node": {"param"}, "include": {"arg"}}


@dataclass
class Tag:
    """An element of a launch file, from XML or YAML."""

    name: str
    attributes: dict[str, str]
    children: list[Tag]

    def __post_init__(self) -> None:
        inside_include = {"value"} if self.name == "arg" else set()
        assert set(self.attributes) <= ATTRIBUTES.get(self.name, set()) | inside_include, self
        assert {child.name for child in self.children} <= CHILDREN.get(self.name, set()), self

    def all(self, name: str) -> list[Tag]:
        return [child for child in self.children if child.name == name]


def read_xml(element: ElementTree.Element) -> Tag:
    assert not (element.text or "").strip(), "text between tags means nothing"
    return Tag(element.tag, dict(element.attrib), [read_xml(child) for child in element])


def read_yaml(name: str, content: Any) -> Tag:
    if isinstance(content, list):  # the file itself: each entry has its tag's name
        return Tag(name, {}, [read_yaml(*next(iter(entry.items()))) for entry in content])
    attributes = {key: value for key, value in content.items() if not isinstance(value, list)}
    assert all(isinstance(value, str) for value in attributes.values()), "launch wants texts"
    nested = [(key, value) for key, values in content.items() if isinstance(values, list) for value in values]
    return Tag(name, attributes, [read_yaml(key, value) for key, value in nested])


def described(file: str, **given: object) -> list[Any]:
    """What `ros2 launch bow FILE name:=value ...` would start, for a file in XML or YAML."""
    path = ROOT / "launch" / file
    if path.suffix == ".xml":
        root = read_xml(ElementTree.parse(path).getroot())
    else:
        ((name, content),) = yaml.safe_load(path.read_text()).items()
        root = read_yaml(name, content)
    assert root.name == "launch"
    values: dict[str, str] = {"find-pkg-share bow": str(ROOT)}

    def filled(text: str) -> str:
        return re.sub(r"\$\(([^)]*)\)", lambda found: values[found[1]], text)

    out: list[Any] = []
    assert set(given) <= {tag.attributes["name"] for tag in root.all("arg")}, "an argument that is not declared"
    for tag in root.children:
        own = tag.attributes
        if tag.name == "arg":
            choices = [choice.attributes["value"] for choice in tag.all("choice")]
            default = filled(own["default"])
            argument = DeclareLaunchArgument(own["name"], default, own["description"], choices or None)
            values[f"var {own['name']}"] = str(given.get(own["name"], default))
            argument.check(values[f"var {own['name']}"])
        elif tag.name == "set_env":
            out.append(SetEnvironmentVariable(own["name"], filled(own["value"])))
        elif tag.name == "include":
            passed = {arg.attributes["name"]: filled(arg.attributes["value"]) for arg in tag.all("arg")}
            out += launched(Path(filled(own["file"])).name, **passed)
        elif filled(own.get("if", "true")) == "true":
            out.append(_node_of(tag, filled))
    return out


def _node_of(tag: Tag, filled: Any) -> Node:
    own, parameters = tag.attributes, list[Any]()
    for param in tag.all("param"):
        if "from" in param.attributes:
            parameters.append(filled(param.attributes["from"]))
            continue
        text = filled(param.attributes["value"])
        value = text if param.attributes.get("type") == "str" else yaml.safe_load(text)
        parameters.append({param.attributes["name"]: ParameterValue(value, value_type=type(value))})
    return Node(
        package=own["pkg"],
        executable=own["exec"],
        name=own["name"],
        namespace=filled(own["namespace"]),
        parameters=parameters,
        ros_arguments=filled(own.get("ros_args", "")).split(),
        output=own.get("output", "log"),
        respawn=own.get("respawn", "false") == "true",
        respawn_delay=float(own["respawn_delay"]) if "respawn_delay" in own else None,
    )
