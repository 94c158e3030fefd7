"""Compiled code is read from the first directory that has it, and written to the first that can be written."""

from __future__ import annotations

import importlib.util
import pickle
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numba
import pytest
from compiled import keep_code_in
from llvmlite.binding import parse_bitcode

from bow_sim.simd import code_cache
from bow_sim.simd.code_cache import Announcer, CodeCache

SOURCE = """
from bow_sim.simd.jit import njit

@njit(cache=True)
def twice(x):
    return 2 * x
"""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with a module, and an environment without a home directory."""
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "mine.py").write_text(SOURCE)
    for name in ("HOME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    keep_code_in(None, monkeypatch)
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "tmp"))
    yield tmp_path
    sys.modules.pop("mine", None)


def load(place: Path) -> ModuleType:
    """Import the module anew, as another process would."""
    spec = importlib.util.spec_from_file_location("mine", place / "code" / "mine.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["mine"] = module
    spec.loader.exec_module(module)
    return module


IN_A_NEW_PROCESS = """
import sys
sys.path.insert(0, sys.argv[1])
from mine import twice
for value in (2, 2.5)[: int(sys.argv[2])]:
    print(twice(value), "numba.np.linalg" in sys.modules)
"""


def test_stored_code_runs_without_all_that_numba_needs_to_compile(place: Path) -> None:
    outputs = []
    for signatures in ("1", "2"):
        words = [sys.executable, "-c", IN_A_NEW_PROCESS, str(place / "code"), signatures]
        outputs.append(subprocess.run(words, capture_output=True, text=True, timeout=120, check=True).stdout)
    assert outputs == ["4 True\n", "4 False\n5.0 True\n"]


def kept(folder: Path) -> list[Path]:
    return list(folder.rglob("*.nbc"))


def test_machine_code_is_stored_and_not_what_it_was_made_from(place: Path) -> None:
    assert load(place).twice(2) == 4
    (stored,) = kept(place)
    (_, _, (code, module)), *_ = pickle.loads(stored.read_bytes())
    assert code.startswith(b"\x7fELF")
    assert not list(parse_bitcode(module).functions)


def refuse(monkeypatch: pytest.MonkeyPatch, *folders: Path) -> None:
    """Make writing into these folders fail; file modes alone would not stop root."""
    ensure = code_cache._Locator.ensure_cache_path

    def refused(self: code_cache._Locator) -> None:
        if any(folder in (Path(self.directory), *Path(self.directory).parents) for folder in folders):
            raise PermissionError(self.directory)
        ensure(self)

    monkeypatch.setattr(code_cache._Locator, "ensure_cache_path", refused)


def compiled_anew(place: Path) -> bool:
    """Call the function in a newly imported module; return whether it had to be compiled."""
    function = load(place).twice
    assert function(21) == 42
    return not function.stats.cache_hits


def test_code_beside_the_sources_is_used_where_nothing_can_be_written(place, monkeypatch):
    assert compiled_anew(place)
    assert kept(place / "code")
    refuse(monkeypatch, place)
    assert not compiled_anew(place)
    assert not kept(place / "tmp")


def test_without_any_place_it_is_compiled_each_time(place, monkeypatch):
    refuse(monkeypatch, place)
    assert compiled_anew(place)
    assert compiled_anew(place)
    assert load(place).twice._cache.cache_path is None


@pytest.mark.parametrize("name", ["XDG_CACHE_HOME", "HOME", "NUMBA_CACHE_DIR", ""])
def test_where_the_sources_are_anothers_it_is_kept_in_the_next_place(place, monkeypatch, name):
    refuse(monkeypatch, place / "code")
    (place / "own").mkdir()
    if name == "NUMBA_CACHE_DIR":
        keep_code_in(place / "own", monkeypatch)
    elif name:
        monkeypatch.setenv(name, str(place / "own"))
    assert compiled_anew(place)
    assert not compiled_anew(place)
    assert kept(place / ("own" if name else "tmp"))
    assert not kept(place / "code")


def test_damaged_code_is_made_again(place):
    assert compiled_anew(place)
    for file in (place / "code" / "__pycache__").glob("mine*.nb*"):
        file.write_bytes(file.read_bytes()[:10])
        assert compiled_anew(place)
        assert not compiled_anew(place)


def test_code_of_another_numba_is_not_used(place, monkeypatch):
    assert compiled_anew(place)
    refuse(monkeypatch, place / "code")
    monkeypatch.setattr(numba, "__version__", "0.0")
    assert compiled_anew(place)
    assert not compiled_anew(place)


def test_what_others_can_write_is_not_executed(place, monkeypatch):
    refuse(monkeypatch, place / "code")
    assert compiled_anew(place)
    (private,) = (place / "tmp").iterdir()
    assert private.stat().st_mode & 0o077 == 0
    private.chmod(0o777)
    assert compiled_anew(place)
    assert compiled_anew(place)


@pytest.mark.parametrize("home", ["", "relative", "/proc/nonexistent"])
def test_a_home_that_is_none_is_not_made(place, monkeypatch, home):
    monkeypatch.setenv("HOME", home)
    monkeypatch.chdir(place)
    for directory in code_cache.candidates(str(place / "code" / "mine.py")):
        assert Path(directory).is_absolute()
        assert "nonexistent" not in directory


class Started:
    def __init__(self, function):
        self.data = {"dispatcher": function}


def test_what_takes_long_is_announced_once_with_its_place(place, monkeypatch):
    monkeypatch.setattr(code_cache, "REPORT_AFTER_S", 0.0)
    function = load(place).twice
    assert isinstance(function._cache, CodeCache)
    reported: list[str] = []
    announcer = Announcer(reported.append)
    for _ in range(2):
        announcer.on_start(Started(function))
        announcer.on_start(Started(function))
        deadline = time.monotonic() + 20
        while not reported:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        announcer._over.wait(0.2)  # time to report it again
        announcer.on_end(Started(function))
        announcer.on_end(Started(function))
        assert announcer._reporter is None
    assert len(reported) == 1
    assert str(place / "code") in reported[0]
    assert "NUMBA_CACHE_DIR" in reported[0]


def test_what_is_quick_is_not_announced(place, monkeypatch):
    monkeypatch.setattr(code_cache, "REPORT_AFTER_S", 60.0)
    reported: list[str] = []
    announcer = Announcer(reported.append)
    announcer.on_start(Started(load(place).twice))
    announcer.on_end(Started(None))
    assert reported == []
