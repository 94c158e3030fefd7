"""The rooms of the house: what is pure stays pure, imports point one way, files fit in a head."""

import ast
import importlib
import re
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from rooms import ARROWS, PACKAGES, ROOT, modules, room_of

FRAMEWORKS = {"rclpy", "mcap", "rerun", "bow_msgs", "bokeh"}

IMPURE = {
    "bow_sim.node": {"rclpy", "bow_msgs"},
    "bow_sim.graph.node_base": {"rclpy", "bow_msgs"},
    "bow_sim.graph.node_process": {"rclpy", "bow_msgs"},
    "bow_sim.graph.inbox": {"rclpy"},
    "bow_sim.graph.outbox": {"rclpy", "bow_msgs"},
    "bow_sim.graph.serialized": {"rclpy", "bow_msgs"},
    "bow_classifier.node": {"rclpy", "bow_msgs"},
    "bow_classifier.simulator": {"rclpy", "bow_msgs"},
    "bow_classifier.measured_node": {"rclpy", "bow_msgs"},
    "bow_sweep.coordinator.cell_chooser": {"rclpy", "bow_msgs"},
    "bow_sweep.coordinator.standard_messages": {"rclpy", "bow_msgs"},
    "bow_sweep.coordinator.node": {"rclpy", "bow_msgs", "mcap"},
    "bow_sweep.cell.from_bag": {"mcap"},
    "bow_sweep.record.aside": {"mcap"},
    "bow_sweep.record.bag": {"mcap"},
    "bow_sweep.record.collect": {"mcap"},
    "bow_sweep.record.index_contents": {"mcap"},
    "bow_sweep.record.inspection": {"mcap"},
    "bow_sweep.record.mcap_writer": {"mcap"},
    "bow_sweep.record.metadata": {"mcap"},
    "bow_sweep.record.notes": {"mcap"},
    "bow_sweep.record.mcap_records": {"mcap"},
    "bow_sweep.record.node": {"rclpy", "bow_msgs", "mcap"},
    "bow_sweep.record.recover": {"mcap"},
    "bow_sweep.record.replay": {"mcap"},
    "bow_sweep.record.run_bags": {"mcap"},
    "bow_sweep.processes.replay_graph": {"rclpy", "bow_msgs", "mcap"},
    "bow_sweep.record.mcap_reader": {"mcap"},
    "bow_sweep.record.session": {"mcap"},
    "bow_sweep.record.bag_contents": {"mcap"},
    "bow_sweep.record.verify": {"mcap"},
    "bow_sweep.coordinator.bags_of_run": {"mcap"},
    "bow_sweep.coordinator.resume": {"mcap"},
    "bow_sweep.processes.supervisor_node": {"rclpy", "bow_msgs"},
    "bow_sweep.processes.station_watch": {"rclpy", "bow_msgs"},
    "bow_sweep.standing.watch": {"rclpy", "bow_msgs"},
    "bow_sweep.explore.packed": {"mcap"},
    "bow_sweep.explore.page": {"bokeh"},
    "bow_sweep.explore.plots": {"bokeh"},
    "bow_sweep.explore.saved": {"bokeh", "mcap"},
    "bow_sweep.explore.served": {"bokeh", "mcap"},
    "bow_sweep.view.blueprint": {"rerun"},
    "bow_sweep.view.bounded": {"rerun"},
    "bow_sweep.view.node": {"rclpy", "bow_msgs", "rerun"},
    "bow_sweep.view.cell_views": {"rerun"},
    "bow_sweep.view.history": {"rerun"},
    "bow_sweep.view.map_layers": {"rerun"},
    "bow_sweep.view.rerun_recording": {"rerun"},
    "bow_sweep.view.live_run": {"rerun"},
    "bow_sweep.view.measured_view": {"rerun"},
}
"""Modules that may know a framework, and which; every other module is pure, through whatever it imports."""


@pytest.fixture(scope="module")
def loaded() -> dict[str, set[str]]:
    """Which frameworks each module brings into a fresh interpreter."""
    program = (
        "import importlib, os, sys\n"
        "import matplotlib.backends.backend_agg, matplotlib.pyplot, mpl_toolkits.axes_grid1\n"
        "import numba, scipy.ndimage, scipy.optimize, scipy.signal\n"
        "import asyncio, concurrent.futures.process, jinja2, rich.progress, tornado.web, tornado.websocket, xxhash\n"
        f"assert not set(sys.modules) & {FRAMEWORKS!r}, 'these are slow to import and bring none of them'\n"
        "def start(name):\n"
        "    read, write = os.pipe()\n"
        "    if not (child := os.fork()):\n"
        "        importlib.import_module(name)\n"
        f"        os.write(write, ' '.join(set(sys.modules) & {FRAMEWORKS!r}).encode())\n"
        "        os._exit(0)\n"
        "    os.close(write)\n"
        "    return name, child, read\n"
        "def end(name, child, read):\n"
        "    print(name, os.waitpid(child, 0)[1], os.read(read, 999).decode())\n"
        "running = []\n"
        "for name in sys.argv[1:]:\n"
        "    if len(running) == os.cpu_count():\n"
        "        end(*running.pop(0))\n"
        "    running.append(start(name))\n"
        "for each in running:\n"
        "    end(*each)\n"
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


def imports(path: Path) -> Iterator[str]:
    """Yield the modules of ours that a file imports, wherever in it; a relative import fails."""
    known = modules()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            assert not node.level, f"{path}, line {node.lineno}: imports are absolute"
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in known else str(node.module)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def arrows() -> dict[str, dict[str, str]]:
    """Return room -> {room that it imports: one module that does}."""
    found: dict[str, dict[str, str]] = {room: {} for room in ARROWS}
    for name, path in modules().items():
        for target in imports(path):
            if target.partition(".")[0] in PACKAGES and room_of(target) != room_of(name):
                found[room_of(name)][room_of(target)] = name
    return found


BY_NAME = {"bow_sweep": {"bow_sim.graph", "bow_sweep.cli"}}
"""Rooms that are imported by their name as text, see bow_sweep/entry.py."""


def test_rooms_import_what_the_table_says_and_nothing_else() -> None:
    for room, targets in arrows().items():
        wrong = {by: target for target, by in targets.items() if target not in ARROWS[room]}
        assert not wrong, f"{room} must not import them (tests/support/rooms.py)"
        unused = ARROWS[room] - set(targets) - BY_NAME.get(room, set())
        assert not unused, f"{room} does not import them any more: take them out of tests/support/rooms.py"


def test_no_room_imports_itself_by_a_way_round() -> None:
    tuple(TopologicalSorter(ARROWS).static_order())  # raises CycleError, which names the rooms


def test_no_module_imports_itself_by_a_way_round() -> None:
    graph = {name: {t for t in imports(path) if t in modules() and t != name} for name, path in modules().items()}
    tuple(TopologicalSorter(graph).static_order())


@pytest.mark.parametrize("room", sorted(set(ARROWS) - {"bow_sim.atomic_files", "bow_sim.config_files"}))
def test_a_room_says_what_is_in_it(room: str) -> None:
    folder = ROOT / room.replace(".", "/")
    said = ast.get_docstring(ast.parse((folder / "__init__.py").read_text())) or ""
    for path in folder.iterdir():
        if (path.suffix == ".py" or (path / "__init__.py").exists()) and not path.stem.startswith("__"):
            assert re.search(rf"^{path.stem}\b", said, re.MULTILINE), f"{room}/__init__.py does not list {path.stem}"


def test_files_fit_in_a_head() -> None:
    for path in [
        *ROOT.glob("bow_*/**/*.py"),
        *ROOT.glob("bow/**/*.py"),
        *(path for room in ("tests", "bench", "studies") for path in ROOT.glob(f"{room}/**/*.py")),
    ]:
        text = path.read_text()
        assert text.count("\n") <= 400 or "# long: " in text, f"{path} has {text.count(chr(10))} lines"


def test_the_list_of_impure_modules_names_what_there_is() -> None:
    assert set(IMPURE) <= set(modules())


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_has_the_public_names_that_it_lists_and_loads_them_late(package: str) -> None:
    face = importlib.import_module(package)
    said = face.__doc__ or ""
    for name in face.__all__:
        assert re.search(rf"^{name}\b", said, re.MULTILINE), f"{package}/__init__.py does not describe {name}"
        assert getattr(face, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = face.nothing
    subprocess.run([sys.executable, "-c", f"import sys, {package}; assert 'numpy' not in sys.modules"], check=True)
