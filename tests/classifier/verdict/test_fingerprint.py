"""The compiled classifier is never older than the sources that it is made of."""

from __future__ import annotations

import importlib

import numba
from compiled import keep_code_in
from numba.core.dispatcher import Dispatcher
from sources import made_of

from bow_classifier.chunk_pass import classify_cells
from bow_classifier.verdict import fingerprint, thresholds
from bow_classifier.verdict.fingerprint import SOURCES, VERSION

NO_SOURCES = {
    "bow_classifier.verdict.fingerprint",  # lists them
    "bow_sim.simd.code_cache",  # stores the code
    "bow_sim.physics.errors",
    "bow_sim.physics.parameters",  # the length of a chunk, which the messages show, and checks of thresholds
    "bow_sim.physics.exact",  # these seven are of parameters
    "bow_sim.physics.body",
    "bow_sim.physics.fields",
    "bow_sim.physics.friction_curve",
    "bow_sim.physics.instruments",
    "bow_sim.physics.reflection_text",
    "bow_sim.physics.number_files",
}
"""Modules that the classifier imports and that decide no verdict."""


def test_numba_keeps_a_function_for_the_version_that_it_holds(monkeypatch, tmp_path):
    keep_code_in(tmp_path, monkeypatch)

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


def test_the_sources_are_all_modules_that_the_verdicts_are_made_of():
    modules = made_of("bow_classifier.block_classifier")
    assert modules.keys() >= NO_SOURCES
    assert sorted(SOURCES) == sorted(path for name, path in modules.items() if name not in NO_SOURCES)


def test_one_function_is_kept_and_holds_the_version_of_all_sources():
    kept = {}
    for name in made_of("bow_classifier.block_classifier"):
        for value in vars(importlib.import_module(name)).values():
            if isinstance(value, Dispatcher) and value.stats.cache_path:
                kept[value.py_func] = name
    assert kept == {classify_cells.py_func: "bow_classifier.chunk_pass"}
    assert VERSION in [cell.cell_contents for cell in classify_cells.py_func.__closure__]
