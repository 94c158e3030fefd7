"""One bowed string: parameters in, waveforms out.

The models of Schumacher and Woodhouse, *The transient behaviour of models of bowed-string
motion*, Chaos 5 (1995) 509-523, called "the paper" in this package.

physics            the string and its player
simd               eight cells at once, in compiled code
kernel             the time loop
protocol           what the nodes say to each other
graph              what every process of the graph shares
figures            the paper's figures of one string
atomic_files       files that are replaced atomically
config_files       finds the files of config/
block_request      a block to compute, as the coordinator asks for it
chunk_messages     the chunks of a block as messages
simulator_session  what a simulator knows and does: events in, instructions out
simulator_events   those events and instructions
node               the simulator node

Public names, imported when they are first used:

Block              a block of cells, computed five periods at a time
ParameterError     a parameter that cannot be
Parameters         everything that decides the waveforms of one cell
transient          the waveforms of one cell
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bow_sim.kernel.block import Block as Block
    from bow_sim.kernel.block import transient as transient
    from bow_sim.physics.errors import ParameterError as ParameterError
    from bow_sim.physics.parameters import Parameters as Parameters

_MODULES = {
    "Block": "bow_sim.kernel.block",
    "ParameterError": "bow_sim.physics.errors",
    "Parameters": "bow_sim.physics.parameters",
    "transient": "bow_sim.kernel.block",
}

__all__ = ["Block", "ParameterError", "Parameters", "transient"]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(_MODULES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
