"""The map and the health of the nodes as standard ROS messages, for tools such as RViz and rqt."""

from __future__ import annotations

import sys
from array import array
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from numpy.typing import NDArray
from sensor_msgs.msg import Image, PointCloud2, PointField

from bow_sweep.coordinator.choice import FRAME
from bow_sweep.coordinator.diagnostics import Status
from bow_sweep.figures.colours import GREY, regime_colours
from bow_sweep.maps.plane import Snapshot, image_of, upright

POINT = np.dtype([(name, np.float32) for name in ("x", "y", "z", "transient_periods", "regime")])
"""A cell as a point: its middle in the frame of the map; NaN = pending."""


def image_message(basin_map: Mapping[str, Any], stamp: Time) -> Image:
    """Return the transient lengths of a map (fields of a BasinMap) as an image: 32FC1, first row on top."""
    height, width, data = image_of(Snapshot.from_message(basin_map))
    image = Image(height=height, width=width, encoding="32FC1", step=4 * width, data=array("B", data))
    image.header.stamp = stamp
    image.header.frame_id = FRAME
    return image


def regimes_message(basin_map: Mapping[str, Any], stamp: Time) -> Image:
    """Return the regimes of a map (fields of a BasinMap) as a picture in their colours: rgb8, first row on top."""
    shown = Snapshot.from_message(basin_map)
    height, width = shown.shape
    palette = _regime_palette(tuple(basin_map["regime_names"]))
    picture = palette.take(upright(shown.regime), axis=0)  # three times as fast as palette[...]
    image = Image(height=height, width=width, encoding="rgb8", step=3 * width, data=array("B", picture.tobytes()))
    image.header.stamp = stamp
    image.header.frame_id = FRAME
    return image


@lru_cache
def _regime_palette(names: tuple[str, ...]) -> NDArray[np.uint8]:
    """Return the colour of each regime code, (256, 3); grey for those without a name, as for pending cells."""
    palette = np.full((256, 3), GREY, np.uint8)
    palette[: len(names)] = regime_colours(names)
    return palette


def points_message(basin_map: Mapping[str, Any], stamp: Time) -> PointCloud2:
    """Return a map (fields of a BasinMap) as points that RViz and Foxglove show as a plane, in which one can click."""
    shown = Snapshot.from_message(basin_map)
    ny, nx = shown.shape
    points = np.zeros((ny, nx), POINT)
    points["x"], points["y"] = np.meshgrid(np.arange(nx) + 0.5, np.arange(ny) + 0.5)
    points["transient_periods"], points["regime"] = shown.transient_periods, shown.regime
    cloud = PointCloud2(
        height=ny,
        width=nx,
        fields=[
            PointField(name=name, offset=4 * place, datatype=PointField.FLOAT32, count=1)
            for place, name in enumerate(POINT.names or ())
        ],
        is_bigendian=sys.byteorder == "big",
        point_step=POINT.itemsize,
        row_step=POINT.itemsize * nx,
        data=array("B", points.tobytes()),
        is_dense=False,
    )
    cloud.header.stamp = stamp
    cloud.header.frame_id = FRAME
    return cloud


def diagnostics_message(items: Iterable[Status], stamp: Time) -> DiagnosticArray:
    """Return diagnostics as diagnostic_updater publishes them and diagnostic_aggregator takes them."""
    diagnostics = DiagnosticArray(
        status=[
            DiagnosticStatus(
                level=bytes([item.level]),
                name=item.name,
                hardware_id=item.hardware_id,
                message=item.message,
                values=[KeyValue(key=key, value=str(value)) for key, value in item.values.items()],
            )
            for item in items
        ]
    )
    diagnostics.header.stamp = stamp
    return diagnostics
