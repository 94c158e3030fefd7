from bow_sweep.record.bag import bag_folder, station_bags


def test_the_bags_of_a_run_are_found_by_the_names_of_their_stations(tmp_path):
    assert station_bags(tmp_path) == {}
    for station in ("lab_b", "", "lab_a"):
        folder = bag_folder(tmp_path, station)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{folder.name}_0.mcap").touch()
    for other in ("Not a station", "empty"):
        (tmp_path / "bag" / other).mkdir()
    (tmp_path / "bag" / "Not a station" / "bag_0.mcap").touch()
    assert list(station_bags(tmp_path).items()) == [
        ("", tmp_path / "bag"),
        ("lab_a", tmp_path / "bag" / "lab_a"),
        ("lab_b", tmp_path / "bag" / "lab_b"),
    ]
