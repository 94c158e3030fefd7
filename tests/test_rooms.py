"""The rooms of the house: what is pure stays pure, imports point one way, files fit in a head."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
ROOMS = ("bow_sim", "bow_classifier", "bow_sweep")
FRAMEWORKS = {"rclpy", "mcap", "rerun", "bow_msgs"}

IMPURE = {
    "bow_sim.node": {"rclpy", "bow_msgs"},
    "bow_sim.graph.node_base": {"rclpy", "bow_msgs"},
    "bow_classifier.node": {"rclpy", "bow_msgs"},
    "bow_sweep.coordinator.messages": {"rclpy", "bow_msgs"},
    "bow_sweep.coordinator.node": {"rclpy", "bow_msgs", "mcap"},
    "bow_sweep.record.bag": {"mcap"},
    "bow_sweep.record.index_contents": {"mcap"},
    "bow_sweep.record.inspection": {"mcap"},
    "bow_sweep.record.mcap_writer": {"mcap"},
    "bow_sweep.record.metadata": {"mcap"},
    "bow_sweep.record.notes": {"mcap"},
    "bow_sweep.record.mcap_records": {"mcap"},
    "bow_sweep.record.node": {"rclpy", "bow_msgs", "mcap"},
    "bow_sweep.record.recover": {"mcap"},
    "bow_sweep.record.replay": {"mcap"},
    "bow_sweep.processes.replay_graph": {"rclpy", "bow_msgs", "mcap"},
    "bow_sweep.record.mcap_reader": {"mcap"},
    "bow_sweep.record.session": {"mcap"},
    "bow_sweep.record.bag_contents": {"mcap"},
    "bow_sweep.record.verify": {"mcap"},
    "bow_sweep.coordinator.resume": {"mcap"},
    "bow_sweep.processes.supervisor_node": {"rclpy", "bow_msgs"},
    "bow_sweep.view.blueprint": {"rerun"},
    "bow_sweep.view.node": {"rclpy", "bow_msgs", "rerun"},
    "bow_sweep.view.history": {"rerun"},
    "bow_sweep.view.rerun_recording": {"rerun"},
    "bow_sweep.view.live_run": {"rerun"},
}
"""Modules that may know a framework, and which; every other module is pure, through whatever it imports."""


def modules() -> list[str]:
    names = []
    for room in ROOMS:
        for path in sorted((ROOT / room).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            names.append(".".join(parts[:-1] if parts[-1] == "__init__" else parts))
    return names


@pytest.fixture(scope="module")
def loaded() -> dict[str, set[str]]:
    """Which frameworks each module brings into a fresh interpreter."""
    program = (
        "import importlib, os, sys, numba\n"  # numba is slow to import and brings none of them
        "for name in sys.argv[1:]:\n"
        "    read, write = os.pipe()\n"
        "    if not (child := os.fork()):\n"
        "        importlib.import_module(name)\n"
        f"        os.write(write, ' '.join(set(sys.modules) & {FRAMEWORKS!r}).encode())\n"
        "        os._exit(0)\n"
        "    os.close(write)\n"
        "    print(name, os.waitpid(child, 0)[1], os.read(read, 999).decode())\n"
    )
    output = subprocess.run(
        [sys.executable, "-c", program, *modules()], capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout
    found = {}
    for line in output.splitlines():
        name, status, *frameworks = line.split()
        assert status == "0", f"{name} cannot be imported"
        found[name] = set(frameworks)
    return found


@pytest.mark.parametrize("name", modules())
def test_a_module_knows_no_more_frameworks_than_it_needs(name: str, loaded: dict[str, set[str]]) -> None:
    assert loaded[name] <= IMPURE.get(name, set())


@pytest.mark.parametrize("name", modules())
def test_imports_point_from_the_string_to_the_map(name: str) -> None:
    room = name.partition(".")[0]
    downstream = ROOMS[ROOMS.index(room) + 1 :]
    path = ROOT / (name.replace(".", "/") + ".py")
    tree = ast.parse((path if path.exists() else ROOT / name.replace(".", "/") / "__init__.py").read_text())
    for node in ast.walk(tree):
        targets = [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
        targets += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        for target in targets:
            assert target.partition(".")[0] not in downstream, f"{name} imports {target}"


def test_files_fit_in_a_head() -> None:
    for path in [*ROOT.glob("bow_*/**/*.py"), *ROOT.glob("tests/**/*.py"), *ROOT.glob("bench/**/*.py")]:
        text = path.read_text()
        assert text.count("\n") <= 400 or "# long: " in text, f"{path} has {text.count(chr(10))} lines"


def test_the_list_of_impure_modules_names_what_there_is() -> None:
    assert set(IMPURE) <= set(modules())
