"""What the packages say of themselves agrees: versions, dependencies and executables, in every place that has them."""

from __future__ import annotations

import ast
import contextlib
import importlib
import os
import re
import subprocess
import sys
import zipfile
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from catkin_pkg.package import Package, parse_package
from checkout import ROOT, assigned, copy_sources

OUR_PACKAGES = ("bow", "bow_sim", "bow_classifier", "bow_sweep")
BY_NAME = {"h5netcdf", "h5py"}
"""Libraries that another one is told to load, by their names: xarray writes netCDF files with them."""

IMPORT_OF = {"inotify-simple": "inotify_simple", "pyyaml": "yaml", "rerun-sdk": "rerun"}
"""Import names that differ from the distribution's."""

ROS_PYTHON = {"rclpy", "bow_msgs", "builtin_interfaces", "std_msgs", "sensor_msgs", "diagnostic_msgs", "rcl_interfaces"}
ROS_PYTHON |= {"geometry_msgs"}
ROS_PYTHON |= {"action_msgs", "rosidl_parser", "rosidl_runtime_py", "rpyutils", "unique_identifier_msgs", "launch"}


@cache
def setup_arguments() -> dict[str, Any]:
    """The literal arguments of setup() in setup.py."""
    call = next(
        node.value
        for node in ast.parse((ROOT / "setup.py").read_text()).body
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call) and node.value.func.id == "setup"  # type: ignore[attr-defined]
    )
    arguments = {}
    for keyword in call.keywords:
        with contextlib.suppress(ValueError):  # not a literal
            arguments[str(keyword.arg)] = ast.literal_eval(keyword.value)
    return arguments


def manifest(folder: str) -> Package:
    warnings: list[str] = []
    package = parse_package(str(ROOT / folder / "package.xml"), warnings=warnings)
    package.validate(warnings=warnings)
    assert warnings == []
    return package


def quoted(path: str) -> list[str]:
    """The requirements among the lines of a file: bare in a requirements file, quoted in a pyproject.toml."""
    text = (ROOT / path).read_text()
    if path.endswith(".toml"):
        return re.findall(r'"([^"]+)"', text[text.index("requires = [") : text.index("]")])
    lines = [line.split("#")[0].strip() for line in text.splitlines()]
    return [line for line in lines if line and not line.startswith(".")]


def imported() -> set[str]:
    """Top-level modules that our packages import, their own and the standard library's left out."""
    found = set()
    for package in OUR_PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Import):
                    found |= {alias.name.split(".")[0] for alias in node.names}
                elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                    found.add(node.module.split(".")[0])
    return found - set(sys.stdlib_module_names) - set(OUR_PACKAGES)


@pytest.mark.parametrize("name", ["bow", "coordinator", "simulator", "classifier", "recorder", "dashboard"])
def test_an_executable_is_a_function_that_can_be_called(name: str) -> None:
    module, function = (assigned("COMMAND") | assigned("NODES"))[name].split(":")
    assert callable(getattr(importlib.import_module(module), function))


@pytest.mark.parametrize("name", ["coordinator", "simulator", "classifier", "recorder", "dashboard"])
def test_this_environment_has_the_node_where_ros2_run_looks_for_it(name: str) -> None:
    executable = Path(sys.prefix, "lib", "bow", name)
    assert os.access(executable, os.X_OK)
    told = subprocess.run([executable, "--help"], capture_output=True, text=True, timeout=60, check=True)
    assert f"ros2 run bow {name}" in told.stdout


def test_the_nodes_do_not_fill_the_path_with_common_words() -> None:
    scripts = {path.name for path in Path(sys.prefix, "bin").iterdir()}
    assert "bow" in scripts
    assert not scripts & set(assigned("NODES"))


def test_this_environment_is_a_ros_prefix_with_both_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    from ament_index_python.packages import get_package_share_directory

    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)
    share = Path(get_package_share_directory("bow"))
    installed, ours = ({path.name for path in (at / "launch").glob("*.launch.*")} for at in (share, ROOT))
    assert installed == ours
    assert (share / "config" / "presets" / "fig11d.yaml").is_file()
    assert (Path(get_package_share_directory("bow_msgs")) / "msg" / "Plan.msg").is_file()


def test_a_folder_named_bow_beside_a_script_does_not_hide_the_package(tmp_path: Path) -> None:
    (tmp_path / "bow").mkdir()  # a clone of this repository is one
    (tmp_path / "mine.py").write_text("import bow\nprint(bow.open.__name__)\n")
    told = subprocess.run([sys.executable, "mine.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert told.stdout == "open_any\n", told.stderr


@pytest.mark.parametrize("kind", ["msg", "action"])
def test_the_installed_interfaces_are_those_of_the_sources(kind: str) -> None:
    installed = Path(sys.prefix, "share", "bow_msgs", kind)
    sources = ROOT / "msg_defs" / kind
    for source in sources.iterdir():
        assert (installed / source.name).read_text() == source.read_text(), f"{source.name}: make setup"
    assert {path.name for path in installed.glob(f"*.{kind}")} == {path.name for path in sources.iterdir()}


def test_all_places_have_one_version_and_licence() -> None:
    bow, messages = manifest("."), manifest("msg_defs")
    assert setup_arguments()["version"] == bow.version == messages.version
    assert f'version = "{bow.version}"' in (ROOT / "msg_defs" / "pyproject.toml").read_text()
    assert [*bow.licenses, *messages.licenses, setup_arguments()["license"]] == ["Apache-2.0"] * 3
    assert "Apache License" in (ROOT / "LICENSE").read_text()


def test_what_the_code_imports_is_declared() -> None:
    depends = {depend.name for depend in manifest(".").exec_depends}
    assert imported() & ROS_PYTHON <= depends
    extras = [each for names in assigned("EXTRAS").values() for each in names]
    requirements = [*setup_arguments()["install_requires"], *extras]
    distributions = [re.split(r"[<>=]", requirement)[0] for requirement in requirements]
    declared = {IMPORT_OF.get(name, name) for name in distributions}
    assert imported() - ROS_PYTHON == declared - BY_NAME
    assert declared >= BY_NAME


def test_an_interface_names_the_packages_its_types_come_from() -> None:
    text = "".join(path.read_text() for path in (ROOT / "msg_defs").glob("*/*.*"))
    used = set(re.findall(r"^([a-z_]+)/[A-Z]", text, re.MULTILINE))
    assert used <= {depend.name for depend in manifest("msg_defs").exec_depends}


def test_the_ros_releases_are_the_same_wherever_they_are_named() -> None:
    releases: dict[str, set[str]] = {}
    places = ("requirements.txt", "requirements-dev.txt", "msg_defs/pyproject.toml", "constraints.txt")
    for requirement in (line for place in places for line in quoted(place)):
        name, _, release = requirement.partition("==")
        if name.startswith("ros-jazzy-"):
            releases.setdefault(name, set()).add(release)
    assert {name: found for name, found in releases.items() if len(found) > 1 or "" in found} == {}


def test_the_development_tools_include_what_builds_the_interfaces() -> None:
    built_with = {line for line in quoted("msg_defs/pyproject.toml") if not line.startswith("scikit-build-core")}
    run_time = {"numpy", "setuptools"}  # there by setup.py, and below release 80 for colcon
    assert built_with - run_time <= set(quoted("requirements-dev.txt"))


def test_every_direct_requirement_has_a_tested_release() -> None:
    tested = {re.split(r"==| ;", line)[0] for line in quoted("constraints.txt")}
    direct = [each for names in assigned("EXTRAS").values() for each in names]
    direct += [*setup_arguments()["install_requires"], *quoted("requirements.txt"), *quoted("requirements-dev.txt")]
    names = {re.split(r"[<>=]", requirement)[0].lower().replace("_", "-") for requirement in direct}
    assert names <= tested


def test_a_wheel_of_bow_is_a_whole_ros_package(tmp_path: Path) -> None:
    copy_sources(tmp_path / "bow")
    build = "from setuptools import build_meta; build_meta.build_wheel('..')"
    subprocess.run([sys.executable, "-c", build], cwd=tmp_path / "bow", check=True, capture_output=True, timeout=120)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = [re.sub(r"^bow-[^/]*\.data/data/", "", name) for name in archive.namelist()]
        modes = {name: info.external_attr >> 16 for name, info in zip(names, archive.infolist(), strict=True)}
    config = [path.relative_to(ROOT).as_posix() for path in (ROOT / "config").rglob("*") if path.is_file()]
    launch = [path.relative_to(ROOT).as_posix() for path in (ROOT / "launch").glob("*.py")]
    code = [path.relative_to(ROOT).as_posix() for package in OUR_PACKAGES for path in (ROOT / package).rglob("*.py")]
    wanted = ["share/ament_index/resource_index/packages/bow", "share/bow/package.xml", *code]
    wanted += [f"share/bow/{path}" for path in (*config, *launch)]
    wanted.append("bow_sweep/explore/page.js")
    assert set(wanted) <= set(names)
    for node in assigned("NODES"):
        assert modes[f"lib/bow/{node}"] & 0o111
