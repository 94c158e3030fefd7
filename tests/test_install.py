"""The workspace route: colcon builds both packages from these sources, and says what is wrong where it cannot."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from checkout import assigned, copy_sources

pytestmark = pytest.mark.timeout(900)  # compiling the interfaces takes a minute, several on a busy machine

COLCON = Path(sys.prefix, "bin", "colcon")
OVER_THE_WHEELS = ("--cmake-args", "-DCMAKE_PROJECT_bow_msgs_INCLUDE=cmake/ros_wheels.cmake")
EXECUTABLES = {"bow", "coordinator", "simulator", "classifier", "recorder", "dashboard"}


def shell(*, ros: bool) -> dict[str, str]:
    """The environment of a user with ROS sourced (here: the wheels), or without any ROS."""
    home = {"HOME": os.environ.get("HOME", "/"), "PATH": f"{sys.prefix}/bin:/usr/bin:/bin", "LANG": "C.UTF-8"}
    return home | {name: sys.prefix for name in ("VIRTUAL_ENV", "AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH") if ros}


def colcon(place: Path, *arguments: str, ros: bool = True) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [COLCON, *arguments], cwd=place, env=shell(ros=ros), capture_output=True, text=True, timeout=800, check=False
    )


def sourced(place: Path, command: str) -> str:
    """What a command prints in a shell that has sourced install/setup.bash, from another folder."""
    if " " in sys.executable:
        pytest.skip(f"colcon's own setup.bash cannot call a Python whose path has a space, {sys.executable}")
    script = f"source '{place}/install/setup.bash' && cd / && {command}"
    told = subprocess.run(
        ["bash", "-c", script], env=shell(ros=False), capture_output=True, text=True, timeout=120, check=False
    )
    assert told.returncode == 0, told.stdout + told.stderr
    return told.stdout


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the sources, in which colcon leaves build/, install/ and log/."""
    place = tmp_path_factory.mktemp("colcon") / "bow"
    copy_sources(place)
    return place


@pytest.fixture(scope="module")
def built(checkout: Path) -> Path:
    """The copy after a plain `colcon build` in its root."""
    result = colcon(checkout, "build", *OVER_THE_WHEELS)
    assert result.returncode == 0, result.stdout + result.stderr
    return checkout


def test_colcon_in_the_root_sees_both_packages(checkout: Path) -> None:
    lines = colcon(checkout, "list").stdout.splitlines()
    assert {tuple(line.split()) for line in lines} == {
        ("bow", ".", "(ros.ament_python)"),
        ("bow_msgs", "msg_defs", "(ros.ament_cmake)"),
    }


def test_a_workspace_without_the_interfaces_is_told_what_to_type(tmp_path: Path) -> None:
    copy_sources(tmp_path / "src" / "bow")
    result = colcon(tmp_path, "build", ros=False)
    assert result.returncode != 0
    assert "colcon build --base-paths src src/bow/msg_defs" in result.stderr
    assert not list((tmp_path / "install").glob("bow/lib/bow/*"))


@pytest.mark.full
def test_colcon_puts_the_executables_where_ros2_run_looks(built: Path) -> None:
    executables = {path.name for path in (built / "install/bow/lib/bow").iterdir() if os.access(path, os.X_OK)}
    assert executables == EXECUTABLES


@pytest.mark.full
def test_an_executable_runs_with_the_python_of_whoever_runs_it(built: Path) -> None:
    with open(built / "install/bow/lib/bow/simulator") as script:
        assert script.readline() == "#!/usr/bin/env python3\n"


@pytest.mark.full
def test_colcon_enters_both_packages_in_the_ament_index(built: Path) -> None:
    for package in ("bow", "bow_msgs"):
        assert (built / f"install/{package}/share/ament_index/resource_index/packages/{package}").is_file()
        assert (built / f"install/{package}/share/{package}/package.xml").is_file()


@pytest.mark.full
def test_colcon_installs_every_launch_file_and_every_configuration(built: Path) -> None:
    for folder in ("launch", "config"):
        sources = {path.relative_to(built) for path in (built / folder).rglob("*") if path.is_file()}
        share = built / "install/bow/share/bow"
        assert {path.relative_to(share) for path in (share / folder).rglob("*") if path.is_file()} == sources


@pytest.mark.full
@pytest.mark.parametrize("node", sorted(EXECUTABLES - {"bow"}))
def test_a_node_of_the_workspace_starts(built: Path, node: str) -> None:
    assert f"ros2 run bow {node}" in sourced(built, f"'{built}/install/bow/lib/bow/{node}' --help")


@pytest.mark.full
def test_a_sourced_workspace_has_the_command_and_the_interfaces(built: Path) -> None:
    assert sourced(built, "command -v bow").strip() == str(built / "install/bow/bin/bow")
    assert "sweep" in sourced(built, "bow --help")
    where = "import bow_msgs.msg, bow_sim; print(bow_msgs.__file__, bow_sim.__file__, bow_msgs.msg.Plan().state)"
    messages, code, state = sourced(built, f'python -c "{where}"').split()
    assert Path(messages).is_relative_to(built / "install/bow_msgs")
    assert Path(code).is_relative_to(built / "install/bow")
    assert state == "0"


@pytest.mark.full
def test_a_workspace_can_link_to_the_sources(built: Path, tmp_path: Path) -> None:
    bases = ("--build-base", f"{tmp_path}/build", "--install-base", f"{tmp_path}/install")
    ros = {"AMENT_PREFIX_PATH": f"{built}/install/bow_msgs:{sys.prefix}"}
    select = ("--base-paths", ".", "--packages-select", "bow")
    result = subprocess.run(
        [COLCON, "build", "--symlink-install", *select, *bases],
        cwd=built,
        env=shell(ros=True) | ros,
        capture_output=True,
        text=True,
        timeout=800,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert {path.name for path in (tmp_path / "install/bow/lib/bow").iterdir()} == EXECUTABLES
    assert (tmp_path / "install/bow/share/bow/package.xml").resolve() == built / "package.xml"


def test_the_executables_are_the_nodes_and_the_command() -> None:
    assert set(assigned("NODES")) | set(assigned("COMMAND")) == EXECUTABLES
