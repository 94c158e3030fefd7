"""Which settings have an effect in a model, and what a user should know of a combination of settings.

A setting without effect is no error by itself, as every setting has a value. But a map over it would show nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

from bow_sim.physics.body import LEFT_OUT, left_out, mode_setting, modes_of, slot
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.instruments import BRIDGES, NEEDS, SI
from bow_sim.physics.kinds import with_values
from bow_sim.physics.parameters import FIELDS, FRICTIONS, GESTURES, SUSTAINED, TORSION_REFLECTED, Parameters
from bow_sim.physics.reflection import CREMER, ends

LONGEST_STEP = 40e-6
"""Seconds between two samples at most with thermal friction, whose contact warms within a few samples (PHYSICS.md
section 13)."""


class Condition(NamedTuple):
    """Settings that have an effect only under a condition.

    Parameters
    ----------
    names : tuple of str
    needs : str
        The condition in words: what would be right.
    holds : callable
        Returns whether it holds for `Parameters`, and the names of the settings that differ between cells.
    choice : tuple of str and of tuple of str
        Where it is that a setting with names has one of some: that setting, and these names; ("", ()) for others.
    """

    names: tuple[str, ...]
    needs: str
    holds: Callable[[Parameters, frozenset[str]], bool]
    choice: tuple[str, tuple[str, ...]] = ("", ())


def _one_of(names: Iterable[str]) -> str:
    return f"model={' or '.join(names)}"


def _in_si(p: Parameters, swept: frozenset[str]) -> bool:
    """Return whether something beside the string has a time or an impedance of its own: body, bow hair, rosin."""
    return _has_body(p) or p.hair_r > 0 or "hair_r" in swept or p.friction == "thermal"


_ABSORBED = ("torsion_absorbed", *TORSION_REFLECTED)
_ROUNDED = ("rounded_corner", *TORSION_REFLECTED)
_ACCELERATED = ("guettler", "accelerate_to")
_BODY = "a body: body=NAME, or body_modes=f/Q/m, ..."
_THERMAL = "friction=thermal, with string=NAME and v_unit=NUMBER in m/s"

CONDITIONS = (
    Condition(
        ("sample_rate",),
        "what has a time in seconds: body=NAME, hair=NAME or friction=thermal, with string=NAME; or bow_acceleration "
        "as the other axis",
        lambda p, swept: _in_si(p, swept) or "bow_acceleration" in swept,
    ),
    Condition(
        ("z_0",),
        "what has an impedance in kg/s: body=NAME, hair=NAME or friction=thermal; or force as the other axis",
        lambda p, swept: _in_si(p, swept) or "force" in swept,
    ),
    Condition(
        ("v_unit",),
        f"{_THERMAL}; or force, speed, v_0 or bow_acceleration as the other axis",
        lambda p, swept: (
            p.friction in ("thermal", "curve") or bool(swept & {"force", "speed", "v_0", "bow_acceleration"})
        ),
    ),
    Condition(
        ("string_length",),
        "bow_distance as the other axis; other settings do not depend on it",
        lambda p, swept: "bow_distance" in swept,
    ),
    Condition(
        ("f_init_ratio",),
        "a gesture whose force has a beginning: all but gesture=string_crossing",
        lambda p, _: p.gesture != "string_crossing",
        ("gesture", tuple(name for name in GESTURES if name != "string_crossing")),
    ),
    Condition(
        ("tau_f",),
        "a bow force that changes: f_init_ratio other than 1 or sustained above 0 (or one of them as the other axis), "
        "or gesture=string_crossing",
        lambda p, swept: (
            p.gesture == "string_crossing"
            or p.f_init_ratio != 1
            or p.sustained > 0
            or bool(swept & {"f_init_ratio", "sustained"})
        ),
    ),
    Condition(
        ("sustained",),
        f"gesture={' or '.join(SUSTAINED)}",
        lambda p, _: p.gesture in SUSTAINED,
        ("gesture", SUSTAINED),
    ),
    Condition(("hair_r",), NEEDS["z_0"], lambda p, swept: p.z_0 > 0 or "z_0" in swept),
    Condition(
        ("hair_k",),
        "bow hair: hair=NAME, or hair_r=NUMBER in kg/s",
        lambda p, swept: p.hair_r > 0 or "hair_r" in swept,
    ),
    Condition(
        ("rosin_t_g", "rosin_hot", "rosin_heat", "rosin_flow", "rosin_rest", "ribbon_width"),
        _THERMAL,
        lambda p, _: p.friction == "thermal",
        ("friction", ("thermal",)),
    ),
    Condition(
        ("mu_d",),
        "friction=hyperbola or coulomb",
        lambda p, _: p.friction in ("hyperbola", "coulomb"),
        ("friction", ("hyperbola", "coulomb")),
    ),
    Condition(
        ("v_mid",),
        "friction=hyperbola",
        lambda p, _: p.friction == "hyperbola",
        ("friction", ("hyperbola",)),
    ),
    Condition(
        ("mu_s",),
        "a friction law without a curve of its own",
        lambda p, _: p.friction != "curve",
        ("friction", tuple(name for name in FRICTIONS if name != "curve")),
    ),
    Condition(("body_scale",), _BODY, lambda p, _: _has_body(p)),
    Condition(("torsion_admittance",), _one_of(_ABSORBED), lambda p, _: p.model in _ABSORBED, ("model", _ABSORBED)),
    Condition(
        ("torsion_speed", "torsion_width", "torsion_gain"),
        _one_of(TORSION_REFLECTED),
        lambda p, _: p.model in TORSION_REFLECTED and not (p.torsion_bridge_function and p.torsion_nut_function),
        ("model", TORSION_REFLECTED),
    ),
    Condition(("torsion_half",), _one_of(_ROUNDED), lambda p, _: p.model in _ROUNDED, ("model", _ROUNDED)),
    Condition(
        ("bridge_r", "bridge_w_c"),
        f"{_one_of(CREMER)}, without a bridge_function",
        lambda p, _: p.model in CREMER and not p.bridge_function,
        ("model", tuple(CREMER)),
    ),
    Condition(
        ("stiffness_b", "nut_cutoff", "nut_power"),
        "model=stiff_cremer, without a nut_function",
        lambda p, _: p.model == "stiff_cremer" and not p.nut_function,
        ("model", ("stiff_cremer",)),
    ),
    Condition(("nut_gain", "bridge_gain"), "model=raman", lambda p, _: p.model == "raman", ("model", ("raman",))),
    Condition(
        ("corner_width",),
        "model=rounded_corner",
        lambda p, _: p.model == "rounded_corner",
        ("model", ("rounded_corner",)),
    ),
    Condition(("tau_v",), "gesture=martele", lambda p, _: p.gesture == "martele", ("gesture", ("martele",))),
    Condition(
        ("acceleration",),
        "gesture=guettler or accelerate_to",
        lambda p, _: p.gesture in _ACCELERATED,
        ("gesture", _ACCELERATED),
    ),
)
"""What settings need; those of single modes are checked by :mod:`bow_sim.physics.body`."""

EXTRAS = ("hair_", "rosin_", "ribbon_", "body_", "tau_v", "acceleration")
"""Beginnings of settings that nobody gives without meaning them; others come with the preset of a string, too."""


def check_axes(p: Parameters, names: Iterable[str]) -> None:
    """Raise an error if a setting that differs between the cells of a map has no effect in them.

    Parameters
    ----------
    p : Parameters
        What all cells share.
    names : iterable of str
        The settings along x and y.

    Raises
    ------
    ParameterError
        Naming axis and setting, and what it needs.
    """
    axes = dict(zip("xy", names, strict=False))
    swept = frozenset(axes.values())
    if _never_together(*(_conditions(name) for name in axes.values())):
        both = ", and ".join(
            f"{key}.name = {name!r} needs {' and '.join(c.needs for c in _conditions(name))}"
            for key, name in axes.items()
        )
        raise ParameterError(f"{both}: no cell has both; make a map for each, with another axis beside it")
    unmet = [f"{key}.name = {name!r}: {needs}" for key, name in axes.items() if (needs := _unmet(p, name, swept))]
    if unmet:
        raise ParameterError("; ".join(unmet))


def _conditions(name: str) -> list[Condition]:
    same = SI[name].same if name in SI else name
    return [condition for condition in CONDITIONS if same in condition.names]


def _unmet(p: Parameters, name: str, swept: frozenset[str]) -> str:
    """Return what a setting that differs between cells needs, and has not; "" where it has an effect."""
    if mode_setting(name) and not _has_body(p):
        return f"has no effect here; it needs {_BODY}"
    if mode_setting(name):
        for given in (word.partition("=")[0] for word in p.body_changes.split()):
            if slot(given) == slot(name):
                return f"{given} is given too; give one of them"
    for condition in _conditions(name):
        if not condition.holds(p, swept):
            return f"has no effect here; it needs {condition.needs}"
    for needed in SI[name].needs if name in SI else ():
        if not getattr(p, needed) and needed not in swept:
            return f"is in SI units; it needs {NEEDS[needed]}"
    return ""


def _never_together(one: Iterable[Condition], other: Iterable[Condition]) -> bool:
    """Return whether two settings need different names of the same setting, as two models."""
    return any(
        a.choice[0] and a.choice[0] == b.choice[0] and not set(a.choice[1]) & set(b.choice[1])
        for a in one
        for b in other
    )


def notes(p: Parameters) -> tuple[str, ...]:
    """Return what is allowed, but perhaps not meant, each as a line for the user."""
    found = [
        f"{name} = {getattr(p, name):g}: has no effect here; it needs {condition.needs}"
        for condition in CONDITIONS
        for name in condition.names
        if name.startswith(EXTRAS) and getattr(p, name) != FIELDS[name].default and not condition.holds(p, frozenset())
    ]
    if (missing := left_out(p)) > 0:
        found.append(
            f"body: {missing} mode{'s'[: missing != 1]} above {LEFT_OUT:g} of the sample rate "
            f"({LEFT_OUT * p.sample_rate:.0f} Hz): left out"
        )
    surrogate = BRIDGES["surrogate"]
    bridge = {"bridge_r": p.bridge_r, "bridge_w_c": p.bridge_w_c}
    if bridge == surrogate and p.model in CREMER and not p.bridge_function and modes_of(p) and p.body_scale:
        found.append(
            "body: bridge=surrogate (the default) has the losses of a violin's body already, so the body counts twice; "
            "bridge=rigid leaves all of it to the modes"
        )
    if p.friction == "thermal" and p.sample_rate * LONGEST_STEP < 1:
        f_0 = p.sample_rate / p.period
        found.append(
            f"friction=thermal: {1e6 / p.sample_rate:.0f} us between two samples: should be at most "
            f"{1e6 * LONGEST_STEP:.0f}, as the contact warms within a few samples; "
            f"period={math.ceil(1 / (LONGEST_STEP * f_0))} for {f_0:g} Hz"
        )
    return tuple(found)


def notes_of_map(p: Parameters, x: Any, y: Any) -> tuple[str, ...]:
    """Return the notes of the cells at the corners of a map, each once.

    Parameters
    ----------
    p : Parameters
        What all cells share.
    x, y : Axis
        With `name`, and `tried()`, the values to check with where they stand.
    """
    return tuple(dict.fromkeys(note for _, corner in _corners(p, x, y) for note in notes(corner)))


def check_strings(p: Parameters, x: Any, y: Any) -> None:
    """Raise an error if the reflection functions of the cells at the corners of a map cannot be computed.

    A round trip may be too short for them, which its number of samples alone does not show. Parameters as in
    :func:`notes_of_map`.

    Raises
    ------
    ParameterError
        Naming the corner, and what is too short.
    """
    for where, corner in _corners(p, x, y):
        try:
            ends(corner)
        except ParameterError as error:
            raise ParameterError(f"{where}: {error}") from None


def _corners(p: Parameters, x: Any, y: Any) -> Iterator[tuple[str, Parameters]]:
    for a, x_value in x.tried():
        for b, y_value in y.tried():
            yield f"at x.{a} and y.{b}", with_values(p, {x.name: x_value, y.name: y_value})


def _has_body(p: Parameters) -> bool:
    return p.body != "none" or bool(p.body_modes)
