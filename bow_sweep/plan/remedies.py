"""What would do where two parameters cannot make a plane: settings to add, tried before they are named."""

from __future__ import annotations

from collections.abc import Callable

from bow_sim.physics import body
from bow_sim.physics.errors import ParameterError

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
    for wanted in ({**one, **other}, {**other, **one}):
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


def _do(works: Callable[[list[str]], object], settings: list[str]) -> bool:
    try:
        works(settings)
    except ParameterError:
        return False
    return True
