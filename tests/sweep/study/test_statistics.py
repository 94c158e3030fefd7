"""Which differences between maps are significant: on data of which the truth is known."""

import numpy as np
import pytest
from scipy import stats

from bow_sweep.study.statistics import GRIDS, LEVEL, Measured, differences, holm, p_value


def measured(values):
    """A measure from its four independent values, as the playability of a map gives it."""
    return Measured(float(np.mean(values)), float(np.std(values, ddof=1) / 2), float(np.mean(values)))


def test_p_is_that_of_welchs_test_on_the_four_values():
    random = np.random.default_rng(5)
    one, other = random.normal(0.5, 0.01, GRIDS), random.normal(0.52, 0.03, GRIDS)
    expected = stats.ttest_ind(one, other, equal_var=False).pvalue
    assert p_value(measured(one), measured(other)) == pytest.approx(expected)


def test_without_a_difference_about_the_level_of_the_families_has_one_called_significant():
    random = np.random.default_rng(11)
    families, maps = 300, 6
    wrong = 0
    for _ in range(families):
        found = [measured(random.normal(0.5, 0.02, GRIDS)) for _ in range(maps)]
        wrong += any(each.significant for each in differences([(found[0], each) for each in found[1:]]))
    assert 0.005 * families < wrong < 1.6 * LEVEL * families


def test_a_difference_of_many_errors_is_significant():
    random = np.random.default_rng(3)
    base = measured(random.normal(0.5, 0.01, GRIDS))
    same = [measured(random.normal(0.5, 0.01, GRIDS)) for _ in range(3)]
    far = measured(random.normal(0.8, 0.01, GRIDS))
    found = differences([(base, each) for each in (*same, far)])
    assert found[-1].significant
    assert found[-1].value == pytest.approx(far.value - base.value)
    assert found[-1].error == pytest.approx(np.hypot(base.error, far.error))


def test_holms_correction_is_that_of_its_paper():
    assert holm([0.01, 0.04, 0.03, 0.005]).tolist() == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]).tolist() == [1.0, 1.0]
    assert holm([]).tolist() == []


def test_maps_without_errors_have_no_significance_and_do_not_disturb_the_others():
    small, one, other = Measured(0.5, None, None), measured([0.1, 0.11, 0.12, 0.1]), measured([0.8, 0.81, 0.8, 0.82])
    alone = differences([(one, other)])[0]
    together = differences([(one, small), (one, other), (one, Measured(None, None, None))])
    assert together[1] == alone
    assert (together[0].value, together[0].error, together[0].p, together[0].significant) == (
        pytest.approx(0.5 - one.value),
        None,
        None,
        False,
    )
    assert together[2] == (None, None, None, False)


def test_maps_whose_grids_all_agree_differ_or_not_without_a_test():
    none, all_cells = Measured(0.0, 0.0, 0.0), Measured(1.0, 0.0, 1.0)
    assert [each.significant for each in differences([(none, none), (none, all_cells)])] == [False, True]
