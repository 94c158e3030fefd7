"""Body, bow hair, friction laws and bow positions between samples agree with the scalar string bit for bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scalar_string import intervals, simulate

from bow_sim.kernel.block import BODY_TRACES, THERMAL_TRACES, TRACES, Block, transient
from bow_sim.physics.parameters import Parameters

SI = {"string": "violin_a", "v_unit": 0.1, "force": 0.3}
EVERYTHING = {**SI, "friction": "thermal", "hair": "hair_soft", "body": "stoppani", "bridge": "rigid", "beta": 0.1031}

CASES: dict[str, dict[str, Any]] = {
    "everything": EVERYTHING,
    "everything, delta": {**EVERYTHING, "model": "delta_cremer", "force": 0.8},
    "coulomb": {"friction": "coulomb", "body_modes": "440/30/k0.01, 900/20/k0.003"},
    "coulomb, rigid ends": {"model": "friedlander", "friction": "coulomb", "body": "wolf_83"},
    "curve": {"model": "delta_cremer", "friction": "curve", "friction_curve": "0/0.8, 0.1/0.6, 0.4/0.45, 1/0.4, 3/0.5"},
    "between samples": {"model": "delta_cremer", "beta": 0.1234},
    "between samples, near the bridge": {"model": "raman", "beta": 0.012},
    "sustained": {"model": "delta_cremer", "sustained": 0.6, "f_init_ratio": 1, "tau_f": 300, "f_asym": 2},
    "between samples, stiff": {"beta": 0.07, "gesture": "guettler"},
}


def bridge_force(p: Parameters, lanes: dict[str, Any], chunks: int) -> list[Any]:
    block = Block(p, lanes)
    return [block.advance() for _ in range(chunks)]


@pytest.mark.parametrize("case", CASES)
def test_every_waveform_agrees_with_the_scalar_string(case: str) -> None:
    p = Parameters.from_mapping({"periods": 10, "f_init_ratio": 1.5, **CASES[case]})
    got, want = transient(p), simulate(p, p.samples)
    body, thermal = "body" in CASES[case] or "body_modes" in CASES[case], p.friction == "thermal"
    assert tuple(got) == TRACES + BODY_TRACES * body + THERMAL_TRACES * thermal
    for name in got:
        assert got[name].tobytes() == want[name].tobytes(), name
    assert got["slipping"].any() and not got["slipping"].all()


LANES: dict[str, np.ndarray] = {
    "hair_r": np.array([3.0, 0.0, 10.0, 1.0, 3.0, 3.0, 0.0, 0.5, 3.0, 2.0]),
    "body_scale": np.linspace(0.0, 2.0, 10),
    "rosin_t_g": np.linspace(15.0, 40.0, 10),
    "beta": np.array([0.1, 15 / 139, 0.03, 0.2, 0.12345, 0.5, 0.04, 0.1, 0.15, 0.11]),
    "f_0": np.linspace(300.0, 700.0, 10),
    "force": np.geomspace(0.1, 2.0, 10),
}


@pytest.mark.full
def test_all_of_it_may_differ_between_the_cells_of_a_block() -> None:
    common = {name: value for name, value in EVERYTHING.items() if name not in LANES}
    p = Parameters.from_mapping({"periods": 10, **common})
    results = bridge_force(p, LANES, 2)
    for cell in range(10):
        one = {name: float(values[cell]) for name, values in LANES.items()}
        alone = bridge_force(p, {name: np.array([value]) for name, value in one.items()}, 2)
        own = Parameters.from_mapping({"periods": 10, **common, **one})
        want = simulate(own, own.samples)
        got = np.concatenate([r.bridge_force[cell] for r in results])
        assert got.tobytes() == want["bridge_force"].astype(np.float32).tobytes(), one
        assert got.tobytes() == np.concatenate([r.bridge_force[0] for r in alone]).tobytes()
        slips = [
            (k, int(r.onset[i]), int(r.duration[i]), float(r.slip[i]))
            for k, r in enumerate(results)
            for i in range(r.offsets[cell], r.offsets[cell + 1])
        ]
        assert slips == intervals(want["slipping"], want["s"], own.chunk_samples)


@pytest.mark.full
def test_a_body_that_cells_share_has_the_bits_of_one_that_each_has_for_itself() -> None:
    p = Parameters.from_mapping({"model": "delta_cremer", "body_modes": "440/30/k0.01, 900/20/k0.003", "periods": 10})
    shared = bridge_force(p, {"f_asym": np.linspace(1, 9, 11)}, 2)
    own = bridge_force(p, {"f_asym": np.linspace(1, 9, 11), "body_scale": np.ones(11)}, 2)
    for a, b in zip(shared, own, strict=True):
        assert a.bridge_force.tobytes() == b.bridge_force.tobytes()


@pytest.mark.parametrize("model", ["delta_cremer", pytest.param("raman", marks=pytest.mark.full)])
def test_cells_may_differ_in_single_modes(model: str) -> None:
    common = {"model": model, "body_modes": "440/30/k0.01, 900/20/k0.003", "periods": 10, "f_asym": 3.0}
    p = Parameters.from_mapping(common)
    ratio, kappa = np.linspace(0.8, 1.25, 9), np.geomspace(0.001, 0.1, 9)
    results = bridge_force(p, {"body_1_ratio": ratio, "body_2_k": kappa}, 2)
    for cell in (0, 4, 8):
        own = p.replace(body_1_ratio=float(ratio[cell]), body_2_k=float(kappa[cell]))
        want = simulate(own, own.samples)["bridge_force"].astype(np.float32)
        assert np.concatenate([r.bridge_force[cell] for r in results]).tobytes() == want.tobytes()


def test_off_is_off() -> None:
    p = Parameters(model="delta_cremer", periods=10)
    plain = bridge_force(p, {"f_asym": [2.0, 5.5]}, 2)
    for lanes in ({"hair_k": [0.0, 5.0]}, {"bow_offset": [0.0, 0.0]}, {"beta": [15 / 139, 15 / 139]}):
        for a, b in zip(plain, bridge_force(p, {"f_asym": [2.0, 5.5], **lanes}, 2), strict=True):
            assert a.bridge_force.tobytes() == b.bridge_force.tobytes()
    without = bridge_force(p, {"f_asym": [2.0, 5.5]}, 2)
    rigid = bridge_force(p.replace(z_0=0.3), {"f_asym": [2.0, 5.5], "hair_r": [0.0, 3.0]}, 2)
    assert all(a.bridge_force[0].tobytes() == b.bridge_force[0].tobytes() for a, b in zip(without, rigid, strict=True))
    assert without[1].bridge_force[1].tobytes() != rigid[1].bridge_force[1].tobytes()
