"""A map for other programs: an xarray dataset, netCDF, CSV and Parquet, with all settings."""

from __future__ import annotations

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
import xarray

import bow
from bow.optional import MissingLibrary, library
from bow_sweep.cli import main


def test_a_dataset_names_axes_units_regimes_and_settings(run: Path) -> None:
    m = bow.open(run)
    ds = m.ds
    assert dict(ds.sizes) == {"f_init_ratio": 3, "f_asym": 4, "test": 4}
    assert ds.test.values.tolist() == [5, 10, 15, 20]
    assert ds.f_asym.attrs["units"] == "2 Z_0 v_b"
    assert ds.f_asym.attrs["long_name"] == "asymptotic bow force"
    assert ds.transient_periods.attrs["units"] == "periods"
    names = ds.regime.attrs["flag_meanings"].split()
    codes = ds.regime.attrs["flag_values"].tolist()
    assert len(names) == len(codes)
    assert dict(zip(names, codes, strict=True)) == {n: i for i, n in enumerate(m.file.regime_names)} | {"pending": 255}
    assert np.array_equal(ds.regimes.sel(test=20), ds.regime)
    assert not set(m.settings) - set(ds.attrs) - {name for name, value in m.settings.items() if value == ""}
    assert ds.attrs["periods"] == 20
    assert ds.attrs["source"].startswith("bow ")
    assert len(ds.attrs["kernel"]) > 8


def test_every_layer_of_a_map_is_in_its_dataset(computed: bow.Map) -> None:
    from bow_sweep.maps.map_file import map_arrays

    arrays = map_arrays(computed.file)
    for name, values in arrays.items():
        if np.asarray(values).ndim >= 2:
            assert np.array_equal(computed.ds[name].values, values, equal_nan=values.dtype.kind == "f"), name
            assert computed.ds[name].attrs["long_name"]


def test_a_netcdf_file_gives_back_the_dataset(run: Path, tmp_path: Path) -> None:
    m = bow.open(run)
    with xarray.open_dataset(m.to_netcdf(tmp_path / "map.nc"), engine="h5netcdf") as found:
        assert set(found.variables) == set(m.ds.variables)
        for name in m.ds.variables:
            assert found[name].dtype == m.ds[name].dtype, name
            assert np.array_equal(found[name], m.ds[name], equal_nan=found[name].dtype.kind == "f"), name
        assert {name: found.attrs[name] for name in m.settings if m.settings[name] != ""} == {
            name: value for name, value in m.settings.items() if value != ""
        }
        assert found.regime.attrs["flag_meanings"] == m.ds.regime.attrs["flag_meanings"]
    assert [path.name for path in tmp_path.iterdir()] == ["map.nc"]


def test_a_file_that_cannot_be_written_leaves_nothing(computed: bow.Map, tmp_path: Path) -> None:
    with pytest.raises(OSError):
        computed.to_netcdf(tmp_path / "no" / "map.nc")
    (tmp_path / "map.nc").write_text("before")
    computed.to_netcdf(tmp_path / "map.nc")
    assert (tmp_path / "map.nc").read_bytes().startswith(b"\x89HDF")


def test_csv_and_parquet_have_a_row_for_each_cell(run: Path, tmp_path: Path) -> None:
    m = bow.open(run)
    for name in ("map.csv", "map.parquet"):
        assert main(["export", str(run), "--to", str(tmp_path / name)]) == 0
    with open(tmp_path / "map.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    table = pyarrow.parquet.read_table(tmp_path / "map.parquet").to_pylist()
    assert len(rows) == len(table) == 12
    for cell, (text, row) in enumerate(zip(rows, table, strict=True)):
        iy, ix = divmod(cell, 4)
        assert float(text["f_asym"]) == row["f_asym"] == m.x[ix]
        assert float(text["f_init_ratio"]) == row["f_init_ratio"] == m.y[iy]
        assert text["regime"] == row["regime"] == m.regime[iy, ix]
        assert float(text["transient_periods"]) == row["transient_periods"] == m.transient_periods[iy, ix]
        correlation = m.file.correlation[-1, iy, ix]
        assert np.float32(text["last_correlation"] or "nan").tobytes() == correlation.tobytes() or np.isnan(correlation)


def test_the_command_writes_netcdf(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(run), "--to", str(tmp_path / "map.nc")]) == 0
    assert capsys.readouterr().out == f"wrote {tmp_path / 'map.nc'}\n"
    with xarray.open_dataset(tmp_path / "map.nc", engine="h5netcdf") as found:
        assert found.attrs["run_id"] == bow.open(run).file.run_id


def test_a_wrong_file_or_run_is_one_line(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(run), "--to", str(tmp_path / "map.xls")]) == 2
    assert "cannot write a map as .xls; should end in .nc, .csv, .parquet" in capsys.readouterr().err
    assert main(["export", str(tmp_path / "none"), "--to", str(tmp_path / "map.csv")]) == 2
    assert main(["export", str(run), "--to", str(tmp_path / "no" / "map.csv")]) == 1
    assert len(capsys.readouterr().err.splitlines()) == 2
    assert list(tmp_path.iterdir()) == []


def test_a_library_that_is_missing_is_named_with_what_to_install(run: Path, tmp_path: Path) -> None:
    program = (
        "import sys; sys.modules['h5netcdf'] = None\n"
        "from bow_sweep.cli import main\n"
        f"sys.exit(main(['export', {str(run)!r}, '--to', {str(tmp_path / 'map.nc')!r}]))"
    )
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert told.returncode == 2
    assert "needs h5netcdf, which is not installed here; pip install 'bow[data]'" in told.stderr
    with pytest.raises(MissingLibrary, match="needs no_such_library"):
        library("no_such_library", "this")


def test_the_waveform_of_a_cell_is_a_dataset(computed: bow.Map) -> None:
    c = computed.cell(7)
    assert c.ds.bridge_force.values.tobytes() == c.bridge_force.tobytes()
    assert c.ds.time.attrs["units"] == "s"
    assert float(c.ds.time[1]) == 1 / c.sample_rate
