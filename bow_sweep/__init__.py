"""A plan in, a map out: sweeps over the player's control space, as a ROS 2 graph or in this process.

plan               what is to be simulated
maps               what a sweep found
run                a run on disk: directory, ledger, lock
record             its bag
cell               one cell of a run: waveform, analysis, sound
figures            pictures of finished maps
edges              where the outcome of a gesture changes; exponents
view               the dashboard
explore            the page in the browser
coordinator        who hands out the blocks
processes          the processes of a graph on this machine
study              families of maps, what they say together, and the search for the best
standing           a graph that stays, and its clients
paper              what the paper states, beside what is found
beyond             the claims made since, beside what is found
cli                the command `bow`
entry              entry points of the executables

Public names, imported when they are first used:

MapFile            a finished map: its axes, and every test of every cell
RunCells           the cells of a run: chosen, read from the bag or computed again
Sweep              what is to be simulated
compute            computes and classifies a sweep in this process
read_map           reads the map of a run directory
replay             classifies a recorded run again
verify             accounts for a recorded run
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bow_sweep.cell.run_cells import RunCells as RunCells
    from bow_sweep.maps.in_process import compute as compute
    from bow_sweep.maps.map_file import MapFile as MapFile
    from bow_sweep.maps.map_file import read_map as read_map
    from bow_sweep.plan.sweep import Sweep as Sweep
    from bow_sweep.record.replay import replay as replay
    from bow_sweep.record.verify import verify as verify

_MODULES = {
    "MapFile": "bow_sweep.maps.map_file",
    "RunCells": "bow_sweep.cell.run_cells",
    "Sweep": "bow_sweep.plan.sweep",
    "compute": "bow_sweep.maps.in_process",
    "read_map": "bow_sweep.maps.map_file",
    "replay": "bow_sweep.record.replay",
    "verify": "bow_sweep.record.verify",
}

__all__ = ["MapFile", "RunCells", "Sweep", "compute", "read_map", "replay", "verify"]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(_MODULES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
