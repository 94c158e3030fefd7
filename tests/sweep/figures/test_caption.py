"""Captions: what a figure shows, and everything that is the same in all its cells."""

import re
from dataclasses import replace

import pytest
from example_maps import map_file
from matplotlib.mathtext import MathTextParser
from planes import plane_of

from bow_sweep.figures.caption import (
    FORMULAS,
    caption,
    held_texts,
    latex,
    limit_texts,
    titled,
    units_text,
    what_differs,
)
from bow_sweep.figures.layers import Panel
from bow_sweep.maps.limits import FORMULAS as PLAIN_FORMULAS
from bow_sweep.plan.presets import presets


def test_the_papers_map_has_its_settings_in_symbols() -> None:
    assert caption([Panel(map_file(), "regime")]) == (
        "Regime after 100 periods. Stiff/Cremer string, v_mid = 0.2 v_b, τ_f = 400 samples, β = 15/139, µ_s = 0.8, "
        "µ_d = 0.3, 8 × 4 gestures, 100 periods each."
    )
    assert r"$\tau_f = 400$ samples, $\beta = 15/139$" in caption([Panel(map_file())], "latex")


def test_panels_are_told_apart_by_what_differs_and_share_the_rest() -> None:
    other = replace(map_file(), settings=(*map_file().settings, "model=delta_cremer", "v_mid=-2.0"))
    said = caption(titled([map_file(), other], ["transient"]))
    assert "(a) Stiff/Cremer string, v_mid = 0.2 v_b. (b) Delta/Cremer string, v_mid = -2 v_b. All panels: τ_f" in said
    assert what_differs([map_file(), other]) == [
        r"Stiff/Cremer, $v_\mathrm{mid} = 0.2$ $v_b$",
        r"Delta/Cremer, $v_\mathrm{mid} = -2$ $v_b$",
    ]
    layers = caption(titled([map_file()], ["transient", "terrain"]))
    assert layers.startswith("(a) transient length, periods until Helmholtz motion (black: never). (b) terrain after")


@pytest.mark.full
@pytest.mark.parametrize("preset", sorted(presets()))
def test_every_text_of_every_preset_can_be_drawn_and_has_no_name_of_a_setting(preset: str) -> None:
    plane = plane_of(preset)
    parser = MathTextParser("path")
    for text in [
        *held_texts(plane),
        *limit_texts(plane),
        units_text(plane),
        *what_differs([plane, plane_of("fig11c")]),
    ]:
        parser.parse(text)
    plain = re.sub(r"\$[^$]*\$", "", " ".join(held_texts(plane)))
    assert not re.search(r"[a-z]_[a-z]", plain), plain


def test_a_real_string_has_si_units_and_says_what_the_units_of_the_paper_are() -> None:
    plane = plane_of("schelleng_cello")
    said = held_texts(plane)
    assert {"$v_b = 0.1$ m/s", "$f_0 = 98$ Hz", "$Z_0 = 1.059$ kg/s", "friction: thermal"} <= set(said)
    assert units_text(plane) == "$2 Z_0 v_b = 0.2118$ N"
    guettler = plane_of("guettler_cello")
    assert units_text(guettler) == "$2 Z_0 V = 0.2234$ N, $V/T = 9.8$ m/s$^2$, $V = 0.1$ m/s"
    assert not [text for text in held_texts(guettler) if text.startswith("$v_b")]  # its bow has no final speed
    assert r"$\beta = 21.8429/278$ (55 mm)" in held_texts(guettler)


def test_limits_are_formulas_and_say_which_line_is_broken() -> None:
    most, least = limit_texts(plane_of("schelleng"))
    assert most.startswith(
        "Schelleng's maximum: $F_\\mathrm{max} = v_b/(Y \\beta \\Delta\\mu)$, $Y$ = 1.617, $\\Delta\\mu$"
    )
    assert least.startswith("Schelleng's minimum (broken line): $F_\\mathrm{min} =")
    assert caption([Panel(map_file())]).count("Schelleng") == 0
    assert set(FORMULAS) == set(PLAIN_FORMULAS)


def test_a_plane_without_bounds_says_why() -> None:
    (why,) = limit_texts(plane_of("guettler_cello", "friction=thermal"))
    assert why.startswith("no bounds of Guettler's: they need $\\mu_d$")


def test_latex_escapes_what_is_special_outside_of_formulas() -> None:
    assert latex(r"50 % of a_b & $x_1 = 2$ #3") == r"50 \% of a\_b \& $x_1 = 2$ \#3"


def test_another_markup_is_refused() -> None:
    with pytest.raises(ValueError, match="markup 'html': should be one of plain, latex"):
        caption([Panel(map_file())], "html")
