"""What the classifier needs of a sweep: its outline and the thresholds."""

from __future__ import annotations

from dataclasses import dataclass

from bow_classifier.block_classifier import BlockClassifier, Geometry
from bow_classifier.verdict.thresholds import Thresholds
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

    def block_classifier(self, block: int) -> BlockClassifier:
        """Return a new classifier for the chunks of a block; each cell has its own bow speed and bow position."""
        cells = self.outline.block(block)
        speed, bridge = (self.outline.values(name, cells) for name in ("v_b", "bow_bridge"))
        geometry = Geometry.of(self.outline.parameters)
        return BlockClassifier(geometry, self.thresholds, len(cells), speed, bridge)
