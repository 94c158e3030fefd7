"""A compiled test is never older than the sources that it is made of."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

import numba
import pytest
from numba.core.dispatcher import Dispatcher

from bow_classifier import chunk_pass
from bow_classifier.features import corners, long_periods, periodicity, ripples, slips
from bow_classifier.verdict import decision, fingerprint, thresholds
from bow_classifier.verdict.fingerprint import SOURCES, VERSION

MODULES = (chunk_pass, corners, ripples, long_periods, periodicity, decision, slips)


def test_numba_keeps_a_function_for_the_version_that_it_holds(monkeypatch, tmp_path):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))

    def build(version):
        @numba.njit(cache=True)
        def function():
            return version

        return function

    found = []
    for version in (1, 1, 2, 1, VERSION, VERSION):
        function = build(version)
        assert function() == version
        found.append((sum(function.stats.cache_hits.values()), sum(function.stats.cache_misses.values())))
    assert found == [(0, 1), (1, 0), (0, 1), (1, 0), (0, 1), (1, 0)]


def test_the_version_is_that_of_every_source(monkeypatch, tmp_path):
    assert fingerprint.source_hash() == thresholds.source_hash() == f"{VERSION:015x}" + fingerprint.source_hash()[-1]
    files = tmp_path / "one.py", tmp_path / "two.py"
    for file in files:
        file.write_text("1")
    monkeypatch.setattr(fingerprint, "SOURCES", files)
    seen = {fingerprint.source_hash.__wrapped__()}
    for file in files:
        file.write_text("2")
        seen.add(fingerprint.source_hash.__wrapped__())
    assert len(seen) == 3


def ours(module):
    """Return {name: file} of what a module has from other files of ours, and what it makes of that at once."""
    tree, found = ast.parse(Path(module.__file__).read_text()), {}
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and (node.level or node.module.startswith("bow_")):
            for alias in node.names:
                room = ("bow_classifier." if node.level else "") + node.module
                file = Path(importlib.import_module(room).__file__)
                inner = file.with_name(f"{alias.name}.py")  # ``from bow_sim import simd`` names a module
                found[alias.asname or alias.name] = inner if file.name == "__init__.py" else file
        if isinstance(node, (ast.Assign, ast.AnnAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            for part in ast.walk(node.value):
                if isinstance(part, ast.Name) and part.id in found:
                    found.update({target.id: found[part.id] for target in targets})
    return found


@pytest.mark.parametrize("module", MODULES)
def test_what_is_kept_and_made_of_several_files_holds_their_version(module):
    compiled = [value for value in vars(module).values() if isinstance(value, Dispatcher)]
    kept = [function.py_func for function in compiled if function.stats.cache_path]
    assert kept
    names = {name for function in compiled for name in function.py_func.__code__.co_names}
    foreign = {file for name, file in ours(module).items() if name in names}
    assert foreign <= set(SOURCES)
    assert bool(foreign) == (module is not slips)
    if foreign:
        assert all(VERSION in [cell.cell_contents for cell in function.__closure__ or ()] for function in kept)
