"""Bisected edges as a picture: the map with its boundaries coloured by kind, and when motions part."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from bow_sim.figures.page import MUTED, check_path, save, style
from bow_sweep.edges.bisection import Edges
from bow_sweep.edges.boundary import Boundary
from bow_sweep.edges.motions import HELP
from bow_sweep.edges.parting import KINDS
from bow_sweep.figures.colours import GREY
from bow_sweep.figures.layout import Layout, cell_pixels, titles
from bow_sweep.figures.maps import LINE_PITCH, regime_picture
from bow_sweep.figures.panel import label, paint
from bow_sweep.maps.map_file import MapFile
from bow_sweep.maps.plane import NOT_COMPUTED

COLOURS = {"decision": "#d55e00", "grain": "#0072b2", "unstable": "#cc79a7", "threshold": "#000000"}
"""Okabe and Ito's colours, which colour-blind people can distinguish."""

MEANINGS = {
    "decision": "parting within 2 periods of the deciding step",
    "grain": "parting later: a slip moved by one sample",
    "unstable": "the narrower the bracket, the later they part",
    "threshold": "not parted at the end: only a threshold between",
}

PALE = 0.62
"""Share of white in the colours of regimes below the edges."""

SHOWN = 6
"""Edges of each kind whose partings are drawn, at most."""

MAP_PIXELS, BELOW_PIXELS = (1280, 640), (1280, 480)


def edges_figure(edges: Edges, found: MapFile, others: Boundary | None = None, dpi: float = 200) -> Figure:
    """Return the picture.

    Parameters
    ----------
    edges
        Bisected edges.
    found
        The map that they are of.
    others
        Edges of the map that were left out; drawn thin.
    """
    with style():
        width, height = cell_pixels(found, MAP_PIXELS, dpi)
        title, made = titles(found)
        left, top = 155.0, 116.0 + LINE_PITCH * (len(made) + 1)
        below = top + height + 200
        layout = Layout(left + width + 620, below + BELOW_PIXELS[1] + 130, dpi)
        layout.text(left, 62, f"{title}: edges", fontsize=13, fontweight="bold")
        lines = [*made, f"outcome: {HELP[edges.outcome]}  \u00b7  {edges.width.shape[1] - 1} halvings"]
        for number, line in enumerate(lines):
            layout.text(left, 112 + number * LINE_PITCH, line, color=MUTED)
        ax = layout.axes(left, top, width, height)
        _map(ax, edges, found, others)
        _legend(layout, edges, left + width + 36, top, others)
        _partings(layout.axes(left, below, *BELOW_PIXELS), edges, found)
    return layout.figure


def _map(ax: Axes, edges: Edges, found: MapFile, others: Boundary | None) -> None:
    colours = regime_picture(found).astype(float)
    colours = (colours + PALE * (255 - colours)).round().astype(np.uint8)
    colours[found.mask() == NOT_COMPUTED] = GREY
    paint(ax, found, colours)
    label(ax, found, "full", "full")
    wide = float(np.clip(180 / max(found.shape), 1.0, 3.0))
    if others is not None and len(others):
        ax.add_collection(LineCollection(_segments(others), colors="0.35", linewidths=0.25 * wide, capstyle="butt"))
    colour = [COLOURS[KINDS[kind]] for kind in edges.kind]
    ax.add_collection(
        LineCollection(_segments(edges.boundary), colors=colour, linewidths=wide, capstyle="projecting", zorder=3)
    )


def _segments(edges: Boundary) -> list[np.ndarray]:
    """Return the side of the cell that each edge stands for, (edges, 2, 2), in cells."""
    across = edges.along == 0
    first = np.stack([edges.ix + across, edges.iy + ~across], axis=1).astype(float)
    second = np.stack([edges.ix + 1, edges.iy + 1], axis=1).astype(float)
    return list(np.stack([first, second], axis=1))


def _legend(layout: Layout, edges: Edges, left: float, top: float, others: Boundary | None) -> None:
    counts = edges.counts()
    at = top
    for name, count in counts.items():
        colour = [int(COLOURS[name][i : i + 2], 16) for i in (1, 3, 5)]
        layout.swatch(colour, left, at, 44, 30)
        layout.text(left + 60, at + 14, f"{name}  {count}", va="center", fontweight="bold")
        layout.text(left + 60, at + 48, MEANINGS[name], va="center", fontsize=7, color=MUTED)
        at += 92
    lines = [f"{len(edges)} edges"]
    if others is not None and len(others):
        lines.append(f"{len(others)} more, not bisected: thin lines")
    if edges.unlike:
        lines.append(f"{edges.unlike} with one outcome on both sides now")
    lines.append("below the edges: regimes at the last test, pale")
    for line in lines:
        layout.text(left, at + 14, line, va="center", fontsize=7.5)
        at += 36


def _partings(ax: Axes, edges: Edges, found: MapFile) -> None:
    """Draw parting against the logarithm of the bracket's width for some edges of each kind."""
    from bow_sweep.edges.boundary import spread

    cell = edges.width[:, :1]
    drawn = set()
    for code, name in enumerate(KINDS):
        of_kind = np.flatnonzero((edges.kind == code) & (edges.parting >= 0).any(axis=1))
        for i in of_kind[spread(len(of_kind), SHOWN)] if len(of_kind) else []:
            parted = edges.parting[i] >= 0
            x = -np.log(edges.width[i] / cell[i])[parted]
            ax.plot(
                x,
                edges.parting[i][parted],
                color=COLOURS[name],
                linewidth=1.0,
                marker=".",
                markersize=3,
                label=None if name in drawn else name,
            )
            drawn.add(name)
    ax.set_ylim(0, found.periods)
    ax.set_xlim(left=0)
    ax.set_xlabel("-ln(width of the bracket / a cell)")
    ax.set_ylabel("parting (periods)")
    ax.set_title(f"When the two motions part: up to {SHOWN} edges of each kind", loc="left", fontsize=9)
    ax.grid(linewidth=0.3)
    if drawn:
        ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0, fontsize=7.5)


def draw_edges(edges: Edges, found: MapFile, path: Path, others: Boundary | None = None) -> None:
    """Draw the picture; `path` ends in .png, .svg or .pdf. Readers see the old file or the complete new one.

    Raises
    ------
    FigureError
        For another suffix.
    """
    check_path(path)
    save(edges_figure(edges, found, others), path)
