"""What the classifier needs of a sweep: its outline and the thresholds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bow_classifier.block_classifier import BlockClassifier, Geometry
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.physics.kinds import common
from bow_sim.physics.parameters import Parameters
from bow_sim.protocol.sweep_outline import SweepOutline


@dataclass(frozen=True, eq=False)
class Task:
    """A sweep and the thresholds to classify it with; in a replay these may differ from the announced ones."""

    outline: SweepOutline
    thresholds: Thresholds

    @classmethod
    def of(cls, outline: SweepOutline) -> Task:
        """Return the task with the thresholds that the plan announces.

        Raises
        ------
        ParameterError
            For thresholds that cannot be.
        """
        return cls(outline, Thresholds.from_mapping(outline.threshold_settings))

    @property
    def objection(self) -> str:
        """Why the sweep cannot be judged here: another version of the classifier is asked for; "" if it can."""
        wanted, own = self.outline.classifier, self.thresholds.hash
        return "" if own == wanted else f"the plan wants classifier {wanted}, this is {own}"

    def block_classifier(self, cells: NDArray[np.integer]) -> BlockClassifier:
        """Return a new classifier for the chunks of a block of cells, each with a bow speed and position of its own."""
        values = {name: self.outline.values(name, cells) for name in ("v_b", "bow_bridge", "acceleration")}
        own = common(self.outline.parameters, self.outline.lanes(cells))
        return classifier_of(own.parameters, replace(self.thresholds, **own.thresholds), values)


def classifier_of(
    parameters: Parameters, thresholds: Thresholds, values: Mapping[str, NDArray[np.float64]]
) -> BlockClassifier:
    """Return a classifier for cells with a final speed, bow position and acceleration of their own.

    Parameters
    ----------
    parameters
        Common to all cells.
    thresholds
        Of the verdicts.
    values
        ``v_b``, ``bow_bridge`` and ``acceleration``, in the paper's units, (cells,) each.
    """
    speed, endless = values["v_b"], parameters.gesture == "guettler"
    return BlockClassifier(
        Geometry.of(parameters),
        thresholds,
        len(speed),
        speed,
        values["bow_bridge"],
        parameters.periods,
        rise=speed * values["acceleration"] / parameters.period if endless else None,
    )
