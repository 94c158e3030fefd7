"""Topics and service by which a cell is chosen while a sweep runs, and those on which it is seen.

What is chosen, and its waveform, is in :mod:`bow_sweep.coordinator.choice`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from typing import Any

from bow_msgs.msg import InspectedCell
from bow_msgs.srv import InspectCell
from geometry_msgs.msg import PointStamped
from sensor_msgs.msg import PointCloud2

from bow_sim.graph.node_base import INSPECT, LATCHED, BowNode
from bow_sweep.coordinator.choice import (
    NO_SWEEP,
    ChoiceError,
    Inspector,
    cell_at,
    cell_of,
    in_words,
    values_of,
)
from bow_sweep.coordinator.standard_messages import points_message
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run.directory import Run

CLICKS = ("clicked_point", "/clicked_point")
"""Topics of clicks on the map. RViz and Foxglove publish on the global one unless told otherwise. If two graphs share a
domain, the one in the namespace says which is meant."""


class CellChooser:
    """Serves `inspect_cell` and takes clicks on the map; publishes the chosen cell on `inspect`.

    Parameters
    ----------
    node
        The coordinator.
    run_in_progress
        Returns the run in progress, None if there is none.

    Attributes
    ----------
    problem, latest
        Why the latest choice was refused, "" if it was not; the latest cell, in words.
    """

    def __init__(self, node: BowNode, run_in_progress: Callable[[], Run | None]) -> None:
        self._node, self._run_in_progress = node, run_in_progress
        self.problem, self.latest = "", "no cell was chosen"
        self._inspect = node.create_publisher(InspectedCell, "inspect", INSPECT)
        self._points = node.create_publisher(PointCloud2, "basin_map/points", LATCHED)
        self._map: Mapping[str, Any] | None = None  # not yet published as points
        self._of_run = ""
        self._chosen: list[int] = []  # cells of that run
        self._dashboards: set[str] = set()  # that have been sent them
        self._inspector = Inspector(node.incarnation, self._inspect.publish, node.get_logger().warning)
        node.create_service(InspectCell, "inspect_cell", self._on_request)
        for topic in CLICKS:
            node.create_subscription(PointStamped, topic, self._on_click, 10)

    def _on_request(self, request: InspectCell.Request, response: InspectCell.Response) -> InspectCell.Response:
        try:
            run, cell = self._choose(lambda sweep: cell_of(sweep, request.at, request.cell))
        except ChoiceError as error:
            response.message = str(error)
            return response
        response.success, response.message, response.run_id, response.cell = True, self.latest, run.run_id, cell
        response.x, response.y = values_of(run.sweep, cell)
        return response

    def _on_click(self, point: PointStamped) -> None:
        at, frame = point.point, point.header.frame_id
        try:
            self._choose(lambda sweep: cell_at(sweep, at.x, at.y, frame))
        except ChoiceError as error:
            self._node.get_logger().warning(f"no cell is chosen: {error}")

    def _choose(self, find: Callable[[Sweep], int]) -> tuple[Run, int]:
        """Have a cell inspected; return the run, and the cell.

        Raises
        ------
        ChoiceError
            Where there is no such cell, or no run.
        """
        run = self._run_in_progress()
        try:
            if run is None:
                raise ChoiceError(NO_SWEEP)
            cell = find(run.sweep)
            self._inspector.inspect(run, cell)
        except ChoiceError as error:
            self.problem = str(error)
            raise
        self._begin(run)
        if cell not in self._chosen:
            self._chosen.append(cell)
        self.problem, self.latest = "", in_words(run.sweep, cell)
        self._node.get_logger().info(f"inspects {self.latest}")
        return run, cell

    def _begin(self, run: Run) -> None:
        """Forget the cells of an earlier run."""
        if run.run_id != self._of_run:
            self._of_run = run.run_id
            self._chosen.clear()
            self._dashboards.clear()

    def show_again(self, dashboard: str, run_id: str) -> None:
        """Publish the chosen cells once more for a dashboard that has taken up the run later; by its incarnation."""
        run = self._run_in_progress()
        if run is None or run.run_id != run_id:
            return
        self._begin(run)
        if dashboard in self._dashboards:
            return
        self._dashboards.add(dashboard)
        with contextlib.suppress(ChoiceError):  # too many wait: it gets the first ones
            for cell in self._chosen:
                self._inspector.inspect(run, cell)

    def take_map(self, values: Mapping[str, Any]) -> None:
        """Take the fields of a BasinMap, to be published as points."""
        self._map = values

    def publish_points(self) -> None:
        """Publish the latest map as points that can be clicked, if somebody shows them; to be called once a second."""
        if self._map is not None and self._points.get_subscription_count():
            self._points.publish(points_message(self._map, self._node.wall_time()))
            self._map = None

    def close(self) -> None:
        """Stop computing."""
        self._inspector.close()
