"""The time loop over lanes: many cells computed together, each exactly as if it were alone."""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite
import llvmlite.binding
import numba
import numpy as np
from numpy.typing import NDArray

from bow_sim import gesture
from bow_sim import loop
from bow_sim.friction import Hyperbola
from bow_sim.loop import STRIDE
from bow_sim.simd import LANES, aligned
from bow_sim.model import FLOATS, ParameterError, Parameters, Range, FIELDS
from bow_sim.reflection import Reflection, ends

SOURCES = ("kernel", "loop", "simd", "friction", "reflection", "gesture", "model")


@functools.cache
def source_hash() -> str:
    """Hash of the sources that decide the numbers, 16 hex digits."""
    digest = hashlib.sha256()
    for name in SOURCES:
        digest.update(Path(__file__).with_name(f"{name}.py").read_bytes())
    return digest.hexdigest()[:16]


@functools.cache
def fingerprint() -> str:
    """What two simulators must share to give the same bytes: sources, compilers, CPU."""
    features = llvmlite.binding.get_host_cpu_features().flatten()
    cpu = f"{llvmlite.binding.get_host_cpu_name()}-{hashlib.sha256(features.encode()).hexdigest()[:8]}"
    return (
        f"source-{source_hash()} numba-{numba.__version__} llvmlite-{llvmlite.__version__} "
        f"numpy-{np.__version__} {cpu}"
    )


_advance = loop.build(int(source_hash()[:15], 16))


class ChunkResult(NamedTuple):
    """Five periods of a block."""

    bridge_force: NDArray[np.float32]
    slipping: NDArray[np.uint8]
    offsets: NDArray[np.uint32]
    onset: NDArray[np.uint32]
    duration: NDArray[np.uint32]
    slip: NDArray[np.float64]


PER_LANE = frozenset({"f_asym", "f_init_ratio", "v_b", "v_mid", "mu_s", "mu_d"})

STANDARD = {(1, 1, 10, 10), (1, 30, 10, 10)}


class Block:
    """Cells computed together."""

    def __init__(self, parameters: Parameters, lanes: Mapping[str, NDArray[np.float64]], trace: bool = False) -> None:
        self.parameters = p = parameters
        sizes = {name: len(np.atleast_1d(v)) for name, v in lanes.items()}
        if len(set(sizes.values())) != 1:
            raise ParameterError(f"lanes: must be one or more arrays of one length, not {sizes}")
        self.cells = next(iter(sizes.values()))
        if self.cells == 0:
            raise ParameterError("lanes: must have at least one cell")
        self.groups = groups = -(-self.cells // LANES)
        width = groups * LANES
        value: dict[str, NDArray[np.float64]] = {}
        for name in lanes:
            if name not in PER_LANE:
                raise ParameterError(f"lanes.{name}: this parameter can not differ between the cells of a block")
        for name in PER_LANE:
            v = np.asarray(lanes.get(name, np.full(self.cells, getattr(p, name))), dtype=np.float64)
            limits: Range = FIELDS[name].metadata["range"]
            for i, x in enumerate(v):
                if not limits.holds(float(x)):
                    raise ParameterError(f"lanes.{name}[{i}] = {x!r}: must be {limits}")
            value[name] = np.concatenate([v, np.repeat(v[-1:], width - self.cells)])
        e = ends(p)
        dtype = np.dtype(p.dtype)

        def put(v):
            a = aligned((width,), dtype)
            a[:] = v
            return a

        self.law = Hyperbola(put(value["v_b"] - value["v_mid"]), put(e.y * value["mu_s"]), put(e.y * value["mu_d"]))
        self.level = [put(v) for v in gesture.levels(p.gesture, value["f_asym"], value["f_init_ratio"], value["v_b"])]
        self.share_t, self.share_r = put(e.y_t / 2 / e.y), put(e.y_r / 2 / e.y)
        self.y = e.y
        four = (e.bridge, e.nut, e.torsion_bridge, e.torsion_nut)
        general = trace or tuple(len(r.taps) for r in four) not in STANDARD
        self.sides = [self._side(r, general, dtype, put) for r in four]
        self.general = general
        self.slipping = np.zeros(groups, np.uint8)
        self.totals = aligned((STRIDE + 1, LANES), dtype)
        n = p.chunk_samples
        cap = n // 2 + 1
        self.intervals = (np.zeros(width, np.int64), np.zeros((width, cap), np.uint32), np.zeros((width, cap), np.uint32), np.zeros((width, cap)))
        self.chunk = 0
        self.traces = aligned((6, n, width), dtype) if trace else None

    def _side(self, r: Reflection, general: bool, dtype: Any, put: Any) -> loop.Side:
        groups = self.groups
        guard = len(r.taps) + STRIDE - 1
        length = max(r.last, guard)
        taps: Any = tuple(dtype.type(x) for x in reversed(r.taps))
        if general:
            taps = aligned((groups, len(r.taps), LANES), dtype)
            taps[:] = np.array(r.taps[::-1], dtype)[None, :, None]
        tail = None
        ahead = r.first
        if r.tail or general:
            tail = loop.Tail(put(r.tail), put(r.pole), put(0.0), r.tail_first, None)
            ahead = min(ahead, r.tail_first)
        return loop.Side(taps, np.full(groups, r.first + len(r.taps) - 1), np.full(groups, ahead), tail, aligned((groups, length + guard, LANES), dtype), length, guard, aligned((STRIDE, LANES), dtype))

    def advance(self) -> ChunkResult:
        """Compute the next five periods."""
        p = self.parameters
        n = p.chunk_samples
        start = self.chunk * n
        force = gesture.force_shape(p.tau_f, start, n).astype(p.dtype)
        speed = gesture.speed_shape(p.gesture, p.tau_v, p.acceleration, p.period, start, n).astype(p.dtype)
        out = np.empty((self.groups * LANES, n), np.float32)
        before = np.unpackbits(self.slipping, bitorder="little")[: self.cells]
        _advance(start, n, *self.sides, self.law, loop.Gesture(*self.level, force, speed), self.share_t, self.share_r, self.slipping, self.totals, out, self.intervals, self.traces)
        offsets = np.zeros(self.cells + 1, np.uint32)
        np.cumsum(self.intervals[0][: self.cells], out=offsets[1:])
        size = int(offsets[-1])
        onset, duration, slip = np.empty(size, np.uint32), np.empty(size, np.uint32), np.empty(size)
        loop.collect(self.intervals, offsets, onset, duration, slip)
        self.chunk += 1
        return ChunkResult(out[: self.cells], before, offsets, onset, duration, slip)


def transient(parameters: Parameters) -> dict[str, NDArray[Any]]:
    """One cell, every waveform."""
    block = Block(parameters, {"f_asym": np.array([parameters.f_asym])}, trace=True)
    parts = []
    for _ in range(parameters.chunks):
        block.advance()
        parts.append(block.traces[:, :, 0].astype(np.float64))
    bridge_force, v, v_h, v_centre, push, slipping = np.concatenate(parts, axis=1)
    return {"bridge_force": bridge_force, "v": v, "v_h": v_h, "v_centre": v_centre, "friction_force": push / block.y, "slipping": slipping != 0}
