"""The files for Foxglove, RViz and PlotJuggler show topics and fields that a graph publishes and a bag has."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from bow_sim.protocol.messages import FIELDS
from bow_sweep.coordinator.cell_chooser import CLICKS
from bow_sweep.coordinator.choice import FRAME
from bow_sweep.coordinator.standard_messages import POINT
from bow_sweep.record.topics import TOPICS, full_names

CONFIG = Path(__file__).parents[1] / "config"
RECORDED = {full_names()[name]: topic.type for name, topic in TOPICS.items()}
LIVE = {"/bow/basin_map/points": "sensor_msgs/msg/PointCloud2"}
"""What is published while somebody looks, and not recorded."""
IMAGE = "sensor_msgs/msg/Image"


def panels() -> dict[str, dict]:
    return dict(json.loads((CONFIG / "foxglove.json").read_text())["configById"])


def of_kind(kind: str) -> list[dict]:
    return [config for name, config in panels().items() if name.startswith(f"{kind}!")]


def rviz() -> dict:
    return dict(yaml.safe_load((CONFIG / "bow.rviz").read_text())["Visualization Manager"])


def plotjuggler() -> ElementTree.Element:
    return ElementTree.parse(CONFIG / "plotjuggler.xml").getroot()


def is_field(topic: str, field: str, array: bool) -> bool:
    """Whether a recorded topic has a field, which is an array or a single value."""
    kind = FIELDS[RECORDED[topic].rpartition("/")[2]].get(field)
    return kind is not None and kind.endswith("[]") == array


def test_the_layout_of_foxglove_places_every_panel_once() -> None:
    def leaves(node: object) -> list[str]:
        if isinstance(node, dict):
            assert node["direction"] in ("row", "column")
            return leaves(node["first"]) + leaves(node["second"])
        return [str(node)]

    assert sorted(leaves(json.loads((CONFIG / "foxglove.json").read_text())["layout"])) == sorted(panels())


def test_foxglove_shows_map_and_regimes_of_any_bag_and_the_plane_of_a_graph() -> None:
    shown = [panel["imageMode"]["imageTopic"] for panel in of_kind("Image")]
    assert sorted(shown) == sorted(topic for topic, kind in RECORDED.items() if kind == IMAGE)
    (plane,) = of_kind("3D")
    ((topic, settings),) = plane["topics"].items()
    assert topic in LIVE
    assert settings["colorField"] in POINT.names
    assert plane["followTf"] == FRAME
    assert plane["publish"]["pointTopic"] in CLICKS


def test_foxglove_plots_fields_that_there_are() -> None:
    paths = [path["value"] for panel in of_kind("Plot") for path in panel["paths"]]
    paths += [panel["xAxisPath"]["value"] for panel in of_kind("Plot") if "xAxisPath" in panel]
    paths += [panel["topicPath"] for panel in of_kind("RawMessages")]
    assert "/bow/inspect.bridge_force[:]" in paths
    for path in paths:
        match = re.fullmatch(r"(/[\w/]+)\.(\w+)(\[:\])?", path)
        assert match, path
        assert is_field(match[1], match[2], array=bool(match[3])), path


def test_rviz_shows_map_and_regimes_and_takes_clicks_on_the_plane() -> None:
    displays = {display["Topic"]["Value"]: display for display in rviz()["Displays"]}
    assert displays.keys() == {topic for topic, kind in RECORDED.items() if kind == IMAGE} | LIVE.keys()
    for topic, display in displays.items():
        kind = {**RECORDED, **LIVE}[topic].rpartition("/")[2]
        assert display["Class"] == f"rviz_default_plugins/{kind}"
        assert display["Topic"]["Durability Policy"] == "Transient Local"  # late displays too
        assert display["Enabled"]
        assert display["Value"]
    assert displays["/bow/basin_map/points"]["Channel Name"] in POINT.names
    assert rviz()["Global Options"]["Fixed Frame"] == FRAME
    (click,) = [tool for tool in rviz()["Tools"] if tool["Class"].endswith("/PublishPoint")]
    assert click["Topic"]["Value"] in CLICKS


def test_plotjuggler_reads_only_what_it_can_parse_and_has_every_sample() -> None:
    loaders = plotjuggler().findall(".//*[@selected_topics]") + plotjuggler().findall(".//selected_topics")
    chosen = {topic for e in loaders for topic in (e.get("selected_topics") or e.get("value") or "").split(";")}
    assert chosen == {"/bow/inspect"}
    kinds = FIELDS[RECORDED["/bow/inspect"].rpartition("/")[2]].values()
    assert not [kind for kind in kinds if "<=" in kind]  # PlotJuggler's issue 881
    sizes = [int(element.get("max_array_size", 0)) for element in loaders if element.get("max_array_size")]
    sizes += [int(element.get("value", 0)) for element in plotjuggler().findall(".//max_array_size")]
    assert len(sizes) == 3
    assert min(sizes) >= 5 * 4096  # a chunk of the longest period
    single = [curve.get("name", "") for curve in plotjuggler().findall(".//plot[@mode='TimeSeries']/curve")]
    assert single
    for name in single:
        topic, _, field = name.rpartition("/")
        assert is_field(topic, field, array=False), name


def test_the_script_of_plotjuggler_makes_the_curve_that_is_plotted() -> None:
    script = plotjuggler().find(".//script")
    assert script is not None
    (curve,) = plotjuggler().findall(".//plot[@mode='XYPlot']/curve")
    assert f'ScatterXY.new("{curve.get("name")}")' in script.get("global", "")
    read = re.findall(r'string\.format\("(.*)/(\w+)\[%d\]", i\)', script.get("function", ""))
    assert read == [("/bow/inspect", "periods"), ("/bow/inspect", "bridge_force")]
    assert all(is_field(topic, field, array=True) for topic, field in read)


@pytest.mark.parametrize("name", ["foxglove.json", "bow.rviz", "plotjuggler.xml"])
def test_no_file_names_a_run(name: str) -> None:
    assert not re.search(r"[0-9a-f]{16}", (CONFIG / name).read_text())
