"""A friction curve of one's own: coefficient against slip speed, straight between its points (PHYSICS.md section 13).

The string's straight line meets such a curve where ``g(s) = s + Y f_b mu(s)`` is ``|D|``. For the hysteresis rule of
the hyperbola (stick as long as possible, slip until capture) there must be one slipping solution that lasts. So g may
fall first and rise then, but never fall again, at any bow force: the pieces of mu that fall must become flatter with
rising slip speed. Pieces that rise do no harm.
"""

from __future__ import annotations

import functools
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.number_files import COMMENTS, number, read_file, table

MOST = 1000
"""Points of a curve, at most; each costs time in every step."""

GREATEST = 100.0
"""Coefficient, at most."""

SLACK = 1e-6
"""Share by which a piece may be steeper than one before it, because printed numbers are rounded."""


class Points(NamedTuple):
    """The points of a curve; beyond the last one it is constant.

    Parameters
    ----------
    speed : ndarray, shape (points,)
        Slip speed, rising from 0; m/s where there is `v_unit`, else in units of the bow speed.
    mu : ndarray, shape (points,)
        Friction coefficient; the first is that on the point of sticking.
    slope : ndarray, shape (points,)
        Of the piece that begins at each point; 0 for the last.
    end : ndarray, shape (points,)
        Speed where that piece ends; infinite for the last.
    """

    speed: NDArray[np.float64]
    mu: NDArray[np.float64]
    slope: NDArray[np.float64]
    end: NDArray[np.float64]

    def at(self, speed: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the coefficient at slip speeds >= 0, in the units of the curve; shape of `speed`."""
        return np.interp(speed, self.speed, self.mu)


@functools.lru_cache(maxsize=256)
def parse(text: str, path: str = "") -> Points:
    """Return the points of a curve from its text, ``0/0.8, 0.1/0.5, 0.5/0.3``.

    Parameters
    ----------
    text : str
        Points ``slip speed/coefficient``, separated by commas or white space.

    Raises
    ------
    ParameterError
        Naming the point from which on the curve cannot be, or the pieces with more than one answer.
    """
    where = f"{path}friction_curve"
    words = text.replace(",", " ").split()
    if not 2 <= len(words) <= MOST:
        raise ParameterError(
            f"{where}: {len(words)} points: must be 2 ... {MOST} of them, slip speed/coefficient, as 0/0.8, 0.5/0.3"
        )
    speed, mu = (np.array(column) for column in zip(*(_point(word, where) for word in words), strict=True))
    if speed[0] != 0:
        raise ParameterError(f"{where}: {words[0]!r}: the first slip speed must be 0, on the point of sticking")
    if not mu[0] > 0:
        raise ParameterError(f"{where}: {words[0]!r}: the first coefficient must be > 0")
    for i in np.flatnonzero(np.diff(speed) <= 0)[:1]:
        raise ParameterError(f"{where}: {words[i + 1]!r} after {words[i]!r}: slip speeds must rise")
    slope = np.append(np.diff(mu) / np.diff(speed), 0.0)
    falls = np.minimum(slope, 0.0)
    least = np.maximum.accumulate(falls)
    for i in np.flatnonzero(falls[1:] < least[:-1] * (1 + SLACK))[:1]:
        raise ParameterError(
            f"{where}: {words[i + 1]!r} to {words[i + 2]!r}: the coefficient falls more steeply than at a lower slip "
            f"speed (slope {slope[i + 1]:.4g} after {least[i]:.4g}): some bow forces then have more than one slip "
            "speed, and nothing says which; where it falls it must become flatter: leave out a point, or smooth it"
        )
    return Points(speed, mu, slope, np.append(speed[1:], np.inf))


def check(law: str, text: str, path: str = "") -> None:
    """Raise ParameterError where there is a curve without its law, or the law without a curve."""
    if law == "curve" and not text:
        raise ParameterError(f"{path}friction = 'curve': needs friction_curve=0/0.8,0.1/0.5,... or @FILE")
    if law != "curve" and text:
        raise ParameterError(f"{path}friction_curve: must be empty with friction = {law!r}; set friction=curve")


def _point(word: str, where: str) -> tuple[float, float]:
    try:
        speed, mu = (number(part) for part in word.split("/"))
    except ValueError:
        speed = mu = math.nan
    if not (0 <= speed < math.inf and 0 <= mu <= GREATEST):
        raise ParameterError(
            f"{where}: {word!r}: must be slip speed/coefficient, two numbers >= 0, as 0.1/0.5; the second at most "
            f"{GREATEST:g}"
        )
    return speed, mu


def read_curve(path: str | Path) -> str:
    """Return the curve in a file as text: a point in each line, as in :func:`parse` or in two columns.

    Raises
    ------
    ParameterError
        If the file cannot be read, or a line is neither.
    """
    content = read_file(path)
    bare = COMMENTS.sub("", content)
    if "/" in bare and not any(line.strip()[:1].isalpha() for line in bare.split("\n")):
        return ", ".join(bare.replace(",", " ").split())
    return table(path, content, 2, "a slip speed and a coefficient")
