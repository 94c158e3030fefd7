"""Maps of the bowed string in Python: sweeps, recorded runs, their cells, and measured strings.

A face over the other packages, for scripts and notebooks. Only `graph` needs ROS.

found        what a map holds
maps         a map: what a sweep found, its cells, tables and pictures
sweeps       a sweep in this process, on all cores
graphs       sweeps in a ROS graph
cells        one cell: waveform, slips, spectrum, picture, sound
dataset      a map, and the waveform of a cell, as xarray.Dataset
tables       a map as a file: netCDF, CSV, Parquet
pictures     maps as a picture for a paper
plots        several maps, or runs, as a picture
shown        pictures and sounds that a notebook shows
comparison   several maps compared
studies      a family of maps over further parameters
recordings   a measured bridge force judged
recorded     recordings of a bridge force in files
optional     libraries that not every installation has

Public names, imported when they are first used:

Cell         one cell of a map
Comparison   how maps differ in playability and in settings
Graph        a ROS graph that runs sweeps
Judged       what is found in a measured bridge force
Map          a map: what a sweep found
Measured     a measure of a map, with its uncertainty
Picture      a picture; a notebook shows it
Sound        a sound; a notebook plays it
Study        a family of maps over further parameters
classify     judges a measured bridge force
compare      compares maps
graph        a ROS graph, to run sweeps in
open         opens a recorded run or study
plot         a picture of several maps
study        computes a family of maps in a ROS graph
sweep        computes a map in this process
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bow.cells import Cell as Cell
    from bow.comparison import Comparison as Comparison
    from bow.comparison import compare as compare
    from bow.found import Measured as Measured
    from bow.graphs import Graph as Graph
    from bow.graphs import graph as graph
    from bow.maps import Map as Map
    from bow.plots import plot as plot
    from bow.recordings import Judged as Judged
    from bow.recordings import classify as classify
    from bow.shown import Picture as Picture
    from bow.shown import Sound as Sound
    from bow.studies import Study as Study
    from bow.studies import open_any as open
    from bow.studies import study as study
    from bow.sweeps import sweep as sweep

_PLACES = {
    "Cell": "bow.cells:Cell",
    "Comparison": "bow.comparison:Comparison",
    "Graph": "bow.graphs:Graph",
    "Judged": "bow.recordings:Judged",
    "Map": "bow.maps:Map",
    "Measured": "bow.found:Measured",
    "Picture": "bow.shown:Picture",
    "Sound": "bow.shown:Sound",
    "Study": "bow.studies:Study",
    "classify": "bow.recordings:classify",
    "compare": "bow.comparison:compare",
    "graph": "bow.graphs:graph",
    "open": "bow.studies:open_any",
    "plot": "bow.plots:plot",
    "study": "bow.studies:study",
    "sweep": "bow.sweeps:sweep",
}

__all__ = [
    "Cell",
    "Comparison",
    "Graph",
    "Judged",
    "Map",
    "Measured",
    "Picture",
    "Sound",
    "Study",
    "classify",
    "compare",
    "graph",
    "open",
    "plot",
    "study",
    "sweep",
]


def __getattr__(name: str) -> Any:
    if name in _PLACES:
        module, _, inside = _PLACES[name].partition(":")
        return getattr(import_module(module), inside)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
