"""The cell that is nearest to a value on an axis."""

import numpy as np
import pytest

from bow_sweep.cell.parameters import place
from bow_sweep.cell.waveform import CellError

UNEVEN = np.array([0.1, 0.2, 1.0, 5.0])


@pytest.mark.parametrize("values", [UNEVEN, UNEVEN[::-1]])
def test_the_nearest_of_uneven_values_is_found(values):
    for value, nearest in ((0.1, 0.1), (0.16, 0.2), (0.59, 0.2), (0.61, 1.0), (3.1, 5.0), (6.9, 5.0), (0.051, 0.1)):
        assert values[place("mu_s", value, values, "values")] == nearest


@pytest.mark.parametrize("value", [0.04, 7.1])
def test_half_a_step_beyond_the_end_of_uneven_values_is_beyond_the_map(value):
    with pytest.raises(CellError, match=r"the map reaches from 0\.1 to 5; the nearest is"):
        place("mu_s", value, UNEVEN, "values")


def test_on_a_logarithmic_axis_the_ratio_counts():
    assert place("f_asym", 3.1, np.array([1.0, 10.0]), "log") == 0
    assert place("f_asym", 3.2, np.array([1.0, 10.0]), "log") == 1
