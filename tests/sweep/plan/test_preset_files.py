"""Preset files of a user: found, written, read back to the same sweep, and described by a JSON Schema."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest
import yaml

from bow_sim.physics.errors import ParameterError
from bow_sweep.plan.preset_files import choose, save, schema, user_folder
from bow_sweep.plan.presets import preset_directory, presets
from bow_sweep.plan.sweep import Sweep

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(autouse=True)
def own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep what lies in the folders of whoever runs the tests out of them."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))


@pytest.mark.parametrize("name", presets())
def test_a_saved_sweep_is_read_back_as_it_was(name: str, tmp_path: Path) -> None:
    sweep = Sweep.from_spec(name, ["mu_s=0.85", "y.count=6", "classifier.slip=0.07"])
    save(tmp_path / "mine.yaml", sweep, "a title: with a colon")
    chosen = choose(str(tmp_path / "mine.yaml"))
    assert (chosen.label, chosen.preset) == ("mine", "")
    assert Sweep.from_spec("", chosen.settings).settings() == sweep.settings()
    jsonschema.validate(yaml.safe_load((tmp_path / "mine.yaml").read_text()), schema())


def test_here_comes_before_the_users_folder_and_that_before_the_package(tmp_path: Path) -> None:
    assert choose("fig11d").path is None
    folder = user_folder()
    assert folder.is_relative_to(tmp_path)
    folder.mkdir(parents=True)
    for place, value in ((folder, 1), (Path(), 2)):
        (place / "fig11d.yaml").write_text(f"mu_s: {value}\n")
        chosen = choose("fig11d")
        assert (chosen.path, chosen.settings) == (place / "fig11d.yaml", (f"mu_s={value}",))


def test_what_there_is_not_is_refused_with_the_nearest_name() -> None:
    Path("violin_mine.yaml").touch()
    for wrong, near in {"fig11dd": "fig11d", "violin_mien": "violin_mine"}.items():
        with pytest.raises(ParameterError, match=rf"preset '{wrong}': no such preset; did you mean {near}\?"):
            choose(wrong)
    with pytest.raises(ParameterError, match=r"one of fig10, .* or the path of a \.yaml file"):
        choose("?")
    with pytest.raises(ParameterError, match=r"no\.yaml: cannot be read"):
        choose("no.yaml")
    with pytest.raises(ParameterError, match=r"mine\.txt: a preset file should end in \.yaml"):
        save(Path("mine.txt"), Sweep.from_spec(), "")
    assert not Path("mine.txt").exists()
    assert choose("fig11", {"fig11": "a campaign"}).preset == "fig11"


def test_the_schema_takes_our_presets_and_refuses_mistakes() -> None:
    shipped = json.loads((ROOT / "config/preset.schema.json").read_text())
    assert shipped == json.loads(json.dumps(schema())), "bow settings --schema > config/preset.schema.json"
    for path in preset_directory().glob("*.yaml"):
        jsonschema.validate(yaml.safe_load(path.read_text()), shipped)
    for wrong in (
        {"mu": 0.8},
        {"mu_s": -1},
        {"model": "steel"},
        {"x": {"name": "periods"}},
        {"y": {"counts": 3}},
        {"string": "violin"},
        {"classifier": {"slip": 2}},
        {"period": 139.5},
    ):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(wrong, shipped)
