"""Symbols and units on axes and in captions."""

import pytest
from matplotlib.mathtext import MathTextParser

from bow_sim.physics.body import KINDS
from bow_sim.physics.instruments import SI
from bow_sim.physics.parameters import SWEEPABLE
from bow_sweep.figures.symbols import _TABLE, label, plain, symbol_of

SYMBOLS = sorted({*SWEEPABLE, *SI, *(f"body_3_{kind}" for kind in KINDS)})


@pytest.mark.parametrize("name", SYMBOLS)
def test_every_parameter_that_can_be_an_axis_has_a_symbol_that_can_be_drawn(name: str) -> None:
    symbol = symbol_of(name)
    assert name in _TABLE or "b3" in symbol.tex
    MathTextParser("path").parse(label(symbol, words=True))
    assert not set(plain(label(symbol, words=True))) & set("$\\{}")
    assert "_" not in symbol.words


def test_no_two_parameters_have_the_same_symbol_but_in_another_system_of_units() -> None:
    by_symbol: dict[str, list[str]] = {}
    for name in SYMBOLS:
        by_symbol.setdefault(symbol_of(name).tex, []).append(name)
    shared = sorted(names for names in by_symbol.values() if len(names) > 1)
    assert shared == [["acceleration", "bow_acceleration"], ["speed", "v_b"]]


def test_the_unit_of_force_is_that_of_the_conversion_to_newton() -> None:
    from bow_sim.physics.parameters import Parameters

    p = Parameters.from_mapping({"string": "violin_a", "v_unit": 0.1})
    newton = SI["force"].convert(2 * p.z_0 * 0.1, vars(p))
    assert newton == pytest.approx(1.0)
    assert symbol_of("f_asym").unit == "$2 Z_0 v_b$"


@pytest.mark.parametrize(
    ("name", "settings", "moving", "unit"),
    [
        ("f_asym", ["y_t=3.0"], (), "$3 Z_0 v_b$"),
        ("f_asym", ["v_b=0.5"], (), "$2 Z_0 V$"),
        ("f_asym", [], ("y_t",), "$Y_T Z_0 v_b$"),
        ("f_asym", [], ("v_b",), "$2 Z_0 V$"),
        ("acceleration", ["gesture=guettler"], (), "$V/T$"),
        ("acceleration", ["gesture=accelerate_to"], (), "$v_b/T$"),
        ("v_mid", [], (), "$v_b$"),
        ("v_b", [], ("v_b",), "$V$"),
        ("force", [], (), "N"),
    ],
)
def test_units_are_those_of_the_sweep(name: str, settings: list[str], moving: tuple[str, ...], unit: str) -> None:
    assert symbol_of(name, settings, moving).unit == unit


def test_an_unknown_name_is_its_own_symbol() -> None:
    assert label(symbol_of("unheard_of"), words=True) == r"$\mathrm{unheard\ of}$"


def test_axes_of_thresholds_and_models_have_titles_too() -> None:
    assert plain(label(symbol_of("classifier.corner"), words=True)) == "threshold of the classifier: corner"
    assert label(symbol_of("model")) == label(symbol_of("model"), words=True) == "model of the string"


def test_plain_text_has_no_tex() -> None:
    assert plain(label(symbol_of("bow_acceleration"), words=True)) == "acceleration of the bow a (m/s²)"
    assert plain(r"$\tau_f$ = 400 samples, $\beta N$") == "τ_f = 400 samples, βN"
