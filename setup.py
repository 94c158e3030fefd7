"""The ROS package `bow`, for both routes: colcon in a ROS workspace, and pip or uv over the ROS wheels."""

import os
import sys
from pathlib import Path

from setuptools import find_packages, setup

COMMAND = {"bow": "bow_sweep.entry:command"}
NODES = {
    "coordinator": "bow_sweep.entry:coordinator",
    "simulator": "bow_sweep.entry:simulator",
    "classifier": "bow_sweep.entry:classifier",
    "recorder": "bow_sweep.entry:recorder",
    "dashboard": "bow_sweep.entry:dashboard",
}

EXTRAS = {
    "explore": ["bokeh>=3.9,<4"],  # `bow explore`
    "optimise": ["optuna>=4"],  # `bow optimise`
    "data": ["xarray>=2024.1", "h5netcdf>=1.3", "h5py>=3.8"],  # tables and netCDF files of `import bow`
}
"""Libraries that parts of bow need, by the name of the extra; `make setup` installs them."""

NO_MESSAGES = """
bow: its interfaces, the package bow_msgs, are not built: no folder of AMENT_PREFIX_PATH has them.
They lie in this repository under msg_defs/, where colcon does not look by itself. Build both with
    colcon build                                              (in the root of this repository)
    colcon build --base-paths src src/bow/msg_defs            (in a workspace with this repository in src/bow)
"""


def stop_without_messages() -> None:
    """Stop a colcon build that would succeed, and leave nodes that cannot import bow_msgs."""
    building = {"install", "develop"} & set(sys.argv) and not {"--help", "--uninstall"} & set(sys.argv)
    prefixes = filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
    marker = "share/ament_index/resource_index/packages/bow_msgs"
    if building and not any((Path(prefix) / marker).is_file() for prefix in prefixes):
        sys.exit(NO_MESSAGES)


def executables() -> tuple[dict[str, str], list[tuple[str, list[str]]]]:
    """The console scripts, and the data files that are executables.

    `ros2 run` looks for the nodes in <prefix>/lib/bow, people for `bow` on their PATH. setup.cfg sends console scripts
    to lib/bow for colcon, so bin/ gets a shim; pip and uv send them to bin/, so lib/bow gets shims (and bin/ is spared
    commands with names as common as `recorder`).
    """
    if "setuptools.build_meta" in sys.modules:  # pip and uv come through PEP 517
        return COMMAND, [("lib/bow", [f"resource/lib/{node}" for node in NODES])]
    return COMMAND | NODES, [("bin", ["resource/bin/bow"])]


def config_files() -> list[tuple[str, list[str]]]:
    """Every folder of config/ with its files."""
    folders = [Path("config"), *sorted(path for path in Path("config").rglob("*") if path.is_dir())]
    return [(str(folder), sorted(str(path) for path in folder.iterdir() if path.is_file())) for folder in folders]


def ros_wheels() -> list[str]:
    """ROS 2 from PyPI, as requirements.txt has it, for those who install wheels of bow and bow_msgs: bow[ros]."""
    here = Path(__file__).resolve().parent  # colcon links this file into a folder without the others
    lines = (here / "requirements.txt").read_text().splitlines()
    return [line.strip() for line in lines if line.startswith("ros-")]


def package_dir() -> dict[str, str]:
    """Where the packages are, said such that `pip install --editable` puts this folder on the path of Python.

    Unless it is said, setuptools installs a finder that Python asks last. A folder named bow where a script runs, as a
    clone of this repository beside it, would then be imported in place of the package.
    """
    return {"": "."} if "setuptools.build_meta" in sys.modules else {}


stop_without_messages()
console_scripts, shims = executables()
setup(
    name="bow",
    version="0.1.0",
    description="Basin maps of the bowed string, swept on a ROS 2 graph",
    license="Apache-2.0",
    python_requires=">=3.10",
    package_dir=package_dir(),
    packages=find_packages(include=["bow", "bow.*", "bow_sim*", "bow_classifier*", "bow_sweep*"]),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/bow"]),
        ("share/bow", ["package.xml"]),
        ("share/bow/launch", sorted(map(str, Path("launch").glob("*.launch.*")))),
        *((f"share/bow/{folder}", names) for folder, names in config_files()),
        *shims,
    ],
    # Lower bounds are what a ROS Jazzy installation on Ubuntu 24.04 has, or what the code needs; constraints.txt says
    # which releases were tested. ROS itself is in requirements.txt: on a ROS installation it doesn't come from PyPI.
    install_requires=[
        "numpy>=1.26",
        "gmpy2>=2.1",  # exp, pow, sin and cos with the same bits on every machine
        "inotify-simple>=2.0",
        "isal>=1.6",
        "matplotlib>=3.6",
        "numba>=0.68",
        "llvmlite>=0.50",  # numba's own; its version is written down with results
        "pyyaml>=6.0",
        "rich>=13.7",
        "scipy>=1.11",
        "setproctitle>=1.3",
        "xxhash>=3.4",
        "mcap>=1.2",
        "pyarrow>=18",  # rerun's own: names of codes are given to it as Arrow
        "rerun-sdk>=0.39,<0.42",  # 0.x: each release may change names; 0.39 is the last one for Python 3.10
    ],
    extras_require={**EXTRAS, "ros": ros_wheels()},
    package_data={"bow_sweep.explore": ["page.js"]},
    entry_points={"console_scripts": [f"{name} = {target}" for name, target in console_scripts.items()]},
    zip_safe=False,
)
