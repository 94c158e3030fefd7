"""The site builds without a warning: every page, every docstring, every link between them."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from doc_pages import ROOT


@pytest.mark.full
@pytest.mark.timeout(900)
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    """In a copy, as the build writes pages of the reference beside the others."""
    (tmp_path / "msg_defs").symlink_to(ROOT / "msg_defs")
    for name in ("CONTRIBUTING.md", "CHANGELOG.md"):
        shutil.copy(ROOT / name, tmp_path)
    ignored = shutil.ignore_patterns("_build", "generated", "__pycache__")
    shutil.copytree(ROOT / "docs", tmp_path / "docs", ignore=ignored)
    command = ["--quiet", "--fail-on-warning", "--keep-going", "--builder", "html", "docs", "site"]
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", *command], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert not done.returncode, done.stderr[-3000:]
    site = tmp_path / "site"
    for page, words in {
        "reference/generated/api/bow_sim.physics": "Hyperbola",
        "reference/generated/command": "bow sweep",
        "reference/generated/settings": "classifier.correlation",
        "reference/generated/messages": "BridgeForce",
        "contributing": "Add a friction law",
    }.items():
        assert words in (site / f"{page}.html").read_text()
