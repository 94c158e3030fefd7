"""The launch files in XML and YAML start what the Python file starts.

launch_xml and launch_yaml are not among the ROS wheels: the stand-ins read the tags that our files may use.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest
from checkout import ROOT
from launch_stand_ins import Node, described, launched, nodes, put_in_place


@pytest.fixture(autouse=True)
def stand_ins(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    put_in_place(monkeypatch)


def commands(entities: list[Any], scratch: Path) -> dict[str, tuple[list[str], dict[str, Any]]]:
    """What starts each node, and with which parameters: files are read, arguments come after them."""
    found = {}
    for name, node in nodes(entities).items():
        node.command(Path(sys.prefix), scratch)  # as launch does; it fails where a parameter has no form in YAML
        found[name] = ([node.package, node.executable, node.namespace.strip("/"), *node.ros_arguments], node.given)
    return found


def test_the_example_in_xml_is_the_graph_of_the_python_file(tmp_path: Path) -> None:
    given: dict[str, object] = {"preset": "fig11d", "log_level": "debug", "use_sim_time": "true", "runs_dir": "runs"}
    ours = commands(launched("sweep.launch.py", simulators=2, **given), tmp_path)
    example = commands(described("sweep.launch.xml", **given), tmp_path)
    assert set(example) == set(ours)
    for name, (started, parameters) in example.items():
        assert started == ours[name][0]
        absolute = parameters | ({"runs_dir": str(tmp_path / "runs")} if "runs_dir" in parameters else {})
        assert absolute == ours[name][1], name
    assert set(nodes(described("sweep.launch.xml", dashboard="false"))) == set(ours) - {"dashboard"}
    for name, node in nodes(described("sweep.launch.xml")).items():
        assert node.files == [str(ROOT / "config" / "nodes.yaml")]
        assert node.respawn == (name != "coordinator")
    with pytest.raises(RuntimeError, match="Valid options are"):
        described("sweep.launch.xml", log_level="loud")


def test_the_example_in_yaml_passes_its_arguments_to_the_python_file() -> None:
    graph: dict[str, Node] = nodes(described("sweep.launch.yaml", preset="fig11c"))
    assert "dashboard" not in graph
    assert graph["coordinator"].given["preset"] == "fig11c"
    assert graph["coordinator"].given["settings"] == ["x.count=32", "y.count=16"]
    assert graph["coordinator"].given["once"] is True
    assert {tuple(node.ros_arguments) for node in graph.values()} == {("--log-level", "warn")}
