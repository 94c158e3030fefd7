"""Files with reflection functions, as other programs write them, are read, or an error names file and line."""

from __future__ import annotations

import io

import numpy as np
import pytest

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.reflection_text import Reflection, parse, read

WANT = Reflection((-0.6, -0.38), 124)


def savetxt(**options: object) -> bytes:
    file = io.BytesIO()
    np.savetxt(file, np.c_[[124, 125], [-0.6, -0.38]], **options)
    return file.getvalue()


@pytest.mark.parametrize(
    "content",
    [
        savetxt(),
        savetxt(delimiter=","),
        savetxt(delimiter=";", newline="\r\n"),
        savetxt(header="lag value", comments="% "),
        savetxt(fmt=["%d", "%.17g"], delimiter="\t"),
        b"\xef\xbb\xbf124 -0.6\r\n125 -0.38\r\n",
        "124\t-0,6\r\n125\t-0,38\r\n".encode("utf-16"),
        b"\n\n  124   -0.6  \n\t\n125 -0.38 % the last \xb5\n\n",
        b"124;-0,6;\n125;-0,38;\n;;\n",
        b"124,0;-0,6\n125,0;-0,38\n",
        b"lag,value\n124,-0.6\n125,-0.38\n",
        b'"lag";"value"\n"124";"-0.6"\n"125";"-0.38"\n',
        b"124 -0,6\n125 -0,38\n",
        b"124, -0.6\r125, -0.38\r",
        b"1.24D+02 -6.D-1\n0.125e3 -.38\n",
        "124 −0.6\n125 −0.38\n".encode(),
        b"\xef\xbb\xbffirst=124 taps=-0.6,-0.38\r\n",
        b"# mine\r\nfirst = 124.0\r\ntaps = -0.6, -0.38  # from the bridge\r\n",
        b'\xef\xbb\xbf{"first": 124.0, "taps": [-0.6, -0.38]}\r\n',
        b'{"first": 1.24e2,\r\n "taps": [-0.6, -3.8e-1]}',
    ],
)
def test_a_reflection_function_is_read_as_peoples_tools_write_it(tmp_path, content):
    path = tmp_path / "mine.txt"
    path.write_bytes(content)
    assert parse(read(path)) == WANT


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"124.5 -0.6\n", "line 1: lag = '124.5': must be a whole number"),
        (b"124 -0.6\n\n125 x\n", "line 3: value = 'x': must be a finite number"),
        (b"124,-0,6\n", "line 1: '124 -0 6': must be a lag in samples and a value"),
        (b"124;-0.6\n125,000;-0.38\n", "line 2: .*is the comma a decimal point"),
        (b"1_24 -0.6\n", "line 1: lag = '1_24'"),
        (b"0 124 -0.6\n", "line 1: '0 124 -0.6': must be a lag"),
        (b"\x93NUMPY\x01\x00v\x00", "is not text"),
        (b"lag value\nlag value\n124 -0.6\n", "line 2: lag = 'lag'"),
        (b'{"first": 124.5, "taps": [-0.6]}', "first = '124.5': must be a whole number"),
        (b'{"first": true, "taps": [-0.6]}', "first = 'True': must be a whole number"),
    ],
)
def test_what_could_mean_two_things_or_nothing_is_refused_with_its_line(tmp_path, content, what):
    path = tmp_path / "mine.txt"
    path.write_bytes(content)
    with pytest.raises(ParameterError, match=what) as refusal:
        read(path)
    assert str(path) in str(refusal.value)
