"""Waveforms in, verdicts out: the automatic recognition of section III.B of Schumacher & Woodhouse (1995).

features           what is measured on a waveform
verdict            regimes, thresholds, and the decision between regimes
measured           a real string: its bridge force as the classifier takes it
chunk_pass         all features and the decision for the cells of a block, in one compiled pass
block_classifier   the chunks of one block, one after another
task               what the classifier needs to know of a sweep
stream             stream messages in, verdict messages out, for all blocks of a sweep
at_source          judges blocks where they are computed
precompile         compiles the pass and caches the code
node               the classifier node
simulator          the simulator node, with what judges its blocks
measured_node      the node of a measured string, in the process of the classifier

Public names, imported when they are first used:

BlockClassifier    classifies the chunks of one block
Classifier         classifies the chunks of a whole sweep, as messages
Geometry           what the tests need to know of the string
REGIMES            the regimes by name
Thresholds         the thresholds that decide
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bow_classifier.block_classifier import BlockClassifier as BlockClassifier
    from bow_classifier.block_classifier import Geometry as Geometry
    from bow_classifier.stream import Classifier as Classifier
    from bow_classifier.verdict.regimes import REGIMES as REGIMES
    from bow_classifier.verdict.thresholds import Thresholds as Thresholds

_MODULES = {
    "BlockClassifier": "bow_classifier.block_classifier",
    "Classifier": "bow_classifier.stream",
    "Geometry": "bow_classifier.block_classifier",
    "REGIMES": "bow_classifier.verdict.regimes",
    "Thresholds": "bow_classifier.verdict.thresholds",
}

__all__ = ["BlockClassifier", "Classifier", "Geometry", "REGIMES", "Thresholds"]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(_MODULES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
