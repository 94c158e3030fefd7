"""A sweep in this process, on all cores, without a ROS graph."""

from __future__ import annotations

import contextlib
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from bow.maps import Map
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.reflection_text import embed_files
from bow_sweep.maps.basin_map import Basin
from bow_sweep.maps.in_process import compute
from bow_sweep.maps.map_file import MapFile
from bow_sweep.plan.adaptive import fill
from bow_sweep.plan.sweep import Sweep

AXIS = ("name", "first", "last", "count", "scale")
"""What a sequence that describes an axis holds, in this order; all but the name may be left out."""

AxisGiven = str | Mapping[str, object] | Sequence[object]


def sweep(
    preset: str = "",
    *,
    nx: int | None = None,
    ny: int | None = None,
    x: AxisGiven | None = None,
    y: AxisGiven | None = None,
    settings: Iterable[str] = (),
    workers: int | None = None,
    progress: bool = True,
    **parameters: object,
) -> Map:
    """Compute a map in this process; the cells have the same bits and verdicts as in the graph of `bow sweep`.

    Parameters
    ----------
    preset
        Name of a preset, as of `bow sweep`; "" for the defaults of the package.
    nx, ny
        Cells along x and y.
    x, y
        Axes: a name; (name, [value, value, ...]); (name, first, last), (name, first, last, count) or (name, first,
        last, count, scale); or a mapping with these names, or with name and values. What is not given is as `bow
        settings` says of that parameter.
    settings
        "name=value" of any setting, as after `--set`; names with a dot can only be given here or as a mapping.
    workers
        Number of threads; None: one for each core that this process may use.
    progress
        Whether to show how far it is, on stderr or in the notebook.
    **parameters
        Any setting by its name, as `bow settings` lists them. A mapping is a group: ``classifier={"corner": 0.4}``.

    Returns
    -------
    Map

    Raises
    ------
    ParameterError
        For a sweep that cannot be computed; names the setting, its value and what would be right. It is a ValueError.

    Warns
    -----
    UserWarning
        Of what is allowed, but perhaps not meant: the notes of `bow sweep`.

    Examples
    --------
    >>> import bow
    >>> m = bow.sweep("fig11d", nx=8, ny=4, periods=20, progress=False)
    >>> m.shape
    (4, 8)
    >>> m = bow.sweep("fig11d", x=("bridge_r", 5, 100, 4), ny=2, periods=20, f_asym=3, progress=False)
    >>> m.axes[0].name
    'bridge_r'
    """
    plan = planned(preset, nx=nx, ny=ny, x=x, y=y, settings=settings, parameters=parameters)
    for note in plan.notes:
        warnings.warn(note, stacklevel=2)
    return computed(plan, workers, progress)


def planned(
    preset: str,
    *,
    nx: int | None,
    ny: int | None,
    x: AxisGiven | None,
    y: AxisGiven | None,
    settings: Iterable[str],
    parameters: Mapping[str, object],
) -> Sweep:
    """Return the sweep that the arguments of :func:`sweep` describe."""
    return Sweep.from_spec(preset, given_settings(nx, ny, x, y, settings, parameters))


def given_settings(
    nx: int | None,
    ny: int | None,
    x: AxisGiven | None,
    y: AxisGiven | None,
    settings: Iterable[str],
    parameters: Mapping[str, object],
) -> list[str]:
    """Return the arguments of :func:`sweep` as "name=value" settings."""
    given = [*embed_files(settings), *embed_files(_texts(parameters))]
    for key, axis, count in (("x", x, nx), ("y", y, ny)):
        given += _axis(key, axis)
        if count is not None:
            given.append(f"{key}.count={count}")
    return given


def computed(plan: Sweep, workers: int | None, progress: bool, what: str = "sweep") -> Map:
    """Compute a planned sweep; `what` is the word of its progress. For the others see :func:`sweep`."""
    with showing(progress, plan.budget, what) as show:
        basin = compute(plan, show, workers or len(os.sched_getaffinity(0)))
    return Map(_map_file(plan, basin))


def written(name: str, value: object) -> str:
    """Return a Python value as a setting is written; a float has all its bits.

    Raises
    ------
    ParameterError
        Where it is neither a number nor a text.
    """
    return next(iter(_texts({name: value}))).partition("=")[2]


def _texts(parameters: Mapping[str, object], prefix: str = "") -> Iterator[str]:
    """Yield settings given as Python values in their written form; floats keep all their bits."""
    for name, value in parameters.items():
        if isinstance(value, Mapping):
            yield from _texts(value, f"{prefix}{name}.")
        elif isinstance(value, (bool, np.bool_)) or value is None:
            raise ParameterError(f"{prefix}{name} = {value!r}: must be a number or a text")
        elif isinstance(value, (float, np.floating)):
            yield f"{prefix}{name}={float(value)!r}"
        else:
            yield f"{prefix}{name}={value}"


def _axis(key: str, given: AxisGiven | None) -> Iterator[str]:
    if given is None:
        return
    if isinstance(given, str):
        given = (given,)
    if isinstance(given, Mapping):
        values = dict(given)
    elif (
        isinstance(given, Sequence)
        and len(given) == 2
        and not isinstance(given[1], str)
        and isinstance(given[1], (Sequence, np.ndarray))
    ):
        values = {"name": given[0], "values": given[1]}
    elif not (isinstance(given, Sequence) and 1 <= len(given) <= len(AXIS)):
        right = f"a name, (name, [value, ...]) or ({', '.join(AXIS)}), whose end may be left out"
        raise ParameterError(f"{key} = {given!r}: should be {right}")
    else:
        values = dict(zip(AXIS, given, strict=False))
    if "values" in values and not isinstance(values["values"], str):
        values["values"] = np.ravel(np.asarray(values["values"])).tolist()  # numbers, or names of models
    yield from _texts(values, f"{key}.")


def _map_file(plan: Sweep, basin: Basin) -> MapFile:
    found = MapFile.of(plan, basin, run_id="")
    if plan.adaptive == 1:
        return found
    simulated = (basin.tested > 0).reshape(found.shape)
    predicted = fill(np.where(simulated, found.transient_periods, np.float32(np.nan)))
    return replace(found, transient_periods=predicted, simulated=simulated)


@contextlib.contextmanager
def showing(wanted: bool, cells: int, what: str = "sweep") -> Iterator[Callable[[float, float], None] | None]:
    """Yield a callback (done, total) that shows a bar on a terminal and in a notebook, and percentages elsewhere."""
    if not wanted:
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    if not (console.is_terminal or console.is_jupyter):
        from bow_sweep.processes.progress import percentages

        yield percentages(what)
        return
    with Progress(console=console, transient=True) as bar:
        task = bar.add_task(what, total=cells)
        yield lambda done, total: bar.update(task, completed=done, total=total)
