"""What would do where two parameters cannot make a plane: settings to add, tried before they are named; or a study."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable, Sequence

from bow_sim.physics import body
from bow_sim.physics.errors import ParameterError
from bow_sim.protocol.axis_names import StudyInsteadError, check_name
from bow_sim.protocol.sweep_spec import in_full

_STRING = {"string": "violin_a"}
_UNITS = {**_STRING, "v_unit": "0.1"}
_THERMAL = {"friction": "thermal", **_UNITS}
_BODY = {"body": "signature", **_STRING}

_STIFF_CREMER = {"model": "stiff_cremer"}
_OF_STIFF_CREMER = (
    "torsion_admittance",
    "torsion_speed",
    "torsion_width",
    "torsion_gain",
    "torsion_half",
    "bridge_r",
    "bridge_w_c",
    "stiffness_b",
    "nut_cutoff",
    "nut_power",
)

REMEDIES: dict[str, dict[str, str]] = {
    **dict.fromkeys(("sample_rate", "f_0", "semitone", "z_0", "body_scale"), _BODY),
    **dict.fromkeys(
        ("rosin_t_g", "rosin_hot", "rosin_heat", "rosin_flow", "rosin_rest", "ribbon_width", "v_unit"), _THERMAL
    ),
    "hair_k": {"hair": "hair_soft", **_STRING},
    "hair_r": _STRING,
    "bow_distance": _STRING,
    "force": _UNITS,
    "speed": _UNITS,
    "v_0": {"friction": "hyperbola", **_UNITS},
    "bow_acceleration": {"gesture": "guettler", "sustained": "0", **_UNITS},
    "acceleration": {"gesture": "guettler", "sustained": "0"},
    "tau_v": {"gesture": "martele"},
    "tau_f": {"f_init_ratio": "0.5"},
    "f_init_ratio": {"gesture": "exponential", "sustained": "0"},
    "sustained": {"gesture": "exponential"},
    "nut_gain": {"model": "raman"},
    "bridge_gain": {"model": "raman"},
    "corner_width": {"model": "rounded_corner"},
    **dict.fromkeys(_OF_STIFF_CREMER, _STIFF_CREMER),
    "mu_d": {"friction": "hyperbola"},
    "v_mid": {"friction": "hyperbola"},
    "mu_s": {"friction": "hyperbola"},
}
"""Settings with which a parameter has an effect; those of single modes are as ``body_scale``."""


def would_do(x: str, y: str, works: Callable[[list[str]], object]) -> str:
    """Return a sentence with settings that make a plane of two parameters; "" where none are known.

    Parameters
    ----------
    x, y
        The parameters of the axes.
    works
        Builds the sweep with more settings, "name=value" each; raises ParameterError where it cannot be.
    """
    one, other = (REMEDIES["body_scale"] if body.mode_setting(name) else REMEDIES.get(name, {}) for name in (x, y))
    both = {**one, **other}
    octave = {f"{key}.last": "12" for key, name in (("x", x), ("y", y)) if name == "semitone"}
    # one alone: the other may have an effect already; an octave: higher, the bow's usual places are beyond the string
    for wanted in (both, {**other, **one}, one, other, {**both, **octave}):
        # v_unit is given also where it is an axis: without it, there would be no SI units
        settings = [f"{name}={value}" for name, value in wanted.items() if name not in {x, y} - {"v_unit"}]
        if not settings or not _do(works, settings):
            continue
        for setting in list(settings):  # leave out what is not needed
            fewer = [each for each in settings if each != setting]
            if fewer and _do(works, fewer):
                settings = fewer
        return f"; with the settings {' '.join(settings)} it can be computed"
    return ""


def study_instead(reason: str, preset: str, lines: Sequence[str], axes: Iterable[tuple[str, str]]) -> str:
    """Return a refusal with the whole command of a study in the place of its beginning.

    Parameters
    ----------
    reason
        Why a parameter cannot be an axis.
    preset, lines
        The sweep that was asked for: the study has the same settings but those of that axis.
    axes
        The key, "x" or "y", and the parameter of each axis.
    """
    overs, dropped, command = [], [], ""
    for key, name in axes:
        try:
            check_name(key, name)
        except StudyInsteadError as error:
            overs.append(_values(key, lines) or error.over)
            dropped.append(key)
            command = error.command if reason == str(error) else command
        except ParameterError:
            pass
    if not command:
        return reason
    kept = [line for line in lines if _name(line).partition(".")[0] not in dropped]
    if any(over.startswith(("seed=", "jitter=")) for over in overs) and "repeats" not in {_name(line) for line in kept}:
        kept.append("repeats=8")  # without repeats neither has an effect
    words = ["bow", "study", *([preset] if preset else [])]
    words += [word for line in kept for word in ("--set", line)] + [word for over in overs for word in ("--over", over)]
    return reason.removesuffix(command) + shlex.join(words)


def _name(line: str) -> str:
    return in_full(line.partition("=")[0].strip())


def _values(key: str, lines: Sequence[str]) -> str:
    """Return what a sweep says of the values of an axis as after `bow study --over`; "" where it does not."""
    given = {_name(line): line.partition("=")[2].strip() for line in lines}
    name = given.get(f"{key}.name", "")
    if values := given.get(f"{key}.values", "").strip("[]").replace(" ", ""):
        return f"{name}={values}"
    span = [given.get(f"{key}.{part}", "") for part in ("first", "last", "count")]
    return f"{name}={':'.join(span)}" if all(span) else ""


def _do(works: Callable[[list[str]], object], settings: list[str]) -> bool:
    try:
        works(settings)
    except ParameterError:
        return False
    return True
