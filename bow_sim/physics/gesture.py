"""Bowing gestures: bow force and bow speed over time (paper sections II.A and III.C).

Every gesture is ``f_b(t) = f_end + f_step F(t)`` and ``v_b(t) = v_0 + v_1 V(t)``, with two shapes F and V, tabulated at
each sample. The kernel uses only this form, so it is the same for every gesture. The shapes are computed by
:func:`bow_sim.physics.exact.exp` one sample at a time, so that they are the same on every machine.

A new gesture needs, in this file, its coefficients in :func:`levels` and its shapes in :func:`_shapes`, its name in
:data:`bow_sim.physics.parameters.GESTURES`, and the same gesture in ``tests/support/scalar_string.py``, with which the
kernel must agree bit for bit.
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics import exact
from bow_sim.physics.cells import Cells
from bow_sim.physics.cells import cells as cells_of
from bow_sim.physics.parameters import Parameters


class Levels(NamedTuple):
    """The coefficients of a gesture, arrays of shape (cells,) or numbers.

    Parameters
    ----------
    f_end, f_step : float or ndarray
        Bow force at the end, and by how much it differs at the start.
    v_0, v_1 : float or ndarray
        Bow speed is ``v_0 + v_1 V(t)``.
    """

    f_end: Any
    f_step: Any
    v_0: Any
    v_1: Any


def levels(gesture: str, f_asym: Any, f_init_ratio: Any, v_b: Any) -> Levels:
    """Return the coefficients of a gesture from its parameters, numbers or arrays of shape (cells,)."""
    ratio = 0.0 * f_init_ratio if gesture == "string_crossing" else f_init_ratio
    f_step = ratio * f_asym - f_asym
    if gesture == "martele":
        return Levels(f_asym, f_step, v_b, -v_b)
    if gesture in ("accelerate_to", "guettler"):
        return Levels(f_asym, f_step, 0.0 * v_b, v_b)
    return Levels(f_asym, f_step, v_b, 0.0 * v_b)


@functools.lru_cache(maxsize=8192)
def decay(tau: float, start: int, samples: int) -> NDArray[np.float64]:
    """Return ``exp(-t/tau)`` at ``t = start ... start + samples - 1``, read-only."""
    table = np.array([exact.exp(-t / tau) for t in range(start, start + samples)])
    table.setflags(write=False)
    return table


@functools.lru_cache(maxsize=4096)
def ramp(rise: float, most: float, start: int, samples: int) -> NDArray[np.float64]:
    """Return ``min(most, rise t)`` at ``t = start ... start + samples - 1``, read-only."""
    table = np.minimum(most, rise * np.arange(start, start + samples, dtype=np.float64))
    table.setflags(write=False)
    return table


@functools.lru_cache(maxsize=64)
def zeros(samples: int) -> NDArray[np.float64]:
    """Return zeros, read-only: the shape of a constant."""
    table = np.zeros(samples)
    table.setflags(write=False)
    return table


def shapes(p: Parameters, start: int, samples: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return F(t) and V(t) of a gesture.

    Parameters
    ----------
    p : Parameters
    start, samples : int
        The first sample, and the number of samples.

    Returns
    -------
    F, V : ndarray, shape (samples,), read-only
    """
    return _shapes(p.gesture, p.tau_f, p.tau_v, p.acceleration / p.period, start, samples)


def shapes_of_chunks(
    p: Parameters, start: int, samples: int, chunks: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return F(t) and V(t) of a gesture in some chunks of `samples` samples.

    Returns
    -------
    F, V : ndarray, shape (1, chunks * samples)
    """
    return _joined(p.gesture, p.tau_f, p.tau_v, p.acceleration / p.period, start, samples, chunks)


def shapes_of_cells(cells: Cells, start: int, samples: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return F(t) and V(t) of each cell.

    Returns
    -------
    F, V : ndarray, shape (cells, samples)
    """
    p = cells.parameters
    columns = zip(
        cells.value("tau_f").tolist(),
        cells.value("tau_v").tolist(),
        (cells.value("acceleration") / p.period).tolist(),
        strict=True,
    )
    pairs = [_shapes(p.gesture, tau_f, tau_v, rise, start, samples) for tau_f, tau_v, rise in columns]
    return np.array([f for f, _ in pairs]), np.array([v for _, v in pairs])


@functools.lru_cache(maxsize=256)
def _joined(
    gesture: str, tau_f: float, tau_v: float, rise: float, start: int, samples: int, chunks: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return those of `_shapes`, chunk by chunk, as others need them, in a row."""
    each = [_shapes(gesture, tau_f, tau_v, rise, start + n * samples, samples) for n in range(chunks)]
    return np.concatenate([f for f, _ in each])[None], np.concatenate([v for _, v in each])[None]


def _shapes(
    gesture: str, tau_f: float, tau_v: float, rise: float, start: int, samples: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if gesture == "martele":
        return decay(tau_f, start, samples), decay(tau_v, start, samples)
    if gesture in ("accelerate_to", "guettler"):
        return decay(tau_f, start, samples), ramp(rise, 1.0 if gesture == "accelerate_to" else math.inf, start, samples)
    return decay(tau_f, start, samples), zeros(samples)


def force_and_speed(p: Parameters, start: int, samples: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return f_b(t) and v_b(t) of one cell, for figures and audio.

    Parameters
    ----------
    p : Parameters
    start, samples : int
        The first sample, and the number of samples.

    Returns
    -------
    f_b, v_b : ndarray, shape (samples,)
    """
    (ratio,) = cells_of(p, {"f_asym": [p.f_asym]}).value("f_init_ratio").tolist()
    level = levels(p.gesture, p.f_asym, ratio, p.v_b)
    f, v = shapes(p, start, samples)
    return level.f_end + level.f_step * f, level.v_0 + level.v_1 * v
