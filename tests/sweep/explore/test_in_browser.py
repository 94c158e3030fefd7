"""The page in a real browser: what is clicked, drawn and heard is what is in the bag."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import explored
import numpy as np
import pytest
import recording
from browser import Tab

from bow_sim.protocol import cdr
from bow_sweep.cell import analysis
from bow_sweep.cell.cell_record import CellRecord
from bow_sweep.cell.run_cells import RunCells
from bow_sweep.explore.layers import difference_layer, layers_of
from bow_sweep.explore.samples import columns_of
from bow_sweep.explore.saved import save_page
from bow_sweep.maps.map_file import read_map
from bow_sweep.record.bag import messages

pytestmark = pytest.mark.full

NX, NY = 8, 6
PERIOD = 139
PERIODS = 30


def recorded_slips(run: Path, cell: int) -> np.ndarray:
    """Which samples of a cell slip, from the intervals in the bag, (samples,) bool."""
    found = np.zeros(PERIODS * PERIOD, bool)
    for message in messages(run / "bag"):
        if message.topic == "stick_slip":
            values = cdr.unseal("StickSlip", message.data)
            if cell in values["cells"]:
                row = values["cells"].tolist().index(cell)
                own = slice(*values["offsets"][row : row + 2])
                for onset, duration in zip(values["onset"][own], values["duration"][own], strict=True):
                    start = int(values["first_sample"]) + int(onset)
                    found[start : start + int(duration)] = True
    return found


def slipping(tab: Tab, letter: str = "") -> np.ndarray:
    """Which samples slip, from the bars of the page, (samples,) bool."""
    bars = tab.columns(f"slips{letter}")
    out = np.zeros(PERIODS * PERIOD, bool)
    for left, right in zip(bars["left"], bars["right"], strict=True):
        out[round(left * PERIOD) : round(right * PERIOD)] = True
    return out


NewTab = Callable[..., Tab]


@pytest.fixture(scope="module")
def one(first_run: Path, new_tab: NewTab) -> Iterator[Tab]:
    """One run, served."""
    with explored.served(first_run) as serving:
        tab = new_tab().open(serving.address)
        yield tab
        tab.page.close()


@pytest.fixture(scope="module")
def two(first_run: Path, second_run: Path, new_tab: NewTab) -> Iterator[Tab]:
    """Two runs, served."""
    with explored.served(first_run, second_run) as serving:
        tab = new_tab(1920, 1080).open(serving.address)
        yield tab
        tab.page.close()


@pytest.fixture(scope="module")
def saved(first_run: Path, tmp_path_factory: pytest.TempPathFactory, new_tab: NewTab) -> Tab:
    """A page of one run, as a file."""
    path = tmp_path_factory.mktemp("pages") / "one.html"
    save_page([first_run], ["first"], path, None)
    return new_tab(offline=True).open(path.as_uri())


@pytest.fixture(scope="module")
def saved_two(first_run: Path, second_run: Path, tmp_path_factory: pytest.TempPathFactory, new_tab: NewTab) -> Tab:
    """A page of two runs, as a file."""
    path = tmp_path_factory.mktemp("pages") / "two.html"
    save_page([first_run, second_run], ["first", "second"], path, 7)
    return new_tab(1920, 1080, offline=True).open(path.as_uri())


def record_of(run: Path, cell: int) -> CellRecord:
    with RunCells(run) as cells:
        return cells.record(cell)


def wait_for_cell(tab: Tab, run: Path, cell: int, letter: str = "") -> CellRecord:
    """Wait until all that is shown of a clicked cell has come."""
    record = record_of(run, cell)
    for source, columns in columns_of(record).items():
        tab.until_shown(f"{source}{letter}", columns)
    return record


def test_a_clicked_cell_shows_the_samples_of_the_bag(one: Tab, first_run: Path) -> None:
    tab = one
    for ix, iy in ((5, 1), (7, 0)):
        cell = iy * NX + ix
        tab.click_cell(ix, iy)
        wait_for_cell(tab, first_run, cell)
        force = recording.recorded_force(first_run, cell)
        assert tab.chosen() == [cell]
        wave = tab.columns("wave")
        np.testing.assert_array_equal(wave["force"].astype(np.float32), force)
        np.testing.assert_array_equal(wave["force"], force.astype(float))  # nothing was rounded on the way
        np.testing.assert_allclose(wave["time"], np.arange(len(force)) / PERIOD, rtol=1e-15)
        np.testing.assert_array_equal(slipping(tab), recorded_slips(first_run, cell))


def test_the_spectrum_is_that_of_the_cell(one: Tab, first_run: Path) -> None:
    tab = one
    tab.click_cell(4, 2)
    record = wait_for_cell(tab, first_run, 2 * NX + 4)
    period = analysis.period_of(record.bridge_force, PERIOD)
    assert period
    tones = analysis.harmonics(record.bridge_force, record.sample_rate, period)
    shown = tab.columns("harmonics")
    np.testing.assert_allclose(shown["frequency"], tones.frequency / 1000)
    np.testing.assert_allclose(shown["level"][:10], tones.level[:10])
    lines = tab.columns("spectrum")
    assert lines["frequency"][np.argmax(lines["level"])] == pytest.approx(tones.frequency[0] / 1000, rel=0.01)


def test_hovering_names_the_parameters_of_a_cell(one: Tab, first_run: Path) -> None:
    tab = one
    plane = read_map(first_run)
    values = (f"f_asym: {plane.x[5]:.4g} 2 Z_0 v_b", f"f_init / f_asym: {plane.y[1]:.4g}")
    said = tab.hover("map", 5.5, 1.5, *values)
    for value in values:
        assert value in said
    for word in ("regime:", "confidence:", "transient:", "correlation, slips, corners:", "terrain:"):
        assert word in said
    assert plane.regime_names[plane.regime[1, 5]].replace("_", " ").replace("helmholtz", "Helmholtz") in said


def test_each_layer_has_on_the_screen_the_colours_of_the_map(one: Tab, first_run: Path) -> None:
    tab = one
    plane = read_map(first_run)
    chosen = tab.chosen()[0]
    for layer in layers_of(plane):
        for test in [0, len(layer.values) - 1] if layer.by_test else [0]:
            tab.show(layer.name, float(plane.test_periods[test]) if layer.by_test else None)
            said = test if layer.by_test else len(plane.test_periods) - 1
            tab.until(f"bow.maps[0].now === '{layer.name}' && bow.maps[0].test === {said}")
            wrong = tab.wrong_colours("map", layer.colours(test), marked=chosen)
            assert wrong == [], f"{layer.name} after test {test}"


def test_the_second_of_two_quick_clicks_counts(saved: Tab) -> None:
    tab = saved
    places = [tab.place("map", 2.5, 0.5), tab.place("map", 6.5, 4.5)]
    for place in places:
        tab.page.mouse.click(*place)
    tab.until(f"bow.chosen.data.cell[0] === {4 * NX + 6}")


def test_arrow_keys_go_to_the_neighbour(one: Tab) -> None:
    tab = one
    tab.click_cell(3, 3)
    tab.until(f"bow.chosen.data.cell[0] === {3 * NX + 3}")
    for key, cell in (("ArrowRight", 3 * NX + 4), ("ArrowUp", 4 * NX + 4), ("ArrowLeft", 4 * NX + 3)):
        tab.page.keyboard.press(key)
        tab.until(f"bow.chosen.data.cell[0] === {cell}")


def pitch(samples: np.ndarray) -> float:
    """The frequency of the strongest component, Hz, by a parabola through three lines."""
    level = np.log(np.abs(np.fft.rfft(samples * np.hanning(len(samples)))) + 1e-12)
    top = int(np.argmax(level))
    left, middle, right = level[top - 1 : top + 2]
    return float((top + 0.5 * (left - right) / (left - 2 * middle + right)) * 48_000 / len(samples))


def helmholtz_cell(run: Path) -> tuple[int, int]:
    """A cell that is in Helmholtz motion early: (ix, iy)."""
    lengths = read_map(run).transient_periods
    iy, ix = np.unravel_index(np.argmin(np.where(lengths > 0, lengths, np.inf)), lengths.shape)
    return int(ix), int(iy)


def check_sound(samples: np.ndarray, run: Path, cell: int, cents: float) -> None:
    """Check level, ends and pitch of a sound."""
    record = record_of(run, cell)
    period = analysis.period_of(record.bridge_force, PERIOD)
    assert period
    assert len(samples) == 2 * 48_000
    assert np.max(np.abs(samples)) == pytest.approx(10 ** (-3 / 20), rel=1e-3)
    assert max(abs(samples[0]), abs(samples[-1])) < 1e-3
    tone = record.sample_rate / period
    found = pitch(samples[24_000:])
    assert abs(1200 * np.log2(found / tone)) < cents


def test_the_play_button_makes_a_sound_at_the_pitch_of_the_string(one: Tab, first_run: Path) -> None:
    tab = one
    ix, iy = helmholtz_cell(first_run)
    tab.click_cell(ix, iy)
    tab.until(f"bow.chosen.data.cell[0] === {iy * NX + ix}")
    dry = tab.play()
    check_sound(dry, first_run, iy * NX + ix, 5.0)
    np.testing.assert_array_equal(tab.play(), dry)  # again the same
    tab.page.locator("input[type=checkbox]").check()
    assert not np.array_equal(tab.play(), dry)


def test_two_runs_show_the_same_cell(two: Tab, first_run: Path, second_run: Path) -> None:
    tab = two
    for figure, ix, iy in (("mapA", 6, 2), ("mapB", 1, 4)):
        cell = iy * NX + ix
        tab.click_cell(ix, iy, figure)
        for letter, run in (("A", first_run), ("B", second_run)):
            wait_for_cell(tab, run, cell, letter)
            force = recording.recorded_force(run, cell)
            np.testing.assert_array_equal(tab.columns(f"wave{letter}")["force"], force.astype(float))
        assert tab.chosen() == [cell, cell]
    heading = tab.page.get_by_text("A / B differ in: v_mid 0.2 / 0.7")
    assert heading.count() == 1
    change = np.asarray(read_map(second_run).transient_periods - read_map(first_run).transient_periods)
    both = np.logical_and(*(np.nan_to_num(read_map(run).transient_periods) > 0 for run in (first_run, second_run)))
    iy, ix = np.argwhere(both)[0]
    line = f"transient in B − A: {change[iy, ix]:+g} periods".replace("+0 ", "0 ")
    assert line in tab.hover("mapB", ix + 0.5, iy + 0.5, line)
    tab.show("difference")
    tab.until("bow.maps[1].now === 'difference'")
    wanted = difference_layer(read_map(first_run), read_map(second_run)).colours()
    assert tab.wrong_colours("mapB", wanted, marked=4 * NX + 1) == []


def test_a_saved_page_shows_the_samples_of_the_bag_to_half_a_step(saved: Tab, first_run: Path) -> None:
    tab = saved
    for ix, iy in ((5, 1), (0, 5), (7, 0)):
        cell = iy * NX + ix
        tab.click_cell(ix, iy)
        tab.until(f"bow.chosen.data.cell[0] === {cell}")
        force = recording.recorded_force(first_run, cell)[-5 * PERIOD :]
        shown = tab.columns("wave")
        bound = (force.max() - force.min()) / 65_534 / 2 + 4 * np.finfo(np.float32).eps * np.abs(force).max()
        assert len(shown["force"]) == len(force)
        assert np.max(np.abs(shown["force"] - force)) <= bound
        np.testing.assert_allclose(shown["time"], np.arange(25 * PERIOD, 30 * PERIOD) / PERIOD, rtol=1e-12)
        wanted = recorded_slips(first_run, cell)
        wanted[: 25 * PERIOD] = False
        np.testing.assert_array_equal(slipping(tab), wanted)
    assert all(address.startswith("file://") for address in tab.requests)


def test_a_saved_page_sounds_and_has_the_harmonics(saved: Tab, first_run: Path) -> None:
    tab = saved
    ix, iy = helmholtz_cell(first_run)
    cell = iy * NX + ix
    tab.click_cell(ix, iy)
    tab.until(f"bow.chosen.data.cell[0] === {cell}")
    check_sound(tab.play(), first_run, cell, 5.0)
    record, plane = record_of(first_run, cell), read_map(first_run)
    tones = analysis.harmonics(
        record.bridge_force[-5 * PERIOD :], record.sample_rate, float(plane.period[-1].ravel()[cell])
    )
    shown = tab.columns("harmonics")
    np.testing.assert_allclose(shown["frequency"], tones.frequency / 1000, rtol=1e-6)
    np.testing.assert_allclose(shown["level"][:10], tones.level[:10], atol=0.05)


def test_a_saved_page_of_two_runs(saved_two: Tab, first_run: Path, second_run: Path) -> None:
    tab = saved_two
    tab.click_cell(2, 3, "mapB")
    tab.until(f"bow.chosen.data.cell[1] === {3 * NX + 2}")
    for letter, run in (("A", first_run), ("B", second_run)):
        force = recording.recorded_force(run, 3 * NX + 2)[-7 * PERIOD :]
        shown = tab.columns(f"wave{letter}")["force"]
        assert len(shown) == len(force)
        np.testing.assert_allclose(shown, force, atol=(force.max() - force.min()) / 60_000)
        wanted = recorded_slips(run, 3 * NX + 2)
        wanted[: 23 * PERIOD] = False
        np.testing.assert_array_equal(slipping(tab, letter), wanted)
    assert np.any(tab.play("B"))


def test_nothing_is_cut_off(one: Tab, two: Tab, saved: Tab, saved_two: Tab) -> None:
    for tab in (one, two, saved, saved_two):
        for width, height in ((1280, 800), (1920, 1080)):
            tab.page.set_viewport_size({"width": width, "height": height})
            tab.page.wait_for_function(f"document.documentElement.scrollWidth === {width}")
            tab.page.wait_for_function(f"document.documentElement.scrollHeight === {height}")
