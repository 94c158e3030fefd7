"""The written form of a sweep, as far as all rooms of the house need it.

A sweep is "name=value" settings (see :mod:`bow_sweep.plan.sweep`): names of
:class:`bow_sim.physics.parameters.Parameters`, ``x.*`` and ``y.*`` for the axes of the map, ``classifier.*`` for
thresholds, ``block_cells`` and ``adaptive``. Simulator and classifier stand upstream of the plan and only take these
apart.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import Parameters, parse_settings

GROUPS = ("x", "y", "classifier")
"""Prefixes of settings that are not parameters of the string."""


@dataclass(frozen=True)
class Spec:
    """Settings taken apart: the values are text or, from a preset file, whatever YAML made of them."""

    plain: Mapping[str, object]
    x: Mapping[str, object]
    y: Mapping[str, object]
    classifier: Mapping[str, object]
    block_cells: object = None
    adaptive: object = None

    def parameters(self) -> Parameters:
        """Return what is common to all cells; the two swept parameters keep their defaults."""
        return Parameters.from_mapping(self.plain)

    def number(self, group: str, key: str) -> int:
        """Return a whole number of a resolved sweep, such as ``x.count``.

        Raises
        ------
        ParameterError
            Where it is missing or no number.
        """
        source = {"block_cells": self.block_cells} if group == "" else getattr(self, group)
        try:
            return int(str(source[key]))
        except (KeyError, ValueError):
            name = f"{group}.{key}" if group else key
            raise ParameterError(f"{name} = {source.get(key)!r}: should be a whole number") from None

    def share(self, key: str) -> float:
        """Return a setting that is a share, above 0 and at most 1.

        Raises
        ------
        ParameterError
            Where it is none.
        """
        value = getattr(self, key)
        try:
            share = float(str(value))
        except ValueError:
            raise ParameterError(f"{key} = {value!r}: should be a number") from None
        if not 0 < share <= 1:
            raise ParameterError(f"{key} = {share:g}: should be above 0 and at most 1")
        return share


def split(settings: Mapping[str, object] | Iterable[str]) -> Spec:
    """Return settings taken apart by their prefixes; unknown names stay among the plain ones and are refused there.

    Raises
    ------
    ParameterError
        Where a text is not of the form name=value.
    """
    mapping = settings if isinstance(settings, Mapping) else parse_settings(settings)
    groups: dict[str, dict[str, object]] = {group: {} for group in GROUPS}
    plain: dict[str, object] = {}
    for key, value in mapping.items():
        head, dot, tail = key.partition(".")
        if dot and head in groups:
            groups[head][tail] = value
        else:
            plain[key] = value
    own = {key: plain.pop(key, None) for key in ("block_cells", "adaptive")}
    return Spec(plain=plain, **groups, **own)  # type: ignore[arg-type]  # each by its own name


def axis_values(scale: str, first: float, last: float, count: int) -> NDArray[np.float64]:
    """Return the values along an axis of a map, shape (count,), both ends exact.

    Parameters
    ----------
    scale
        "log" or "linear".
    first, last
        Both included; finite, and above 0 on a logarithmic axis.
    count
        Number of values, 1 or more.
    """
    space = np.geomspace if scale == "log" else np.linspace
    values: NDArray[np.float64] = space(first, last, count)
    values[0] = first
    if count > 1:
        values[-1] = last
    return values
