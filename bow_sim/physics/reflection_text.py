"""One reflection function as plain data: taps, first lag and exponential tail; also as text and as a file.

Settings, messages and bags contain the text form, so that they do not depend on a file that only one machine has:
``first=15 taps=-0.92,-0.01 tail=-0.012 pole=0.84 tail_first=16``.
"""

from __future__ import annotations

import functools
import json
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.body import read_modes
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.friction_curve import read_curve
from bow_sim.physics.number_files import COMMENTS, number, read_file, rows

FUNCTIONS = ("bridge_function", "nut_function", "torsion_bridge_function", "torsion_nut_function")
"""The settings that hold a reflection function as text."""

GAIN_TOLERANCE = 1e-6
"""How far a gain may exceed 1, because printed taps are rounded."""

MAX_LAG = 1 << 16
"""Greatest lag of a user's reflection function, samples."""

_KEYS = ("first", "taps", "tail", "pole", "tail_first", "tail_taps")


@dataclass(frozen=True)
class Reflection:
    """One reflection function: ``in[t] = sum_k taps[k] out[t - first - k] + tail``.

    The tail is ``tail * sum_k pole**k x[t - k]``, computed by one multiply-add a step, with
    ``x[t] = sum_j tail_taps[j] out[t - tail_first - j]``.

    Parameters
    ----------
    taps : tuple of float
        Coefficients at lags ``first``, ``first + 1``, ...
    first : int
        Lag of the first tap, samples, at least 1.
    tail, pole : float
        Size and ratio of the exponential tail; ``tail = 0`` for none.
    tail_first : int
        Lag of the tail's first sample, samples.
    tail_taps : tuple of float
        What the tail is made of; more than one tap where its lag is between two samples.
    """

    taps: tuple[float, ...]
    first: int
    tail: float = 0.0
    pole: float = 0.0
    tail_first: int = 1
    tail_taps: tuple[float, ...] = (1.0,)

    @property
    def last(self) -> int:
        """The greatest lag, samples."""
        return max(self.first + len(self.taps) - 1, self.tail_first + len(self.tail_taps) - 1 if self.tail else 0)

    @property
    def soonest(self) -> int:
        """The least lag, samples."""
        return min(self.first, self.tail_first) if self.tail else self.first

    def response(self, z: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the z transform; at ``z = exp(i w)``, w in radians a sample, the frequency response.

        Parameters
        ----------
        z : ndarray of complex, any shape

        Returns
        -------
        ndarray of complex, the same shape
        """
        step = 1.0 / np.asarray(z, dtype=np.complex128)
        total = _polynomial(self.taps, step) * step**self.first
        if self.tail:
            start = _polynomial(self.tail_taps, step) * step**self.tail_first
            total = total + self.tail * start / (1.0 - self.pole * step)
        return total

    def impulse(self, samples: int) -> NDArray[np.float64]:
        """Return the function at lags 0 ... samples - 1.

        Returns
        -------
        ndarray, shape (samples,)
        """
        h = np.zeros(max(samples, self.first + len(self.taps)))
        h[self.first : self.first + len(self.taps)] = self.taps
        h = h[:samples]
        if self.tail and samples > self.tail_first:
            decay = self.tail * self.pole ** np.arange(samples - self.tail_first, dtype=np.float64)
            h[self.tail_first :] += np.convolve(self.tail_taps, decay)[: len(decay)]
        return h

    def text(self) -> str:
        """Return the function as text, which :func:`parse` reads back bit for bit."""
        words = f"first={self.first} taps={','.join(repr(x) for x in self.taps)}"
        if not self.tail:
            return words
        words += f" tail={self.tail!r} pole={self.pole!r} tail_first={self.tail_first}"
        return words if self.tail_taps == (1.0,) else f"{words} tail_taps={','.join(map(repr, self.tail_taps))}"


def _polynomial(coefficients: tuple[float, ...], x: NDArray[np.complex128]) -> NDArray[np.complex128]:
    total = np.zeros_like(x)
    for coefficient in reversed(coefficients):  # Horner
        total = total * x + coefficient
    return total


@functools.lru_cache(maxsize=256)
def parse(text: str, name: str = "reflection function") -> Reflection:
    """Return a reflection function from its text form.

    Parameters
    ----------
    text : str
        ``first=LAG taps=NUMBER,NUMBER,...``, with ``tail=``, ``pole=`` and ``tail_first=`` if there is a tail.
    name : str
        Its name in error messages.

    Raises
    ------
    ParameterError
        If the text is not of that form; :func:`check` checks the function itself.
    """
    given: dict[str, str] = {}
    for word in text.split():
        key, equals, value = word.partition("=")
        if not equals or key not in _KEYS or key in given:
            raise ParameterError(
                f"{name}: {_short(word)!r}: must be one of first=LAG, taps=NUMBER,NUMBER,..., tail=NUMBER, "
                "pole=NUMBER, tail_first=LAG, tail_taps=NUMBER,NUMBER,..., each once, separated by spaces"
            )
        given[key] = value
    if "first" not in given or "taps" not in given:
        raise ParameterError(f"{name} = {_short(text)!r}: must give at least first=LAG and taps=NUMBER,NUMBER,...")
    first = _lag(given["first"], f"{name}: first")
    return Reflection(
        tuple(_number(x, f"{name}: taps[{i}]") for i, x in enumerate(given["taps"].split(","))),
        first,
        _number(given.get("tail", "0"), f"{name}: tail"),
        _number(given.get("pole", "0"), f"{name}: pole"),
        _lag(given.get("tail_first", str(first + 1 if "tail" in given else 1)), f"{name}: tail_first"),
        tuple(_number(x, f"{name}: tail_taps[{i}]") for i, x in enumerate(given.get("tail_taps", "1").split(","))),
    )


def check(reflection: Reflection, name: str, sample_rate: float) -> None:
    """Raise an error for a reflection function that no end of a string can have.

    Parameters
    ----------
    reflection : Reflection
    name : str
        Its name in error messages.
    sample_rate : float
        Hz.

    Raises
    ------
    ParameterError
        If it has a lag below 1, does not decay, or reflects more than it receives at some frequency.
    """
    for what, lag in (("first", reflection.first), ("tail_first", reflection.tail_first)):
        if not 1 <= lag <= MAX_LAG:
            raise ParameterError(
                f"{name}: {what} = {lag}: must be 1 ... {MAX_LAG} samples: an end of the string answers "
                "after, not before, a wave has left the bow"
            )
    if len(reflection.taps) > MAX_LAG:
        raise ParameterError(f"{name}: {len(reflection.taps)} taps: must be at most {MAX_LAG}")
    if not abs(reflection.pole) < 1:
        raise ParameterError(f"{name}: pole = {reflection.pole!r}: must be between -1 and 1, or the tail never ends")
    w, gain = greatest_gain(reflection)
    if gain > 1 + GAIN_TOLERANCE:
        raise ParameterError(
            f"{name}: gain {gain:.6g} at {w * sample_rate / (2 * math.pi):.5g} Hz: must be at most 1 at every "
            f"frequency, or waves would grow by themselves; dividing taps and tail by {gain:.6g} would do"
        )


@functools.lru_cache(maxsize=256)
def greatest_gain(reflection: Reflection) -> tuple[float, float]:
    """Return the greatest gain over all frequencies, and its place.

    Returns
    -------
    w : float
        Its frequency, radians a sample.
    gain : float
    """
    points = 8192
    while points < 8 * reflection.last:
        points *= 2
    w = np.linspace(0.0, math.pi, points + 1)
    gains = np.abs(reflection.response(np.exp(1j * w)))
    best = int(np.argmax(gains >= gains.max() - GAIN_TOLERANCE / 1000))  # the lowest of equal ones
    # a resonance may lie between the points of the grid
    finer = np.linspace(w[max(best - 1, 0)], w[min(best + 1, points)], 129)
    fine = np.abs(reflection.response(np.exp(1j * finer)))
    place = int(np.argmax(fine))
    if fine[place] > gains[best] * (1 + GAIN_TOLERANCE / 1000):
        return float(finer[place]), float(fine[place])
    return float(w[best]), float(gains[best])


def read(path: str | Path) -> str:
    """Return the text form of a reflection function in a file.

    Parameters
    ----------
    path : str or Path
        The text form itself; or JSON, an object with ``first``, ``taps`` and perhaps ``tail``, ``pole`` and
        ``tail_first``; or a table of two columns, lag in samples and value, as
        :mod:`bow_sim.physics.number_files` reads it.

    Raises
    ------
    ParameterError
        If the file cannot be read or has none of these forms.
    """
    content = read_file(path)
    if content.lstrip().startswith("{"):
        return _from_json(content, str(path)).text()
    if re.search(r"\bfirst\s*=", content):
        bare = " ".join(COMMENTS.sub("", line) for line in content.split("\n"))
        return parse(re.sub(r"\s*([=,])\s*", r"\1", bare), str(path)).text()
    return _from_table(content, str(path)).text()


def embed_files(settings: Iterable[str]) -> tuple[str, ...]:
    """Replace ``NAME=@FILE`` by what the file holds, for the settings that are texts; for command lines only.

    Parameters
    ----------
    settings : iterable of str
        ``name=value`` texts.

    Returns
    -------
    tuple of str
    """
    readers = {**dict.fromkeys(FUNCTIONS, read), "body_modes": read_modes, "friction_curve": read_curve}
    done = []
    for setting in settings:
        name, _, value = (part.strip() for part in setting.partition("="))
        if name in readers and value.startswith("@"):
            done.append(f"{name}={readers[name](value[1:])}")
        else:
            done.append(setting)
    return tuple(done)


def _from_json(content: str, path: str) -> Reflection:
    try:
        values = json.loads(content)
    except json.JSONDecodeError as error:
        raise ParameterError(f"{path}: must be JSON, an object with first and taps: {error}") from None
    unknown = sorted(set(values) - set(_KEYS))
    if unknown:
        raise ParameterError(f"{path}: {unknown[0]}: unknown key; must be one of {', '.join(_KEYS)}")
    taps = values.get("taps")
    if not isinstance(taps, list):
        raise ParameterError(f"{path}: taps = {_short(repr(taps))}: must be a list of numbers")
    words = [f"{key}={values[key]}" for key in _KEYS if key in values and key != "taps"]
    return parse(" ".join([*words, f"taps={','.join(str(x) for x in taps)}"]), path)


def _from_table(content: str, path: str) -> Reflection:
    values: dict[int, float] = {}
    try:
        table = list(rows(content))
    except ValueError as error:
        raise ParameterError(f"{path}, {error}") from None
    for line, words in table:
        if len(words) != 2:
            raise ParameterError(
                f"{path}, line {line}: {_short(' '.join(words))!r}: must be a lag in samples and a value"
            )
        lag = _lag(words[0], f"{path}, line {line}: lag")
        if lag in values:
            raise ParameterError(f"{path}, line {line}: lag {lag}: must be there once only")
        values[lag] = _number(words[1], f"{path}, line {line}: value")
    if not values:
        raise ParameterError(f"{path}: must have lines of a lag in samples and a value, or be JSON")
    first, last = min(values), max(values)
    if last - first >= MAX_LAG:
        raise ParameterError(f"{path}: lags {first} ... {last}: must span at most {MAX_LAG} samples")
    return Reflection(tuple(values.get(lag, 0.0) for lag in range(first, last + 1)), first)


def _number(text: str, name: str) -> float:
    try:
        value = number(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ParameterError(f"{name} = {_short(text)!r}: must be a finite number")
    return value


def _lag(text: str, name: str) -> int:
    try:
        value = number(text)
    except ValueError:
        value = math.nan
    if not value.is_integer():  # 124.0 and 1.24e2 are
        raise ParameterError(f"{name} = {_short(text)!r}: must be a whole number of samples")
    return int(value)


def _short(text: str) -> str:
    return text if len(text) <= 60 else f"{text[:57]}..."
