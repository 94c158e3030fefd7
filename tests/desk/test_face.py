"""`import bow` costs nothing, and every example in its docstrings is true."""

from __future__ import annotations

import doctest
import importlib
import pkgutil
import subprocess
import sys

import pytest
from checkout import ROOT

import bow

NOT_NEEDED = {"matplotlib", "xarray", "pandas", "rich", "rclpy", "rerun"}
MODULES = [entry.name for entry in pkgutil.walk_packages(bow.__path__, "bow.")]


def test_importing_bow_imports_one_module_and_a_few_of_the_standard_library() -> None:
    program = "import sys; before = set(sys.modules); import bow; print(*set(sys.modules) - before)"
    told = subprocess.run([sys.executable, "-S", "-c", program], capture_output=True, text=True, check=True, cwd=ROOT)
    new = told.stdout.split()
    assert [name for name in new if name.partition(".")[0] not in sys.stdlib_module_names] == ["bow"]
    assert len(new) < 60  # typing and importlib bring some thirty


def test_opening_a_run_brings_neither_ros_nor_pictures() -> None:
    program = f"import sys, bow; bow.open, bow.sweep; print(sorted(set(sys.modules) & {NOT_NEEDED!r}))"
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"


def test_all_public_names_are_listed_by_dir() -> None:
    assert set(bow.__all__) <= set(dir(bow))


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_a_docstring_are_true(
    name: str, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path_factory.mktemp("examples"))
    failed, _ = doctest.testmod(importlib.import_module(name))
    assert not failed
