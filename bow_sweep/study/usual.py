"""Values that a study or a search gives a parameter of which only the name is said: those of its usual axis."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.kinds import MODEL, MODEL_NAMES, THRESHOLD
from bow_sim.physics.parameters import TYPES
from bow_sim.physics.usual_axes import Span, span
from bow_sim.protocol.axis_names import check_name
from bow_sim.protocol.sweep_spec import Axis
from bow_sweep.plan.axes import THRESHOLDS, of_threshold
from bow_sweep.plan.sweep import Sweep
from bow_sweep.study.over import OVER_FORM, PRESET, RANGE_FORM, Over, Range, over_of, range_of

COUNT = 6
"""Values of a parameter of which only the name is said."""


def overs_of(preset: str, settings: Sequence[str], texts: Sequence[str]) -> tuple[Over, ...]:
    """Return the values that a study gives its further parameters.

    Parameters
    ----------
    preset, settings
        What all maps have in common. A usual axis may depend on it, and on the first values of the other parameters.
    texts
        As after `bow study --over`: ``NAME=FIRST:LAST:COUNT``, ``NAME=VALUE,VALUE``, or ``NAME`` for `COUNT` values
        along the usual axis.

    Raises
    ------
    ParameterError
        Where a text says no values; names what would be right.
    """
    found = {text: over_of(text) for text in texts if not _is_name(text)}
    if len(found) < len(texts):
        base = _base(preset, settings, found.values())
        found |= {text: _usual_over(text.strip(), base) for text in texts if text not in found}
    return tuple(found[text] for text in texts)


def ranges_of(preset: str, settings: Sequence[str], texts: Sequence[str]) -> tuple[Range, ...]:
    """Return the ranges of a search, as after `bow optimise --over`; a name alone has the range of its usual axis.

    Raises
    ------
    ParameterError
        Where a text says no range; names what would be right.
    """
    if not any(map(_is_name, texts)):
        return tuple(map(range_of, texts))
    base = _base(preset, settings, ())
    return tuple(_usual_range(text.strip(), base) if _is_name(text) else range_of(text) for text in texts)


def _is_name(text: str) -> bool:
    return bool(text.strip()) and "=" not in text


def _base(preset: str, settings: Sequence[str], given: Iterable[Over]) -> Sweep:
    first = {over.name: over.values[0] for over in given}
    settings = [*settings, *(f"{name}={value}" for name, value in first.items() if name != PRESET)]
    return Sweep.from_spec(first.get(PRESET, preset), settings)


def _usual_over(name: str, base: Sweep) -> Over:
    if name == MODEL:
        return Over(MODEL, MODEL_NAMES)
    usual = _usual_span(name, base, OVER_FORM)
    numbers = Axis(name, usual.scale, usual.first, usual.last, COUNT).values().tolist()
    if TYPES.get(name) is int:
        return Over(name, tuple(str(value) for value in sorted({round(number) for number in numbers})))
    return Over(name, tuple(map(repr, numbers)), usual.scale)


def _usual_range(name: str, base: Sweep) -> Range:
    usual = _usual_span(name, base, RANGE_FORM)
    return Range(name, usual.first, usual.last, usual.scale)


def _usual_span(name: str, base: Sweep, form: str) -> Span:
    threshold = name.removeprefix(THRESHOLD)
    if name.startswith(THRESHOLD):
        if threshold not in THRESHOLDS:
            raise ParameterError(f"--over {name}: no such threshold; one of {', '.join(THRESHOLDS)}")
        return of_threshold(threshold)
    middle = {axis.name: float(axis.values()[axis.count // 2]) for axis in (base.x, base.y)}
    try:
        check_name("--over", name)
        return span(name, "--over", base.parameters, middle)
    except ParameterError as error:  # the reason is that of an axis, after "--over.name = 'NAME': "
        reason = str(error).partition(": ")[2].replace("cannot be swept: ", "")
        raise ParameterError(f"--over {name}: has no usual values: {reason}; or give {form}") from None
