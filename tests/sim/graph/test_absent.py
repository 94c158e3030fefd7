"""Optional libraries can be kept from those that would only support them."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

from bow_sim.graph.absent import absent


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


def test_the_dashboard_draws_without_pandas() -> None:
    code = (
        "import sys; from bow_sweep.view import node;"
        "node.run_node = lambda *_, **__: 0; node.exit_after = lambda _: None; node.main();"
        "import rerun; rerun.AnyValues(cell=['a', 'b']); import bow_sweep.view.live_run;"
        "assert 'pyarrow' in sys.modules; assert 'pandas' not in sys.modules; import pandas"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
