"""What the classifier needs to know of a sweep in order to judge it."""

from __future__ import annotations

from dataclasses import dataclass

from bow_classifier.block_classifier import BlockClassifier, Geometry
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.protocol.sweep_outline import SweepOutline


@dataclass(frozen=True, eq=False)
class Task:
    """A sweep and the thresholds to judge it with; these may differ from the announced ones in a replay."""

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

    def block_classifier(self, block: int) -> BlockClassifier:
        """Return a new judge for the chunks of a block: each cell with its own bow speed and bow position."""
        cells = self.outline.block(block)
        speed, bridge = (self.outline.values(name, cells) for name in ("v_b", "bow_bridge"))
        geometry = Geometry.of(self.outline.parameters)
        return BlockClassifier(geometry, self.thresholds, len(cells), speed, bridge)
