"""Blocks of cells, computed five periods at a time; this module calls the compiled time loop.

A cell's result does not depend, in any bit, on which cells it is computed with: every operation in the loop is exactly
rounded, and none is fused or reordered.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow_sim.kernel import arriving, few_cells, rings, time_loop
from bow_sim.kernel.ahead import Ahead, sides_of
from bow_sim.kernel.arguments import SIDES, Body, Gesture, Hair, Output, Side, State, String, Tail
from bow_sim.kernel.order import order_of, places, room
from bow_sim.kernel.sources import source_hash
from bow_sim.kernel.windows import windows
from bow_sim.physics import exact, friction, gesture
from bow_sim.physics.body import resonators
from bow_sim.physics.cells import Cells, cells
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection_text import Reflection
from bow_sim.simd.jit import entry
from bow_sim.simd.lanes import LANES, aligned

STANDARD = frozenset({(1, 1, 10, 10), (1, 30, 10, 10)})
"""Numbers of taps (bridge, nut, torsion at bridge and nut) with a kernel of their own: delta/Cremer and stiff/Cremer.

All other models share one kernel for any number of taps; it is slower, but needs to be compiled only once."""

LEAST_RING = 64
"""Rows of a ring, at least: the more, the more seldom its end is repeated before its beginning."""

TRACES = ("bridge_force", "v", "v_h", "v_centre", "friction_force", "slipping")
"""What :func:`transient` returns of every string, in the order of the kernel's traces."""

BODY_TRACES, THERMAL_TRACES = ("bridge_velocity", "bridge_force_real"), ("temperature",)
"""What follows where there are modes of a body, and with thermal friction."""

_VERSION = int(source_hash()[:15], 16)
_advance, _advance_few = time_loop.build(_VERSION), few_cells.build(_VERSION)


class ChunkResult(NamedTuple):
    """Five periods of a block.

    Parameters
    ----------
    bridge_force : ndarray of float32, shape (cells, samples), C-contiguous
        Outgoing velocity wave towards the bridge, final bow speed = 1 (paper Fig 6(c)).
    slipping : ndarray of uint8, shape (cells,)
        1 = slipping after the last step before this chunk.
    offsets : ndarray of uint32, shape (cells + 1,)
        The intervals of cell i are ``offsets[i] ... offsets[i + 1] - 1``.
    onset, duration : ndarray of uint32, shape (intervals,)
        First slipping sample, from the start of the chunk, and number of samples within it.
    slip : ndarray of float64, shape (intervals,)
        Sum of the slip speed ``v_b(t) - v`` over those samples; N = 139 is a whole Helmholtz slip.
    """

    bridge_force: NDArray[np.float32]
    slipping: NDArray[np.uint8]
    offsets: NDArray[np.uint32]
    onset: NDArray[np.uint32]
    duration: NDArray[np.uint32]
    slip: NDArray[np.float64]


class Block:
    """Cells computed together, five periods at a time.

    Parameters
    ----------
    parameters : Parameters
        The parameters that all cells share.
    lanes : Mapping[str, array_like], each of shape (cells,)
        The ones that differ: values by the name of any parameter in :data:`bow_sim.physics.parameters.SWEEPABLE`.
    trace : bool
        Keep every waveform of the latest chunk in ``traces``, shape (waveforms, samples, at least cells), in the order
        of ``trace_names``; the friction force is multiplied by ``admittance``.

    Attributes
    ----------
    admittance : ndarray, shape (cells,)
        What the friction force meets at the bow: string and hair.
    trace_names : tuple of str

    Raises
    ------
    ParameterError
        Naming the parameter, cell and value that is wrong.
    """

    _kernel = staticmethod(_advance)  # for a friction law of other code: ``time_loop.build(0)``, not cached

    def __init__(self, parameters: Parameters, lanes: Mapping[str, ArrayLike], *, trace: bool = False) -> None:
        self.parameters = parameters
        self.chunk = 0
        described = cells(parameters, lanes)
        self._count = described.count
        self._groups = -(-described.count // LANES)
        self._dtype = np.dtype(parameters.dtype)
        samples, width = parameters.chunk_samples, self._groups * LANES

        self.admittance = described.bow_admittance()
        self._few = described.count <= few_cells.FEW and self._dtype == np.float64 and self._kernel is _advance
        order = None if self._few or trace else order_of(described.ends)
        self._cells = described = described if order is None else described.taken(order)
        functions = [[getattr(e, side) for e in described.ends] for side in SIDES]
        self._own_tables = bool({"tau_f", "tau_v", "acceleration"} & described.lanes.keys())
        self._general = (
            trace
            or self._own_tables
            or len(described.ends) > 1
            or tuple(len(same[0].taps) for same in functions) not in STANDARD
        )
        make = self._general_side if self._general else self._standard_side
        y = described.bow_admittance()
        self._work = aligned((rings.TOTALS + samples + 1, LANES), self._dtype)
        body = self._make_body(described)
        at_bow = {
            "law": self._lanes_of(self._make_law(described)),
            "share_t": self._lane(described.of_ends("y_t") / 2 / y),
            "share_r": self._lane(described.of_ends("y_r") / 2 / y),
            "hair": self._make_hair(described),
        }
        self._string: Any
        if self._few:
            each = [same * self._count if len(same) == 1 else same for same in functions]
            sides = sides_of(each, samples)
            self._string = few_cells.String(sides, body, **at_bow)
        else:
            bridge, nut, torsion_bridge, torsion_nut = (
                make(name, same) for name, same in zip(SIDES, functions, strict=True)
            )
            self._string = String(bridge._replace(body=body), nut, torsion_bridge, torsion_nut, **at_bow)
        self._levels = self._lanes_of(
            gesture.levels(parameters.gesture, *(described.value(name) for name in ("f_asym", "f_init_ratio", "v_b")))
        )
        self.trace_names = (
            TRACES + BODY_TRACES * (body is not None) + THERMAL_TRACES * (parameters.friction == "thermal")
        )
        waveforms = len(self.trace_names)
        self._ahead: Ahead | None = None
        self._entry: Any = None
        if self._few:
            levels, size = self._levels._asdict(), (described.count, samples, parameters.chunks)
            self._ahead = Ahead(_advance_few, self._string, levels, self._shapes_ahead, *size, waveforms, trace)
            self.traces: NDArray[Any] | None = self._ahead.traces
            return
        states = aligned(((samples + rings.STRIDE) // (self._dtype.itemsize * 8) + 1, LANES), self._dtype)
        self._state = State(
            slipping=np.zeros(self._groups, np.uint8),
            work=self._work,
            states=states,
            bits=states.view(f"u{self._dtype.itemsize}"),
            edges=np.empty(samples + 1, np.uint32),
        )
        self._intervals = room(width, samples)
        self._places = places(order, width, samples) if self._general else None
        self.traces = aligned((waveforms, samples, width), self._dtype) if trace else None

    def advance(self, bridge_force: NDArray[np.float32] | None = None) -> ChunkResult:
        """Compute the next five periods; return new arrays, which later calls do not change.

        Parameters
        ----------
        bridge_force : None, or ndarray of float32, shape (cells, samples), C-contiguous
            Where the bridge force is written; None: in a new array, too.
        """
        if self._ahead is not None:
            result = ChunkResult(*self._ahead.chunk(self.chunk))
            self.traces = self._ahead.traces
        else:
            result = self._compute(bridge_force)
        self.chunk += 1
        if bridge_force is None or result.bridge_force is bridge_force:
            return result
        bridge_force[:] = result.bridge_force
        return result._replace(bridge_force=bridge_force)

    def _compute(self, bridge_force: NDArray[np.float32] | None) -> ChunkResult:
        """Compute the next chunk; its bridge force is written into an array if that has a row for each lane."""
        samples, cells, lanes = self.parameters.chunk_samples, self._count, self._groups * LANES
        start = self.chunk * samples
        force = np.empty((lanes, samples), np.float32) if bridge_force is None or cells < lanes else bridge_force
        slipping = np.unpackbits(self._state.slipping, count=cells, bitorder="little")
        shapes = Gesture._make((*self._levels, *self._tables(start, samples)))
        output = Output(force, self._intervals, self._places, self.traces)
        arguments = start, samples, self._string, shapes, self._state, output
        if self._entry is None:
            self._entry = entry(self._kernel, arguments)
        self._entry(*arguments)
        offsets, *values = self._intervals
        if self._places is not None:
            slipping[self._places.rows[:cells]] = slipping.copy()
            offsets, *values = self._places.intervals
        size = int(offsets[cells])
        onset, duration, slip = (x[:size].copy() for x in values)
        bridge_force = force if cells == lanes else force[:cells]
        return ChunkResult(bridge_force, slipping, offsets[: cells + 1].copy(), onset, duration, slip)

    def contents(self) -> tuple[Any, ...]:
        """Return all that the time loop gets and leaves to the next chunk, and the first gesture; to be compared alone.

        Returns
        -------
        tuple
            Of arrays, numbers, None and such tuples. Without the workspace: what is in it differs between processors.
        """
        tables = self._tables(0, self.parameters.chunk_samples)
        if self._ahead is not None:
            return self._string, self._levels, self._ahead.slipping, self.admittance, *tables
        sides = {name: getattr(self._string, name)._replace(arrived=None, delayed=None) for name in SIDES}
        return self._string._replace(**sides), self._levels, self._state.slipping, self.admittance, *tables

    def _make_law(self, described: Cells) -> Any:
        """Return the friction law, a named tuple of arrays over cells."""
        return friction.law_of(described)

    def _make_hair(self, described: Cells) -> Hair | None:
        """Return the bow hair of each cell; None where all bows are rigid."""
        elastic = described.hair_admittance()
        if not elastic.any():
            return None
        y = described.bow_admittance()
        columns = (described.value(name).tolist() for name in ("hair_k", "hair_r", "sample_rate"))
        decay = [exact.exp(-k / (r * rate)) if r else 0.0 for k, r, rate in zip(*columns, strict=True)]
        share, string = elastic / y, described.of_ends("y") / y
        return Hair(*(self._lane(np.asarray(x)) for x in (share, string, decay, np.zeros(described.count))))

    def _make_body(self, described: Cells) -> Body | None:
        """Return the modes of the body behind the bridge of each cell, or one body that all share; None for none."""
        bodies = described.bodies
        if not bodies:
            return None
        filters = [resonators(b.modes, b.sample_rate) for b in bodies]
        count = max(len(f.b0) for f in filters)
        groups = self._groups if len(bodies) > 1 else 1
        tables = np.zeros((3, groups * LANES, count))
        for lane in range(groups * LANES):
            own = filters[min(lane, len(filters) - 1)]
            tables[:, lane, : len(own.b0)] = own
        b0, a1, a2 = (self._by_groups(x) for x in tables)
        one = np.ones(described.count)
        rho, gain, pole = (np.array([getattr(b, name) for b in bodies]) * one for name in ("rho", "gain", "pole"))
        sum_b = np.array([math.fsum(f.b0) for f in filters]) * one
        return Body(
            b0,
            a1,
            a2,
            stride=count * LANES if groups > 1 else 0,
            z1=aligned((self._groups, count, LANES), self._dtype),
            z2=aligned((self._groups, count, LANES), self._dtype),
            sum_b=self._lane(sum_b),
            den=self._lane(1 / (1 + (1 + rho) * sum_b / 2)),
            rho=self._lane(rho),
            gain=self._lane(gain),
            pole=self._lane(pole),
            sum_z=self._lane(0 * one),
            tail=self._lane(0 * one),
            force=aligned((rings.STRIDE, LANES), self._dtype),
            velocity=aligned((rings.STRIDE, LANES), self._dtype),
        )

    def _shapes(self, start: int, samples: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the gesture's shapes in some samples: (samples,), or each cell's own, (cells, samples)."""
        if self._own_tables:
            return gesture.shapes_of_cells(self._cells, start, samples)
        return gesture.shapes(self.parameters, start, samples)

    def _shapes_ahead(self, start: int, samples: int, chunks: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return these of some chunks: (1, samples), or (cells, samples)."""
        if not self._own_tables:
            return gesture.shapes_of_chunks(self.parameters, start, samples, chunks)
        each = [self._shapes(start + n * samples, samples) for n in range(chunks)]
        return np.concatenate([f for f, _ in each], axis=1), np.concatenate([v for _, v in each], axis=1)

    def _tables(self, start: int, samples: int) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return these as the kernel needs them: (samples,), or each lane's own, (groups, samples, 8)."""
        force, speed = self._shapes(start, samples)
        return self._table(force), self._table(speed)

    def _table(self, shape: NDArray[np.float64]) -> NDArray[Any]:
        """Return shapes as the kernel needs them: those of cells, (cells, samples), by lanes; a common one as it is."""
        return shape.astype(self._dtype) if shape.ndim == 1 else self._by_groups(self._padded(shape))

    def _by_groups(self, rows: NDArray[np.float64]) -> NDArray[Any]:
        """Lay out rows, one a lane, as the kernel needs them: (groups, columns, 8)."""
        table: NDArray[Any] = aligned((len(rows) // LANES, rows.shape[1], LANES), self._dtype)
        table[:] = rows.reshape(-1, LANES, rows.shape[1]).transpose(0, 2, 1)
        return table

    def _padded(self, values: NDArray[Any]) -> NDArray[Any]:
        """Repeat the last cell until the lanes are full; the results of the repeated cells are left out."""
        missing = self._groups * LANES - len(values)
        return np.concatenate([values, np.repeat(values[-1:], missing, axis=0)]) if missing else values

    def _lane(self, values: NDArray[np.float64]) -> NDArray[Any]:
        lanes: NDArray[Any] = aligned((self._groups * LANES,), self._dtype)
        lanes[:] = self._padded(values)
        return lanes

    def _lanes_of(self, values: Any) -> Any:
        """Turn a named tuple of arrays over cells into one of arrays over lanes; what is common is a tuple in it."""
        return type(values)(*(self._common(x) if isinstance(x, tuple) else self._lane(x) for x in values))

    def _common(self, values: Any) -> Any:
        """Return a named tuple of arrays as it is, in the arithmetic of the block."""
        return type(values)(*(x.astype(self._dtype) for x in values))

    def _ring(self, name: str, last: int, taps: int, beyond: int = 0) -> dict[str, Any]:
        """Make a ring for this greatest lag, windows of so many taps, and so many rows that are read beyond its end."""
        whole = rings.STRIDE
        lead = -(-(taps + whole - 1) // whole) * whole  # rows that eight steps read
        length = max(-(-last // whole) * whole, lead, LEAST_RING)
        ring = aligned((self._groups, lead + length + beyond, LANES), self._dtype)
        return {"ring": ring, "length": length, "lead": lead, "arrived": self._work[rings.ARRIVED[name]]}

    def _standard_side(self, name: str, same: list[Reflection]) -> Side:
        """Make a side whose taps, a tuple, are part of the kernel's type."""
        r = same[0]
        tail = None
        if r.tail:
            one = np.ones(self._count)
            gain, pole, state = (self._lane(x * one) for x in (r.tail, r.pole, 0.0))
            used = np.full(self._groups, True)
            tail = Tail(gain, pole, state, np.full(self._groups, r.tail_first), None, None, used)
        taps = np.array(r.taps[::-1], self._dtype)
        return Side(
            taps=tuple(taps),
            count=None,
            last=np.full(self._groups, r.first + len(r.taps) - 1),
            ahead=np.full(self._groups, r.soonest),
            tail=tail,
            body=None,
            delayed=None,
            table=taps,
            **self._ring(name, r.last, len(r.taps)),
        )

    def _general_side(self, name: str, same: list[Reflection]) -> Side:
        """Make a side with any taps for each cell: a group of eight cells has a window that contains all their lags."""
        each = same * self._count if len(same) == 1 else same
        each = each + each[-1:] * (self._groups * LANES - len(each))
        least = arriving.NEAR - 1 if name == "torsion_bridge" else 0
        taps, count, last = windows([(r.first, r.taps) for r in each], self._dtype, even=True, least=least)
        tails, tail_count, tail_last = windows(
            [(r.tail_first, r.tail_taps) if r.tail else (r.first, (1.0,)) for r in each], self._dtype, even=True
        )
        gain, pole = (self._lane(np.array(x)[: self._count]) for x in ([r.tail for r in each], [r.pole for r in each]))
        state, used = self._lane(np.zeros(self._count)), gain.reshape(-1, LANES).any(axis=1)
        return Side(
            taps=taps,
            count=count,
            last=last,
            ahead=np.array([r.soonest for r in each]).reshape(-1, LANES).min(axis=1),
            tail=Tail(gain, pole, state, tail_last, tails, tail_count, used),
            body=None,
            delayed=aligned((rings.STRIDE, LANES), self._dtype),
            table=None,
            **self._ring(
                name,
                int(max(last.max(), tail_last.max())),
                max(taps.shape[1], tails.shape[1]),
                # where the number of taps is odd, one more is 0, of a step to come
                max(0, *(count - last), *(tail_count - tail_last)),
            ),
        )


def transient(parameters: Parameters) -> dict[str, NDArray[Any]]:
    """Compute one cell with every waveform.

    Parameters
    ----------
    parameters : Parameters

    Returns
    -------
    dict of str to ndarray, shape (samples,)
        ``bridge_force``, ``v`` (string surface), ``v_h``, ``v_centre`` and ``friction_force``, float64, final bow speed
        = 1; ``slipping``, bool, the state after the step. Where there are modes of a body, ``bridge_velocity`` and
        ``bridge_force_real``, the force on the bridge over Z_0; with thermal friction ``temperature``, K.
    """
    block = Block(parameters, {"f_asym": [parameters.f_asym]}, trace=True)
    (y,) = block.admittance
    parts = []
    for _ in range(parameters.chunks):
        block.advance()
        assert block.traces is not None
        parts.append(block.traces[:, :, 0].astype(np.float64))
    waveforms: dict[str, NDArray[Any]] = dict(zip(block.trace_names, np.concatenate(parts, axis=1), strict=True))
    waveforms["friction_force"] = waveforms["friction_force"] / y
    waveforms["slipping"] = waveforms["slipping"] != 0
    return waveforms
