import pytest

from bow_sim.protocol.stations import (
    StationError,
    check_name,
    namespace_of,
    numbered,
    run_namespace_of,
    station_of,
)

RUN = "/bow/a123456789abcdef"


@pytest.mark.parametrize("name", ["a", "lab_2", "station_64", "a" * 32])
def test_a_station_of_this_name_is_in_a_namespace_below_the_runs(name):
    assert check_name(name) == name
    inner = namespace_of(RUN, name)
    assert run_namespace_of(inner, name) == RUN
    assert station_of(f"{inner}/recorder", RUN) == name


@pytest.mark.parametrize("name", ["", "2nd", "Lab", "a-b", "a/b", "a" * 33, "_a", "ä", "a\n"])
def test_a_name_that_ros_or_a_file_system_could_not_take_is_refused(name):
    with pytest.raises(StationError, match="lower-case letter"):
        check_name(name)


def test_the_station_without_a_name_is_the_namespace_of_the_run():
    assert namespace_of(RUN, "") == RUN == run_namespace_of(RUN, "")
    assert station_of(f"{RUN}/simulator_1", RUN) == ""
    assert numbered(1) == ("",)
    assert numbered(3) == ("station_1", "station_2", "station_3")


def test_a_node_outside_the_run_is_of_no_station():
    others = ["", "recorder", "/bow/recorder", "/bow/b1/recorder", f"{RUN}/lab/deeper/recorder", f"{RUN}/Lab/recorder"]
    assert [station_of(node, RUN) for node in [*others, f"{RUN}/"]] == [None] * 7
    assert station_of("/lab/recorder", "/") == "lab"
    assert station_of("/recorder", "/") == ""


def test_a_node_that_is_not_where_its_station_is_is_refused():
    with pytest.raises(StationError, match=f"this one is in {RUN}"):
        run_namespace_of(RUN, "lab")
