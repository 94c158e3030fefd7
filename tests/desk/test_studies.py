"""A study in this process, and its maps as one dataset."""

import numpy as np
import pytest
import xarray

import bow


@pytest.fixture(scope="module")
def study() -> bow.Study:
    return bow.study("fig11d", {"mu_s": [0.8, 1.0]}, nx=4, ny=2, periods=20, progress=False)


def test_its_dataset_has_the_last_test_and_says_so(study: bow.Study) -> None:
    assert study.ds.regime.dims == ("mu_s", "f_init_ratio", "f_asym")
    assert "regimes" not in study.ds
    assert "test" not in study.ds.dims
    assert "last test" in study.ds.attrs["tests"]
    assert "tests=True" in study.ds.attrs["tests"]


def test_its_file_has_every_test_where_these_are_asked_for(study: bow.Study, tmp_path) -> None:
    with xarray.open_dataset(study.to_netcdf(tmp_path / "tests.nc", tests=True), engine="h5netcdf") as found:
        assert found.attrs["tests"].startswith("the layers are those of all tests")
        assert found.test.values.tolist() == [5, 10, 15, 20]
        for number, each in enumerate(study.maps):
            for name, values in each.ds.data_vars.items():
                there = found[name].values[number]
                assert np.array_equal(there, values, equal_nan=values.dtype.kind == "f"), name


def test_maps_that_are_tested_at_different_times_have_no_tests_together(study: bow.Study) -> None:
    other = bow.study("fig11d", {"periods": [10, 20]}, nx=2, ny=2, progress=False)
    assert other.ds.regime.shape == (2, 2, 2)
    with pytest.raises(ValueError, match="tested at different times"):
        other.dataset(tests=True)


def test_a_name_alone_has_its_usual_values() -> None:
    found = bow.study("fig11d", ["bridge_r"], nx=2, ny=1, periods=10, progress=False)
    assert list(found.parameters) == ["bridge_r"]
    assert (min(found.parameters["bridge_r"]), max(found.parameters["bridge_r"])) == (5, 200)
