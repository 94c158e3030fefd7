import xml.etree.ElementTree as ET

import numpy as np
import pytest
from PIL import Image

from bow_sim.figures import catalogue, control, linear, page
from bow_sim.figures import motion as figures_motion
from bow_sim.figures.motion import motion, parting, slips, steady
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import ends


def states(text: str) -> np.ndarray:
    """Slipping where there is an s."""
    return np.array([letter == "s" for letter in text])


# ---- the transients of Figs 5 to 8


def test_the_transient_of_fig_5_is_regular_from_some_16_periods_on():
    starts = slips(motion().slipping)[:, 0]
    after = starts[starts >= 2224]
    assert after[0] == 2224
    assert (np.abs(np.diff(after) - 139) <= 5).all()
    assert np.abs(np.diff(starts[starts <= 2224])[-1] - 139) > 5


def test_5_3_and_5_5_take_the_same_decisions_until_the_arrow_and_another_there():
    one, other = motion(5.5), motion(5.3)
    arrow = parting(one.slipping, other.slipping)
    assert arrow is not None and 139 < arrow < 2400
    assert one.slipping[arrow] and not one.slipping[arrow - 1], "5.5 begins to slip there"
    mine = slips(one.slipping)
    first, after = mine[mine[:, 0] == arrow][0]
    assert not other.slipping[first:after].any(), "and 5.3 sticks throughout that slip"
    theirs = slips(other.slipping)
    before = mine[mine[:, 1] <= arrow]
    paired = theirs[theirs[:, 1] <= arrow]
    assert len(before) == len(paired) > 8
    assert (np.maximum(before[:, 0], paired[:, 0]) < np.minimum(before[:, 1], paired[:, 1])).all(), "slip by slip"


@pytest.mark.parametrize(
    ("one", "other", "sample"),
    [
        ("---ss---ss--", "---ss---ss--", None),
        ("---ss---ss--", "----ss---ss-", None),  # a later slip is no other decision
        ("---ss---ss--", "---ss-------", 8),
        ("---ss-------", "---ss---ss--", 8),
        ("---ss---ss--", "---ss-----ss", 8),  # so much later that it is another slip
        ("------------", "------------", None),
    ],
)
def test_motions_part_at_the_first_slip_without_a_counterpart(one, other, sample):
    assert parting(states(one), states(other)) == sample


def test_slips_are_found_at_both_borders():
    assert slips(states("ss--s-ss")).tolist() == [[0, 2], [4, 5], [6, 8]]
    assert slips(states("----")).shape == (0, 2)


def test_fig_6_shows_whole_cycles_of_a_sawtooth_with_ripples():
    first, m = steady()
    assert len(m.v) == 3 * 139
    np.testing.assert_array_equal(m.v, motion().v[first : first + len(m.v)])
    assert len(slips(m.slipping)) == 3
    np.testing.assert_allclose(m.bridge_force[139:], m.bridge_force[:-139], atol=0.02)
    fall = m.bridge_force[:-15] - m.bridge_force[15:]
    assert (np.diff((fall > 139 / 15 / 2).astype(int)) == 1).sum() == 3, "one flyback a cycle"
    assert abs(fall.max() - 139 / 15) < 1
    slope = np.diff(m.bridge_force[slips(m.slipping)[0, 1] + 1 : slips(m.slipping)[1, 0] - 1])
    likeness = [np.corrcoef(slope[:-lag], slope[lag:])[0, 1] for lag in range(5, 26)]
    assert 5 + int(np.argmax(likeness)) == 15, "the round trip between bow and bridge"


def test_the_limits_of_fig_7_are_those_at_which_states_change():
    m = motion()
    assert (m.v_1, m.v_2) == pytest.approx((1 - 1.617 * 5.5 * 0.8, -3.678), abs=1e-3)
    released = m.slipping[1:] & ~m.slipping[:-1]
    assert m.v_h[1:][released].max() < m.v_1
    assert m.v_h[1:][~m.slipping[1:] & m.slipping[:-1]].min() > m.v_2


@pytest.mark.parametrize("number", [5, 7, 8])
def test_the_arrow_points_at_the_sample(number):
    axis = catalogue.figure(number).axes[0]
    (arrow,) = [text for text in axis.texts if getattr(text, "arrow_patch", None) is not None]
    assert arrow.xy[0] == parting(motion(5.5).slipping, motion(5.3).slipping) + 1, "samples count from 1"
    line = axis.lines[0]
    at = int(np.flatnonzero(line.get_xdata() == arrow.xy[0])[0])
    assert arrow.xy[1] <= line.get_ydata()[at], "from below"


def test_figs_5_and_8_have_the_same_scales():
    boxes = [[(axis.get_xlim(), axis.get_ylim()) for axis in catalogue.figure(n).axes[:2]] for n in (5, 8)]
    assert boxes[0] == boxes[1]
    assert [x for x, _ in boxes[0]] == [(0, 1200), (1200, 2400)]


# ---- the linear figures


def by_equation_5(p: Parameters, samples: int) -> np.ndarray:
    """g(t) as the series of equation (5), term by term."""
    e = ends(p)
    h_1, h_2 = e.bridge.impulse(samples), e.nut.impulse(samples)
    unit = np.eye(1, samples).ravel()
    total = unit.copy()
    term_1, term_2 = unit, unit  # chains that end with h_1, with h_2
    for _ in range(2 * samples // 100):
        term_1, term_2 = (np.convolve(h, t)[:samples] for h, t in ((h_1, term_2), (h_2, term_1)))
        total += term_1 + term_2
    return total * e.y_t / 2


def test_fig_2_is_equation_5():
    data = linear.responses(400)
    for p, g in zip(linear.models(), data, strict=False):
        np.testing.assert_allclose(g, by_equation_5(p, 400), atol=1e-9)
    assert data.torsion[0] == pytest.approx(0.617)
    early = np.argsort(-np.abs(data.torsion[1:100]))[:2] + 1
    assert all(min(abs(t - lag) for lag in (6.25, 51.667, 57.917)) < 2 for t in early), "2.4 times as fast"


def test_figs_3_and_4_are_of_30_modes_of_each_model():
    delta, stiff = linear.transverse()
    assert delta.number.tolist() == stiff.number.tolist() == list(range(1, 31))
    assert (np.diff(stiff.frequency / stiff.number) > 0).all()
    assert np.ptp(delta.frequency / delta.number) < 0.0033 * 440
    axis = catalogue.figure(3).axes[0]
    shown = {
        line.get_label(): (line.get_marker(), line.get_ydata()) for line in axis.lines if len(line.get_xdata()) == 30
    }
    assert shown["delta/Cremer"][0] == "^" and shown["stiff/Cremer"][0] == "o", "markers of the paper's caption"
    np.testing.assert_allclose(shown["stiff/Cremer"][1], stiff.frequency / stiff.number)


# ---- friction and force


@pytest.mark.parametrize("v_mid", control.V_MIDS)
def test_friction_curves_are_odd_about_the_bow_and_midway_at_v_mid(v_mid):
    v, mu = control.friction_curve(v_mid)
    assert (np.diff(v) >= 0).all()
    assert np.interp(v_mid, v, mu) == pytest.approx(0.55, abs=1e-3)
    assert mu.max() == 0.8 and mu.min() == -0.8
    faster = np.interp([1.1, 1.5, 2.0], v, mu)
    np.testing.assert_allclose(faster, -np.interp([0.9, 0.5, 0.0], v, mu), atol=1e-3)


@pytest.mark.parametrize("force", control.CONTOURS)
def test_contours_keep_their_force_and_the_axes(force):
    f_asym, ratio = control.contour(force)
    np.testing.assert_allclose(f_asym * ratio, force)
    assert f_asym.min() >= 0.5 and f_asym.max() == pytest.approx(20)
    assert ratio.min() > 0 and ratio.max() <= 2 + 1e-12


# ---- files


@pytest.mark.parametrize("number", catalogue.FIGURES)
def test_every_figure_is_drawn_and_not_blank(number, tmp_path):
    catalogue.write(number, tmp_path / "f.png")
    picture = np.asarray(Image.open(tmp_path / "f.png").convert("L"))
    assert picture.shape[1] == page.INCHES * page.DPI
    assert 0.005 < (picture < 128).mean() < 0.3
    margin = np.concatenate(
        [picture[:4].ravel(), picture[-4:].ravel(), picture[:, :4].ravel(), picture[:, -4:].ravel()]
    )
    assert (margin == 255).all(), "nothing is cut off"
    assert [path.name for path in tmp_path.iterdir()] == ["f.png"]


def test_svg_and_pdf_are_what_they_should_be_and_the_same_each_time(tmp_path):
    for suffix in ("svg", "pdf"):
        for name in ("a", "b"):
            catalogue.write(9, tmp_path / f"{name}.{suffix}")
        assert (tmp_path / f"a.{suffix}").read_bytes() == (tmp_path / f"b.{suffix}").read_bytes()
    assert ET.parse(tmp_path / "a.svg").getroot().tag.endswith("svg")
    assert (tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")


def test_what_cannot_be_drawn_is_refused_before_the_work(tmp_path, monkeypatch):
    with pytest.raises(catalogue.FigureError, match=r"figure 13: .* one of 2, 3, 4, 5, 6, 7, 8, 9, 12"):
        catalogue.write(13, tmp_path / "f.png")
    monkeypatch.setitem(catalogue.FIGURES, 9, lambda: pytest.fail("drawn"))
    with pytest.raises(catalogue.FigureError, match=r"f\.gif: cannot draw as \.gif; should end in \.png, \.svg, \.pdf"):
        catalogue.write(9, tmp_path / "f.gif")
    with pytest.raises(catalogue.FigureError, match="a file without a suffix"):
        catalogue.write(9, tmp_path / "f")


def test_a_failure_leaves_the_old_picture(tmp_path, monkeypatch):
    place = tmp_path / "f.png"
    place.write_bytes(b"old")
    drawn = catalogue.figure(12)
    monkeypatch.setattr(drawn, "savefig", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        page.save(drawn, place)
    assert place.read_bytes() == b"old"
    assert len(list(tmp_path.iterdir())) == 1


def test_no_figure_takes_data_that_it_could_change():
    before = motion().v.copy()
    figures_motion.figure_5()
    np.testing.assert_array_equal(motion().v, before)
