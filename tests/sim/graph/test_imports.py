"""Large libraries are imported without optional ones that would only be supported, and without collections."""

from __future__ import annotations

import gc
import importlib
import inspect
import os
import subprocess
import sys
from pathlib import Path

import pytest

from bow_sim.graph.imports import absent, know_files, uncollected


def test_a_module_cannot_be_imported_in_the_context_and_can_be_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "support_for_it.py").write_text("here = True")
    monkeypatch.syspath_prepend(tmp_path)
    with absent("support_for_it"), pytest.raises(ModuleNotFoundError, match="support_for_it"):
        importlib.import_module("support_for_it")
    assert importlib.import_module("support_for_it").here
    with absent("support_for_it"):  # what is loaded stays
        assert importlib.import_module("support_for_it").here
    del sys.modules["support_for_it"]


def test_garbage_is_collected_again_after_the_context_if_it_was_before_it() -> None:
    assert gc.isenabled()
    with uncollected():
        assert not gc.isenabled()
        with uncollected():
            pass
        assert not gc.isenabled()
    assert gc.isenabled()


def test_the_module_of_a_line_is_found_without_a_look_at_all_files(monkeypatch: pytest.MonkeyPatch) -> None:
    know_files()
    looked: list[object] = []
    monkeypatch.setattr(os.path, "realpath", looked.append)
    assert inspect.getmodule(sys._getframe()) is sys.modules[__name__]
    assert inspect.getmodule(importlib.import_module("logging").getLogger().info) is sys.modules["logging"]
    assert not looked


def test_maps_are_drawn_without_pictures_in_three_dimensions_and_without_a_warning() -> None:
    code = (
        "import sys; from bow_sweep.coordinator.painter import prepare; prepare();"
        "assert 'bow_sweep.figures.maps' in sys.modules; assert 'mpl_toolkits.mplot3d' not in sys.modules;"
        "from matplotlib.patches import Circle; it = Circle((0, 0)); it.set(radius=2); assert it.radius == 2;"
        "assert not hasattr(Circle.set, '__signature__')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_dashboard_draws_without_pandas() -> None:
    code = (
        "import sys; from bow_sweep.view import node;"
        "node.run_node = lambda *_, **__: 0; node.main();"
        "import rerun; rerun.AnyValues(cell=['a', 'b']); import bow_sweep.view.live_run;"
        "import numpy; from bow_sweep.view.map_layers import tensor; bars = tensor(numpy.arange(5));"
        "rerun.BarChart(bars, abscissa=bars, widths=numpy.ones(5)); assert 'pyarrow.compute' not in sys.modules;"
        "assert 'pyarrow' in sys.modules; assert 'pandas' not in sys.modules; import pandas"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
