"""Recognises the paper's six maps (Fig 11) among runs, by their settings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bow_sim.physics.parameters import FIELDS
from bow_sweep.maps.map_file import MapFile, MapFileError, read_map

LAYOUT: dict[str, tuple[str, float]] = {
    "a": ("delta_cremer", 0.9),
    "b": ("stiff_cremer", 0.9),
    "c": ("delta_cremer", 0.2),
    "d": ("stiff_cremer", 0.2),
    "e": ("delta_cremer", -2.0),
    "f": ("stiff_cremer", -2.0),
}
"""Model and v_mid of the six maps of Fig 11."""

CALIBRATION = ("bridge_r", "bridge_w_c", "dtype", "nut_cutoff", "nut_power", "periods", "stiffness_b", "torsion_half")
"""Parameters that the paper does not give, and the length. A map may have other values; its title then has them."""

PERIODS, FIG10_PERIODS = 100, 40
"""Length of the simulations of Fig 11 and Fig 10, periods (section IV.A)."""

ENDS = (0.5, 20.0, 0.0, 2.0)
"""First and last f_asym and f_init/f_asym (caption of Fig 10)."""


@dataclass(frozen=True)
class PaperMaps:
    """Maps by their letter in Fig 11, and of each run its path and title."""

    maps: dict[str, MapFile]
    listed: tuple[tuple[str, str], ...]


def recognise(runs: Sequence[Path]) -> PaperMaps:
    """Read runs, directories or map.npz files, and find out which of the paper's maps each is.

    Where two runs of one map have different lengths, such as Fig 10 and Fig 11(d), the longer is taken.

    Raises
    ------
    MapFileError
        Where a run has no map, or one that is not the paper's or is incomplete, or where two maps of one length are the
        same.
    """
    maps: dict[str, MapFile] = {}
    listed = []
    for run in runs:
        plane = read_map(run)
        letter = letter_of(plane, str(run))
        if letter in maps and maps[letter].periods == plane.periods:
            raise MapFileError(f"{run}: a second run of Fig 11({letter}); should be one of each")
        listed.append((str(run), title(letter, plane)))
        if letter not in maps or plane.periods > maps[letter].periods:  # Fig 10 is the first part of 11(d)
            maps[letter] = plane
    return PaperMaps(maps, tuple(listed))


def letter_of(plane: MapFile, where: str) -> str:
    """Return the letter of a map in Fig 11.

    Raises
    ------
    MapFileError
        Where it is not in Fig 11, or has cells that are not computed; names the difference.
    """
    given = plane.values
    if (plane.x_name, plane.y_name) != ("f_asym", "f_init_ratio"):
        raise MapFileError(
            f"{where}: its axes are {plane.x_name} and {plane.y_name}; should be f_asym and f_init_ratio"
        )
    ends = (plane.x[0], plane.x[-1], plane.y[0], plane.y[-1])
    if not np.allclose(ends, ENDS):
        spans = [f"{low:g} ... {high:g}" for low, high in (ends[:2], ends[2:], ENDS[:2], ENDS[2:])]
        raise MapFileError(f"{where}: its axes are {spans[0]} and {spans[1]}; should be {spans[2]} and {spans[3]}")
    for name, entry in sorted(FIELDS.items()):
        if name in given and name not in (*CALIBRATION, "model", "v_mid") and given[name] != str(entry.default):
            raise MapFileError(f"{where}: {name} = {given[name]}; should be {entry.default}, as in the paper's maps")
    mine = (given.get("model", ""), given.get("v_mid", ""))
    letters = [letter for letter, (model, v_mid) in LAYOUT.items() if mine == (model, str(v_mid))]
    if not letters:
        raise MapFileError(
            f"{where}: model = {mine[0]}, v_mid = {mine[1]}; should be delta_cremer or stiff_cremer at 0.9, 0.2 or -2.0"
        )
    if plane.simulated is not None:
        predicted = int((~plane.simulated).sum())
        raise MapFileError(f"{where}: {predicted} cells are predicted; should be none: sweep without adaptive")
    missing = int(np.isnan(plane.transient_periods).sum())
    if missing:
        raise MapFileError(f"{where}: {missing} cells are not computed; should be none, see bow sweep --resume")
    return letters[0]


def other_settings(plane: MapFile) -> list[str]:
    """Return the settings of `CALIBRATION` that are not the defaults, as "name = value"."""
    given = plane.values
    return [f"{name} = {given[name]}" for name in CALIBRATION if given.get(name, _default(name)) != _default(name)]


def _default(name: str) -> str:
    return str(FIELDS[name].default)


def title(letter: str, plane: MapFile) -> str:
    """Return the title of a map."""
    ny, nx = plane.shape
    return ", ".join([f"Fig 11({letter})", f"{nx} × {ny} cells", *other_settings(plane)])


def at_paper_size(plane: MapFile) -> bool:
    """Return whether a map has at least the grid and the length of the paper's: 128 by 64 cells, 100 periods."""
    ny, nx = plane.shape
    return nx >= 128 and ny >= 64 and plane.periods >= PERIODS
