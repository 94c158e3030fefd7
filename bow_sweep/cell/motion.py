"""What happens under the bow: the cell computed again with every waveform, and the friction curve it moves on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bow_sim.kernel.block import transient
from bow_sim.physics.friction import sliding_coefficient, slipping_limit, sticking_limit
from bow_sim.physics.gesture import force_and_speed
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import ends
from bow_sweep.cell.cell_record import CellRecord

CURVE_POINTS = 400

HYPERBOLA = "hyperbola"
"""The friction law whose curve is known here, as in :data:`bow_sim.physics.parameters.FRICTIONS`."""


@dataclass(frozen=True, eq=False)
class FrictionCurve:
    """The friction curve at one bow force, where the string's own line meets it (paper Figs 1, 9).

    Attributes
    ----------
    bow_force
        In units of bow speed times impedance.
    v
        (points,) velocity of the string's surface on the slipping part, final bow speed = 1; from the bow speed
        downwards.
    f
        (points,) friction force there.
    v_h
        (points,) velocity of the arriving waves with which the string comes to this point: ``v - Y f``.
    stick
        ((v_h, f), (v_h, f)) ends of the sticking part, on which ``f = (v_b - v_h)/Y``, from no force to the largest.
    v_1, v_2
        Limits of v_h below which sticking and above which slipping ends; equal without hysteresis.
    """

    bow_force: float
    v: NDArray[np.float64]
    f: NDArray[np.float64]
    v_h: NDArray[np.float64]
    stick: tuple[tuple[float, float], tuple[float, float]]
    v_1: float
    v_2: float


@dataclass(frozen=True, eq=False)
class CellMotion:
    """Every waveform of a cell. Arrays are (samples,) float64, velocities with final bow speed = 1.

    Attributes
    ----------
    v, v_h, v_centre
        Velocity of the string's surface, that of the arriving waves, and of the string's centre.
    friction_force
        ``f = (v - v_h)/Y``.
    bow_force, bow_speed
        The gesture.
    slipping
        bool, state after the step.
    y
        Admittance of the string under the bow, Y in ``v = v_h + Y f``.
    same
        Whether the bridge force of this simulation has the bits of the record that it belongs to.
    """

    parameters: Parameters
    v: NDArray[np.float64]
    v_h: NDArray[np.float64]
    v_centre: NDArray[np.float64]
    friction_force: NDArray[np.float64]
    bow_force: NDArray[np.float64]
    bow_speed: NDArray[np.float64]
    slipping: NDArray[np.bool_]
    y: float
    same: bool

    def curve(self, bow_force: float | None = None) -> FrictionCurve | None:
        """Return the friction curve at a bow force, or at the last one; None with another law, or elastic hair."""
        p = self.parameters
        if p.friction != HYPERBOLA or p.hair_r:
            return None
        force = float(self.bow_force[-1]) if bow_force is None else bow_force
        slowest = min(float(self.v.min()), -0.5 * p.v_b)
        slip = (p.v_b - slowest) * np.linspace(0, 1, CURVE_POINTS) ** 2  # finer where the curve is steep
        friction = force * sliding_coefficient(slip, p.mu_s, p.mu_d, p.v_b - p.v_mid)
        v = p.v_b - slip
        v_1 = sticking_limit(force, self.y, p.mu_s, p.v_b)
        return FrictionCurve(
            bow_force=force,
            v=v,
            f=friction,
            v_h=v - self.y * friction,
            stick=((p.v_b, 0.0), (v_1, force * p.mu_s)),
            v_1=v_1,
            v_2=slipping_limit(force, self.y, p.mu_s, p.mu_d, p.v_b - p.v_mid, p.v_b),
        )


def motion(record: CellRecord) -> CellMotion:
    """Compute a cell again with every waveform; `same` says whether that is the motion of the record."""
    p = record.parameters
    traces = transient(p)
    bow_force, bow_speed = force_and_speed(p, 0, p.samples)
    force = traces["bridge_force"].astype(np.float32)
    return CellMotion(
        parameters=p,
        v=traces["v"],
        v_h=traces["v_h"],
        v_centre=traces["v_centre"],
        friction_force=traces["friction_force"],
        bow_force=bow_force,
        bow_speed=bow_speed,
        slipping=traces["slipping"],
        y=float(ends(p).y),
        same=force.tobytes() == record.bridge_force.tobytes(),
    )
