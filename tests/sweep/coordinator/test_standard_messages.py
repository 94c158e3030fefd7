"""The map as messages that RViz, Foxglove and other tools show."""

import numpy as np
from builtin_interfaces.msg import Time
from example_maps import APERIODIC, HELMHOLTZ, REGIMES, SLIP, basin_map

from bow_sim.protocol.verdict_fields import PENDING
from bow_sweep.coordinator.standard_messages import image_message, regimes_message
from bow_sweep.figures.colours import GREY, REGIME_COLOURS

STAMP = Time(sec=7, nanosec=9)


def test_the_regimes_are_a_picture_in_the_colours_of_all_other_pictures():
    values = basin_map(8, 4, computed=28)
    values["regime"] = values["regime"].copy()
    values["regime"][5] = APERIODIC
    image = regimes_message(values, STAMP)
    assert (image.height, image.width, image.encoding, image.step, image.is_bigendian) == (4, 8, "rgb8", 24, 0)
    assert (image.header.stamp, image.header.frame_id) == (STAMP, "basin_map")
    found = np.frombuffer(image.data, np.uint8).reshape(4, 8, 3)[::-1]  # the first row is the highest y
    colours = {code: REGIME_COLOURS[REGIMES[code]] for code in (HELMHOLTZ, SLIP, APERIODIC)} | {PENDING: GREY}
    expected = np.array([colours[int(code)] for code in values["regime"]]).reshape(4, 8, 3)
    np.testing.assert_array_equal(found, expected)
    assert (found[3, 4:] == GREY).all()
    assert tuple(found[0, 5]) == REGIME_COLOURS["aperiodic"]


def test_the_transient_lengths_are_an_image_of_the_same_size():
    image = image_message(basin_map(8, 4, computed=28), STAMP)
    assert (image.height, image.width, image.encoding, image.step) == (4, 8, "32FC1", 32)
    lengths = np.frombuffer(image.data, "<f4").reshape(4, 8)[::-1]
    assert lengths[0].tolist() == [5, 10, 15, 20, 25, 30, 35, 40]
    assert np.isnan(lengths[3, 4:]).all()
