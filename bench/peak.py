"""What this core can do at most, and how much of it the kernel gets: ``python -m bench.peak``.

Chains of one operation on eight lanes, in registers, as many side by side as give the most. Kernel and plain loop
keep multiplication and addition apart, so that every machine rounds alike; the peak of fused ones is what that costs.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from llvmlite import ir
from numba import types
from numba.core import cgutils

from bench.kernel import CASES, measure_all, pinned
from bow_sim.kernel.arguments import SIDES
from bow_sim.physics.parameters import DTYPES, Parameters
from bow_sim.physics.reflection import ends
from bow_sim.simd.jit import intrinsic, njit
from bow_sim.simd.lane_types import LANES as EIGHT
from bow_sim.simd.lane_types import LANES_OF, element_aligned, pointer, vector
from bow_sim.simd.lanes import aligned

CHAINS = (4, 6, 8, 12, 16, 24)
"""Numbers of chains tried; the most that a machine does depends on how many registers it has."""

TIMES = 20_000
"""Steps of each chain."""

COUNTED = tuple(name for name in CASES if name.startswith(("delta/Cremer, float", "stiff/Cremer, float")))
"""The cases whose kernel the count below describes."""


def _call(name: str) -> Callable[..., Any]:
    """Make LLVM's own vector function of a name."""

    def emit(builder: Any, x: Any, *others: Any) -> Any:
        suffix = "f64" if isinstance(x.type.element, ir.DoubleType) else "f32"
        kind = ir.FunctionType(x.type, [x.type] * (1 + len(others)))
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{EIGHT}{suffix}")
        return builder.call(function, [x, *others])

    return emit


_fma, _sqrt = _call("fma"), _call("sqrt")

OPERATIONS: dict[str, tuple[int, Callable[..., Any]]] = {
    "multiply": (1, lambda builder, x, a, b: builder.fmul(x, a)),
    "add": (1, lambda builder, x, a, b: builder.fadd(x, b)),
    "multiply and add": (2, lambda builder, x, a, b: builder.fadd(builder.fmul(x, a), b)),
    "fused": (2, _fma),
    "sqrt": (1, lambda builder, x, a, b: builder.fadd(_sqrt(builder, x), a)),  # the sum keeps the numbers uneven
}
"""A step of a chain, from x to the next x: how many operations it counts for, and what is emitted."""


def chains_of(name: str, chains: int) -> Any:
    """Make a compiled function (array of chains x 8 numbers, a and b each 8 numbers, times): TIMES steps of a chain."""
    _, operation = OPERATIONS[name]

    @intrinsic
    def churn(typingctx: Any, x: Any, times: Any) -> Any:
        kind = vector(LANES_OF[x.dtype])

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            def place(number: int) -> Any:
                return pointer(context, builder, x, args[0], ir.Constant(ir.IntType(64), number * EIGHT), kind)

            values = [element_aligned(builder.load(place(number)), x) for number in range(chains + 2)]
            slots = [cgutils.alloca_once_value(builder, value) for value in values[:chains]]
            with cgutils.for_range(builder, args[1]):
                for slot in slots:
                    builder.store(operation(builder, builder.load(slot), *values[chains:]), slot)
            for number, slot in enumerate(slots):
                element_aligned(builder.store(builder.load(slot), place(number)), x)
            return context.get_dummy_value()

        return types.void(x, types.intp), codegen

    @njit(nogil=True, _nrt=False)
    def run(x: Any, times: Any) -> None:
        churn(x, times)

    return run


def rate(name: str, dtype: str, repeats: int) -> float:
    """Return the most operations a nanosecond, lanes counted one by one."""
    best = 0.0
    for chains in CHAINS:
        run = chains_of(name, chains)
        x = aligned((chains + 2, EIGHT), dtype)
        x[:] = 1.37
        x[chains], x[chains + 1] = (0.7 if name == "sqrt" else 1.0), 0.0
        run(x, 1)
        for _ in range(repeats):
            began = time.perf_counter()
            run(x, TIMES)
            best = max(best, OPERATIONS[name][0] * chains * EIGHT * TIMES / (time.perf_counter() - began) / 1e9)
    return best


class Count(NamedTuple):
    """Operations of a cell-step."""

    multiply: int
    add: int
    sqrt: int


STEP = Count(
    multiply=2 + 5 + 2,  # bow force and speed; friction: S, A, a half, h h, a (S - x); shares of transverse and torsion
    add=2 + 3 + 1 + 5 + 1 + 4 + 1,  # the same two; v_h; D; friction; push; four waves; sum of slip speed
    sqrt=1,
)
"""What a step of the loop does beside the reflections: bow_sim/kernel/time_loop.py and
bow_sim/physics/friction.py, counted by hand.

Comparisons, choices, loads, stores and the noting of slips are not in it."""


def count(p: Parameters) -> Count:
    """Count the arithmetic of a cell-step: each tap multiplies and adds, an exponential tail twice each."""
    functions = [getattr(ends(p), side) for side in SIDES]
    reflections = sum(len(r.taps) + (2 if r.tail else 0) for r in functions)
    return Count(STEP.multiply + reflections, STEP.add + reflections, STEP.sqrt)


def achieved(p: Parameters, ns: float, peaks: dict[str, float]) -> dict[str, float]:
    """Return what a kernel's time for a cell-step means against the peaks.

    ``bound_ns`` is the least time if everything overlaps: the longest of multiplications, additions, both together, and
    roots. ``sum_ns`` is the least if roots overlap with nothing.
    """
    c = count(p)
    both = (c.multiply + c.add) / peaks["multiply and add"]
    roots = c.sqrt / peaks["sqrt"]
    bound = max(c.multiply / peaks["multiply"], c.add / peaks["add"], both, roots)
    return {
        **c._asdict(),
        "ns": ns,
        "of_fma_peak": (c.multiply + c.add) / ns / peaks["fused"],
        "of_multiply_and_add_peak": both / ns,
        "of_sqrt_peak": roots / ns,
        "bound_ns": bound,
        "sum_ns": both + roots,
        "of_bound": bound / ns,
    }


def measure(
    cases: Mapping[str, Mapping[str, float]], repeats: int = 20, dtypes: Sequence[str] = DTYPES
) -> dict[str, Any]:
    """Measure the peaks, and compare them with kernels timed in the same run.

    Parameters
    ----------
    cases
        Results of :func:`bench.kernel.measure_all`.

    Returns
    -------
    dict
        ``operations_per_ns``: dtype -> operation -> lanes a nanosecond; ``kernels``: case -> see :func:`achieved`.
    """
    with pinned():
        peaks = {dtype: {name: rate(name, dtype, repeats) for name in OPERATIONS} for dtype in dtypes}
    parameters = {name: Parameters.from_mapping(CASES[name].settings) for name in cases if name in COUNTED}
    kernels = {
        name: achieved(p, cases[name]["ns"], peaks[p.dtype]) for name, p in parameters.items() if p.dtype in peaks
    }
    return {"operations_per_ns": peaks, "kernels": kernels}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.peak", description=__doc__)
    parser.add_argument("--repeats", type=int, default=20)
    repeats = parser.parse_args(arguments).repeats
    print(json.dumps(measure(measure_all(repeats, COUNTED), repeats), indent=2))


if __name__ == "__main__":
    main()
