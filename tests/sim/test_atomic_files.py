"""Archives of arrays: what is in them comes back, and what is not is not allocated."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from bow_sim.atomic_files import read_arrays


def test_arrays_come_back(tmp_path: Path) -> None:
    arrays = {"a": np.arange(6).reshape(2, 3), "b": np.array(["x", "yz"]), "c": np.array(1.5), "d": np.zeros((0, 3))}
    np.savez_compressed(tmp_path / "a.npz", **arrays)
    back = read_arrays(tmp_path / "a.npz")
    assert back.keys() == arrays.keys()
    for name, values in arrays.items():
        np.testing.assert_array_equal(back[name], values)
        assert back[name].dtype == values.dtype


def header(shape: str, descr: str = "'<f8'") -> bytes:
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (header("(1000000000000,)") + bytes(64), "in 64 bytes"),
        (header("(-8,)") + bytes(64), "in 64 bytes"),
        (header("(7,)") + bytes(64), "in 64 bytes"),
        (header("(8,)", "'|O'") + bytes(64), "object"),
        (header("(8", "'<f8'"), "multi-line"),
        (b"\x93NUMPY\x03\x00" + bytes(64), "version"),
        (b"MZ", "magic string"),
    ],
)
def test_an_array_that_claims_what_it_does_not_hold_is_refused(data: bytes, message: str, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("a.npy", data)
    with pytest.raises(ValueError, match=message):
        read_arrays(tmp_path / "a.npz")


def test_what_is_no_archive_is_said(tmp_path: Path) -> None:
    out = io.BytesIO()
    np.savez(out, a=np.arange(100))
    for number, data in enumerate((b"", b"PK", out.getvalue()[:-40], out.getvalue().replace(b"\x05\x00", b"\x06\x00"))):
        (tmp_path / str(number)).write_bytes(data)
        with pytest.raises(ValueError, match=r"."):
            read_arrays(tmp_path / str(number))
    with pytest.raises(FileNotFoundError):
        read_arrays(tmp_path / "none")
