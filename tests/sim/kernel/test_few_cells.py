"""Few cells, one after the other, have the bits that they have as lanes, in every stream and waveform."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scalar_string import simulate

from bow_sim.kernel import ahead
from bow_sim.kernel.block import TRACES, Block
from bow_sim.kernel.few_cells import FEW, LEAST_LAG
from bow_sim.physics.parameters import MODELS, Parameters

FORCES = np.geomspace(0.5, 20.0, 9)


def streams(block: Block, chunks: int) -> list[list[Any]]:
    """Every stream of every cell, chunk after chunk: bytes."""
    found: list[list[Any]] = [[] for _ in range(block._count)]
    for _ in range(chunks):
        r = block.advance()
        for cell, stream in enumerate(found):
            mine = slice(*r.offsets[cell : cell + 2])
            stream.append((r.bridge_force[cell].tobytes(), int(r.slipping[cell])))
            stream.append(tuple(x[mine].tobytes() for x in (r.onset, r.duration, r.slip)))
    return found


def as_lanes_and_as_few(p: Parameters, lanes: dict[str, Any], few: int = FEW) -> tuple[Any, Any]:
    """The first cells of a block, computed as lanes, and the same cells alone."""
    chunks = p.chunks
    many = streams(Block(p, lanes), chunks)
    return many[:few], streams(Block(p, {name: values[:few] for name, values in lanes.items()}), chunks)


@pytest.mark.parametrize("model", MODELS)
def test_few_cells_have_the_bits_of_lanes(model: str) -> None:
    p = Parameters(model=model, periods=25, f_init_ratio=1.5)
    many, few = as_lanes_and_as_few(p, {"f_asym": FORCES})
    assert many == few


@pytest.mark.parametrize("bow", [1, 2, 3, LEAST_LAG - 1, LEAST_LAG, 20, 131, 138])
@pytest.mark.parametrize("model", ["raman", "torsion_absorbed"])
def test_the_bow_may_be_anywhere(bow: int, model: str) -> None:
    p = Parameters(model=model, bow_bridge=bow, periods=10)
    many, few = as_lanes_and_as_few(p, {"f_asym": FORCES})
    assert many == few


@pytest.mark.parametrize(("first", "tail_first"), [(1, 2), (2, 2), (5, 3), (5, 30)])
def test_every_side_may_have_a_tail_early_and_late(first: int, tail_first: int) -> None:
    late = f"first={first} taps=-0.4,-0.2 tail=-0.05 pole=0.8 tail_first={tail_first} tail_taps=0.5,0.5"
    soon = "first=9 taps=-0.5,-0.3 tail=-0.01 pole=0.9 tail_first=30"
    ahead = "first=100 taps=-0.6 tail=-0.02 pole=0.9 tail_first=101 tail_taps=0.2,0.3,0.5"
    p = Parameters(
        model="delta_cremer",
        bridge_function=soon,
        nut_function=ahead,
        torsion_bridge_function=late,
        torsion_nut_function=ahead,
        periods=10,
    )
    many, few = as_lanes_and_as_few(p, {"f_asym": FORCES})
    assert many == few


def test_what_differs_between_few_cells_is_each_cells_own() -> None:
    lanes = {
        "bow_bridge": np.array([5.0, 30.0, 9.0, 70.0, 15.0, 110.0]),
        "tau_f": np.geomspace(5, 5000, 6),
        "stiffness_b": np.geomspace(1e-6, 3e-4, 6),
    }
    many, few = as_lanes_and_as_few(Parameters(f_asym=2.5, periods=10), lanes)
    assert many == few
    assert len({cell[0] for cell in few}) == FEW


EXTRAS: dict[str, dict[str, Any]] = {
    "everything": {
        "string": "violin_a",
        "v_unit": 0.1,
        "force": 0.3,
        "friction": "thermal",
        "hair": "hair_soft",
        "body": "stoppani",
        "bridge": "rigid",
        "beta": 0.1031,
    },
    "body near the bow": {"model": "delta_cremer", "string": "violin_g", "body": "signature", "beta": 0.04},
    "Coulomb": {"friction": "coulomb", "body_modes": "440/30/k0.01, 900/20/k0.003"},
    "curve": {"model": "delta_cremer", "friction": "curve", "friction_curve": "0/0.8, 0.1/0.6, 0.4/0.45, 1/0.4, 3/0.5"},
}


@pytest.mark.full
@pytest.mark.parametrize("what", EXTRAS)
def test_every_waveform_of_few_cells_is_that_of_lanes_whatever_the_extras(what: str) -> None:
    p = Parameters.from_mapping({"periods": 10, **EXTRAS[what]})
    ratios = np.linspace(0.5, 2.0, 9)
    blocks = [Block(p, {"f_init_ratio": ratios[:cells]}, trace=True) for cells in (9, 2)]
    for _ in range(p.chunks):
        many, few = (block.advance() for block in blocks)
        assert many.bridge_force[:2].tobytes() == few.bridge_force.tobytes()
        a, b = (block.traces for block in blocks)
        assert a is not None and b is not None
        assert a[:, :, :2].tobytes() == b.tobytes()
    assert b[blocks[1].trace_names.index("slipping")].any()


def test_chunks_that_are_computed_ahead_are_those_of_their_time(monkeypatch: pytest.MonkeyPatch) -> None:
    p = Parameters(model="delta_cremer", periods=35, f_asym=3.0, f_init_ratio=1.5)
    want = simulate(p, p.samples + p.chunk_samples)
    for most in (1, 2 * p.chunk_samples, 10**6):
        monkeypatch.setattr(ahead, "AHEAD", most)
        block = Block(p, {"f_asym": [3.0]}, trace=True)
        kept = []
        for chunk in range(p.chunks + 1):  # one more than the simulation has
            result = block.advance()
            kept.append((result.bridge_force, result.bridge_force.copy()))
            assert block.traces is not None
            part = slice(chunk * p.chunk_samples, (chunk + 1) * p.chunk_samples)
            assert block.traces[TRACES.index("v"), :, 0].tobytes() == want["v"][part].tobytes(), (most, chunk)
            assert result.slipping.tolist() == [int(want["slipping"][part.start - 1]) if chunk else 0]
        assert all(then.tobytes() == now.tobytes() for now, then in kept)
