r"""The caption of a figure: what it shows, which string and gesture, and everything that is the same in all cells.

Texts have TeX between dollar signs, as Matplotlib draws it: ``$\mu_s = 0.8$``. A caption is plain text, or LaTeX.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence

from bow_sweep.figures.layers import AT_A_TEST, LAYERS, LayerError, Panel
from bow_sweep.figures.symbols import DASHED, plain, speed_unit, symbol_of
from bow_sweep.maps.held_fixed import Held, gesture_of, held_fixed, in_the_other_system, moving, string_of
from bow_sweep.maps.limit_lines import drawn
from bow_sweep.maps.limits import FORMULAS as PLAIN_FORMULAS
from bow_sweep.maps.limits import TITLES, limits, why_no_bounds
from bow_sweep.maps.map_file import MapFile
from bow_sweep.maps.plane import Plane
from bow_sweep.maps.reliability import RELIABLE

MARKUPS = ("plain", "latex")

FORMULAS = {
    "schelleng_max": r"$F_\mathrm{max} = v_b/(Y \beta \Delta\mu)$",
    "schelleng_min": (
        r"$F_\mathrm{min} = 2 v_b Z_0/(\pi^2 \beta^2 \Delta\mu)"
        r" \left(\max_t \mathrm{Re} \sum (-1)^{n+1} Y_n e^{i n \omega_0 t}/n^2 + \mathrm{Re} \sum Y_n/n^2\right)$"
    ),
    "raman": r"$F_\mathrm{min} = v_b Z_0^2/(2 R \beta^2 \Delta\mu)$",
    "guettler_low": (
        r"$a_\mathrm{low} = \beta (1-\beta) F (3 \mu_s - \mu_d - 2 \sqrt{2 \mu_s^2 - \mu_s \mu_d})/(T Z_0)$"
    ),
    "guettler_high": (
        r"$a_\mathrm{high} = \beta (1-\beta) F ((3-4 \beta) \mu_s - \mu_d"
        r" - 2 \sqrt{(1-2 \beta) (2 (1-\beta) \mu_s^2 - \mu_s \mu_d)})/((1-2 \beta) T Z_0)$"
    ),
}
"""The formulas of `bow_sweep.maps.limits.FORMULAS` (PHYSICS.md 9, 11, 14) in TeX."""

_WORDS = {
    "dmu": r"\Delta\mu", "mu_s": r"\mu_s", "mu_d": r"\mu_d", "mu": r"\mu", "mu_s-mu": r"\mu_s - \mu", "pi": r"\pi",
    "beta": r"\beta", "v_b": "v_b", "Z_0": "Z_0", "Y_T": "Y_T", "w_0": r"\omega_0", "K/R": "K/R", "Y": "Y", "R": "R",
    "T": "T",
}  # fmt: skip
"""Symbols in the plain text of what goes into a limit, to TeX."""


GESTURES = {
    "martele": "martel\u00e9",
    "string_crossing": "string crossing",
    "accelerate_to": "bow speed rising to $v_b$",
    "constant_acceleration": "bow speed rising to $v_b$",
    "guettler": "bow with constant acceleration",
}
"""The gestures (`bow_sim.physics.parameters.GESTURES`) in words; one has its name in older maps."""


def gesture_text(plane: Plane) -> str:
    """Return the gesture of a map; "" for the usual one, whose force goes exponentially to its end."""
    gesture = gesture_of(plane)
    return GESTURES.get(gesture.replace(" ", "_"), gesture)


def held_text(held: Held, plane: Plane) -> str:
    r"""Return a setting that all cells share: ``$\mu_s = 0.8$``, with the value in SI units where there is one."""
    name, value, beside = held.name, held.text, held.beside
    known = symbol_of("beta" if name == "bow_bridge" else name, plane.values, moving(plane))
    if beside and name in _IN_SI:
        return f"${_IN_SI[name]} = {_number(beside)}"
    if known.tex.startswith(r"\mathrm{"):  # a setting that is no number: friction: thermal
        return f"{name.replace('_', ' ')}: {value.replace('_', ' ')}"
    unit = f" {known.unit}" if known.unit and name != "bow_bridge" else ""
    return rf"${known.tex} = {_number(value)}{unit}" + (f" ({beside})" if beside else "")


_IN_SI = {"v_b": "v_b", "sample_rate": "f_0", "v_mid": "v_0", "acceleration": "a"}
"""Settings that are given in SI units where that is possible, and their symbols there."""


def _number(text: str) -> str:
    r"""Return a number with its unit, TeX within an open formula that it closes: ``5\times10^{-5}$ m``."""
    value, _, unit = text.partition(" ")
    found = re.fullmatch(r"(-?)([0-9.]+)e([+-][0-9]+)", value)
    if found:
        head = "" if found[2] == "1" else rf"{found[2]}\times"
        value = rf"{found[1]}{head}10^{{{int(found[3])}}}"
    return f"{value}$ {unit}".rstrip()


def held_texts(plane: Plane) -> list[str]:
    """Return every setting that all cells of a map share and that decides what it shows, v_mid first."""
    found = sorted(held_fixed(plane), key=lambda held: held.name != "v_mid")
    return [held_text(held, plane) for held in found if not _said_elsewhere(held, plane)]


def _said_elsewhere(held: Held, plane: Plane) -> bool:
    """Return whether a setting is part of the units, v_b = 1 and Y_T = 2, or has no meaning for the gesture."""
    if held.name == "v_b" and plane.values.get("gesture") == "guettler":
        return True
    unit = (held.name == "v_b" and not held.beside) or held.name == "y_t"
    return unit and held.text == {"v_b": "1", "y_t": "2"}[held.name]


def units_text(plane: Plane) -> str:
    """Return what the unit of force or speed is in SI units, where a map has the paper's and this is known; else ""."""
    texts = []
    names = (plane.x_name, plane.y_name)
    moved = moving(plane)
    for name in ("f_asym", "acceleration"):
        same = {"f_asym": "force", "acceleration": "bow_acceleration"}[name]
        if name in names or same in names:
            other = in_the_other_system(plane, name, 1.0)
            if other:
                value, _, unit = other.partition(" ")
                inside = symbol_of(name, plane.values, moved).unit.strip("$")
                texts.append(rf"${inside} = {value}$ {symbol_of(same).unit or unit}")
    if speed_unit(plane.values, moved) == "V" and (value := plane.values.get("v_unit", "0.0")) not in ("0.0", "0"):
        texts.append(rf"$V = {float(value):g}$ m/s")
    return ", ".join(texts)


def made_texts(plane: Plane) -> list[str]:
    """Return the grid and the length of the simulations, and how cells were chosen or repeated."""
    ny, nx = plane.shape
    made = [rf"${nx} \times {ny}$ gestures", f"{plane.periods:g} periods each"]
    if "adaptive" in plane.values:
        made.append(f"{100 * float(plane.values['adaptive']):.1f} % simulated at most, the rest predicted")
    if "repeats" in plane.values:
        made.append(f"{plane.values['repeats']} repeats of each")
    return made


def limit_texts(plane: Plane) -> list[str]:
    """Return the limits of theory over a map: formulas, inputs, and which lie outside of the axes."""
    found = limits(plane)
    inside = {each.limit.name for each in drawn(plane)}
    same = len({each.inputs for each in found}) == 1
    texts = [mathematics(why)] if (why := why_no_bounds(plane)) else []
    for each in found:
        broken = " (broken line)" if each.name in DASHED else ""
        words = TITLES[each.name] + (broken if each.name in inside else " lies outside of the axes")
        inputs = f", {mathematics(each.inputs)}" if not same or each is found[-1] else ""
        texts.append(f"{words}: {mathematics(each.formula)}{inputs}")
    return texts


def mathematics(text: str) -> str:
    r"""Return a formula, or what goes into it, in TeX: "mu_s = 0.8" gives "$\mu_s$ = 0.8"."""
    for formula, tex in FORMULAS.items():
        if text == PLAIN_FORMULAS[formula]:
            return tex
    return _symbols_in(text)


def _symbols_in(text: str) -> str:
    """Return a formula that is plain text with its symbols in TeX."""
    words = "|".join(re.escape(word) for word in sorted(_WORDS, key=len, reverse=True))
    return re.sub(rf"(?<![\w$\\])({words})(?!\w)", lambda found: f"${_WORDS[found[1]]}$", text)


def in_plain_text(text: str) -> str:
    """Return a text, which may have formulas of `FORMULAS`, without TeX."""
    for formula, tex in FORMULAS.items():
        text = text.replace(tex, _symbols_in(PLAIN_FORMULAS[formula]).replace("^2", "\u00b2"))
    return plain(text)


def wrapped_limits(plane: Plane, width: int) -> list[str]:
    """Return :func:`limit_texts` as plain text in lines of at most `width` letters, where words allow it.

    Drawing the formulas would take a fifth of the time of the whole picture.
    """
    return [
        line
        for text in limit_texts(plane)
        for line in textwrap.wrap(in_plain_text(text), width, break_long_words=False, break_on_hyphens=False,
                                  subsequent_indent="    ")
    ]  # fmt: skip


def layer_text(panel: Panel) -> str:
    """Return what a panel shows, a sentence without its end."""
    plane, layer = panel.plane, panel.layer
    words = LAYERS[layer]
    if layer == "transient":
        return f"transient length, {words} (black: never)"
    if layer in AT_A_TEST:
        return f"{words} after {panel.periods or plane.test_periods[-1]:g} periods"
    if layer == "terrain":
        return "terrain after Schumacher and Woodhouse (1995), section IV.B"
    if layer == "reliability":
        off = f"forces up to {100 * float(plane.values.get('jitter', 'nan')):.4g} % off"
        line = f"lines surround cells of which at least {100 * RELIABLE:.0f} % do"
        return f"share of {plane.values.get('repeats', '?')} repeats, {off}, that end as the cell itself; {line}"
    return words


def caption(panels: Sequence[Panel], markup: str = "plain") -> str:
    """Return the caption of a figure.

    Parameters
    ----------
    panels
        Of the figure.
    markup
        One of `MARKUPS`.

    Raises
    ------
    ValueError
        For another markup.
    """
    if markup not in MARKUPS:
        raise ValueError(f"markup {markup!r}: should be one of {', '.join(MARKUPS)}")
    of_panel = [_facts(panel.plane) for panel in panels]
    common = [fact for fact in of_panel[0] if all(fact in facts for facts in of_panel)]
    sentences = []
    same_layer = len({layer_text(panel) for panel in panels}) == 1
    if same_layer:
        sentences.append(layer_text(panels[0]))
    for number, (panel, facts) in enumerate(zip(panels, of_panel, strict=True)):
        own = [fact for fact in facts if fact not in common]
        words = ([] if same_layer else [layer_text(panel)]) + ([", ".join(own)] if own else [])
        if len(panels) > 1 and words:
            sentences.append(f"({chr(ord('a') + number)}) {': '.join(words)}")
    if common:
        sentences.append(
            ("" if len(panels) == 1 else "all panels: " * (len(common) < len(of_panel[0]))) + ", ".join(common)
        )
    sentences += dict.fromkeys(text for panel in panels for text in limit_texts(panel.plane))
    text = " ".join(f"{_capital(sentence)}." for sentence in sentences)
    return latex(text) if markup == "latex" else in_plain_text(text)


def what_differs(planes: Sequence[Plane]) -> list[str]:
    """Return a short title for each of several maps: what of string, gesture and settings is not the same in all."""
    facts = [[text for text in _facts(plane) if not text.startswith(_LONG)] for plane in planes]
    common = [fact for fact in facts[0] if all(fact in each for each in facts)]
    own = [[fact for fact in each if fact not in common] for each in facts]
    return [", ".join(fact.replace(" string", "") for fact in each) for each in own]


_LONG = ("friction curve", "body modes", "body changes")
"""Beginnings of texts that are too long for a title."""


def _facts(plane: Plane) -> list[str]:
    gesture = gesture_text(plane)
    units = units_text(plane)
    return [*filter(None, (string_of(plane), gesture)), *held_texts(plane), *filter(None, (units,)), *made_texts(plane)]


def _capital(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]


def latex(text: str) -> str:
    """Return text with TeX between dollar signs as LaTeX: special characters outside of formulas are escaped."""
    pieces = text.split("$")
    outside = [re.sub(r"([%&#_])", r"\\\1", piece).replace(" ... ", r" \dots{} ") for piece in pieces[::2]]
    made = [piece for pair in zip(outside, [*pieces[1::2], ""], strict=True) for piece in pair]
    return "".join(piece if number % 2 == 0 else f"${piece}$" for number, piece in enumerate(made[:-1]))


def titled(
    planes: Sequence[MapFile], layers: Sequence[str], periods: float | None = None, titles: Sequence[str] = ()
) -> list[Panel]:
    """Return a panel for every layer of every map, the layers of a map beside each other.

    Parameters
    ----------
    periods
        Time of the test, for the layers that have one.
    titles
        Of the panels, in their order; () for what differs between the maps.

    Raises
    ------
    LayerError
        For another number of titles, or a time where no layer has a test.
    """
    made = [(plane, layer) for plane in planes for layer in layers]
    if titles and len(titles) != len(made):
        raise LayerError(f"{len(titles)} titles given: should be one for each of the {len(made)} panels")
    if periods is not None and not set(AT_A_TEST) & set(layers):
        raise LayerError(
            f"periods = {periods:g}: layer {', '.join(layers)} is of all tests together; leave it out, or take one of "
            f"{', '.join(AT_A_TEST)}"
        )
    words = list(titles) or [text for text in what_differs(planes) for _ in layers]
    return [
        Panel(plane, layer, periods if layer in AT_A_TEST else None, title)
        for (plane, layer), title in zip(made, words, strict=True)
    ]
