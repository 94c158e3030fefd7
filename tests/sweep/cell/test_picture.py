"""A cell as a picture, and as words."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bow_sim.figures.page import FigureError
from bow_sweep.cell.picture import draw_cell, picture
from bow_sweep.cell.portrait import Portrait
from bow_sweep.cell.run_cells import RunCells


@pytest.fixture(scope="module")
def portrait(recorded: Path) -> Portrait:
    with RunCells(recorded) as cells:
        return Portrait.of(cells.record(6))


def test_a_picture_shows_all_parts_with_the_cells_data(portrait: Portrait, tmp_path: Path) -> None:
    figure = picture(portrait)
    assert len(figure.axes) == 7
    line = figure.axes[0].lines[0].get_ydata()
    assert np.array_equal(line, portrait.record.bridge_force)
    bars = figure.axes[0].collections[0].get_paths()
    assert len(bars) == len(portrait.record.onsets)
    draw_cell(tmp_path / "cell.png", portrait)
    assert (tmp_path / "cell.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(FigureError, match=r"cell\.bmp"):
        draw_cell(tmp_path / "cell.bmp", portrait)


def test_a_cell_without_verdicts_or_period_can_be_drawn(portrait: Portrait) -> None:
    tests = portrait.record.tests
    nothing = replace(
        tests, regime=np.full_like(tests.regime, 255), period=np.full_like(tests.period, np.nan),
        confidence=np.full_like(tests.confidence, np.nan),
    )  # fmt: skip
    record = replace(portrait.record, tests=nothing, transient_periods=float("nan"))
    bare = replace(portrait, record=record, period=None, harmonics=None)
    picture(bare)
    facts = dict(bare.facts())
    assert facts["regime at the end"] == "pending"
    assert facts["pitch at the end"] == "none: not periodic near the nominal period"
    assert "not done in the run" in facts["transient"]


def test_the_words_say_parameters_regime_pitch_and_what_was_checked(portrait: Portrait) -> None:
    facts = dict(portrait.facts())
    assert facts["f_asym"].startswith(f"{portrait.record.x:.6g}")
    assert facts["waveform"] == "from the bag"
    assert facts["checked"].startswith("yes: ")
    assert "velocities" not in facts
    other = replace(portrait, motion=replace(portrait.motion, same=False))
    assert "another motion" in dict(other.facts())["velocities"]
