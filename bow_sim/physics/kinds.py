"""Axes whose cells cannot be computed, or judged, in one block: models of the string, thresholds of the verdicts.

Their cells have a *kind*: a value of each such axis. A block has cells of one kind. In messages and in ``map.npz`` a
model is its number in :data:`MODEL_NAMES`, so new models come last in :data:`bow_sim.physics.parameters.MODELS`; in
settings it is its name.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import MODELS, Parameters

MODEL = "model"
MODEL_NAMES = tuple(MODELS)
THRESHOLD = "classifier."
"""Beginning of the names of thresholds."""


class Common(NamedTuple):
    """What cells of one kind have in common, and what differs between them.

    Parameters
    ----------
    parameters : Parameters
    lanes : dict of str to array_like, each of shape (cells,)
        As :class:`bow_sim.kernel.block.Block` takes them: at least one.
    thresholds : dict of str to float
        Thresholds of the verdicts that an axis says, by name.
    """

    parameters: Parameters
    lanes: dict[str, Any]
    thresholds: dict[str, float]


def is_kind(name: str) -> bool:
    """Return whether the cells of an axis have kinds."""
    return name == MODEL or name.startswith(THRESHOLD)


def number_of(name: str, value: object) -> float:
    """Return a value of an axis as a number; a model may be a name.

    Raises
    ------
    ParameterError
        For a model that there is not.
    ValueError
        For what is no number.
    """
    if name != MODEL:
        return float(value)  # type: ignore[arg-type]  # what float() takes
    if value in MODELS:
        return float(MODEL_NAMES.index(str(value)))
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        number = -1.0
    if not (number == int(number) and 0 <= number < len(MODEL_NAMES)):
        raise ParameterError(f"model = {value!r}: should be one of {', '.join(MODEL_NAMES)}")
    return number


def value_text(name: str, value: float, form: str = ".4g") -> str:
    """Return a value of an axis as text: a model by its name. `form` is as of `format`, or "r" for all digits."""
    if name == MODEL:
        return model_name(value)
    return repr(float(value)) if form == "r" else format(float(value), form)


def model_name(number: float) -> str:
    """Return the name of a model."""
    return MODEL_NAMES[int(number)]


def labels(name: str, values: ArrayLike) -> NDArray[Any]:
    """Return the values of an axis as people read them: names of models, or the numbers themselves."""
    numbers = np.asarray(values)
    return np.array([model_name(number) for number in numbers.tolist()]) if name == MODEL else numbers


def common(parameters: Parameters, lanes: Mapping[str, ArrayLike]) -> Common:
    """Return what some cells have in common, and what differs between them.

    Raises
    ------
    ParameterError
        Where the cells are of several kinds.
    """
    own = {name: np.unique(np.asarray(values)) for name, values in lanes.items() if is_kind(name)}
    for name, values in own.items():
        if len(values) != 1:
            raise ParameterError(f"lanes.{name}: {len(values)} values in one block: should be one")
    kept: dict[str, Any] = {name: values for name, values in lanes.items() if name not in own}
    if MODEL in own:
        parameters = parameters.replace(model=model_name(own[MODEL][0]))
    if own and not kept:
        kept = {"f_asym": np.full(len(np.asarray(next(iter(lanes.values())))), parameters.f_asym)}
    thresholds = {name.removeprefix(THRESHOLD): float(values[0]) for name, values in own.items() if name != MODEL}
    return Common(parameters, kept, thresholds)


def with_values(parameters: Parameters, values: Mapping[str, float]) -> Parameters:
    """Return parameters with the values of the axes at one cell; thresholds are left out."""
    changes: dict[str, Any] = {name: value for name, value in values.items() if not is_kind(name)}
    if MODEL in values:
        changes[MODEL] = model_name(values[MODEL])
    return parameters.replace(**changes)


def kinds_of(values: Mapping[str, NDArray[np.float64]]) -> NDArray[np.int64] | None:
    """Return a number for the kind of each cell, (cells,), from the values of the axes; None where all are of one."""
    own = [np.unique(each, return_inverse=True)[1] for name, each in values.items() if is_kind(name)]
    if not own:
        return None
    kinds = np.zeros(len(own[0]), np.int64)
    for each in own:
        kinds = kinds * (int(each.max()) + 1) + each
    return kinds


def in_order(words: Iterable[object]) -> tuple[float, ...]:
    """Return models as numbers, in the order of the hierarchy, each once.

    Raises
    ------
    ParameterError
        For a model that there is not.
    """
    return tuple(
        sorted({number_of(MODEL, word.strip().strip("'\"") if isinstance(word, str) else word) for word in words})
    )
