"""Exponents and edges of the paper's strings: the tables of docs/chaos.md; run it with `python -m studies.chaos`.

Everything is computed in this process: the six exponents on three grids, which of the six motions become periodic, the
exponents of 192 gestures, the edges of six maps, and the exponents of motions on unstable edges.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from bow_classifier.verdict.regimes import REGIMES
from bow_sim.kernel.block import Block
from bow_sim.physics.parameters import Parameters
from bow_sweep.edges.bisection import Edges, bisect
from bow_sweep.edges.boundary import edges_of
from bow_sweep.edges.exponent import exponent
from bow_sweep.edges.parting import DECISION, GRAIN, KINDS, UNSTABLE
from bow_sweep.maps.in_process import compute, verdicts
from bow_sweep.maps.map_file import MapFile
from bow_sweep.plan.sweep import Sweep

DELTA, STIFF = "delta_cremer", "stiff_cremer"
SIX = ((DELTA, 0.9, 5.5), (DELTA, 0.9, 18), (STIFF, 0.2, 5.5), (STIFF, 0.2, 25), (STIFF, 0.9, 14), (STIFF, -2, 8))
"""Model, v_mid and f_asym of the motions whose exponents are looked at closely."""

MAPS = ((DELTA, 0.9), (STIFF, 0.9), (DELTA, 0.2), (STIFF, 0.2), (DELTA, -2), (STIFF, -2))
"""Model and v_mid of the maps of Fig 11."""

GESTURES, SEED = 32, 15
"""Gestures drawn at random from each map."""

LONG, LOOKED_AT = 20_000, 10
"""Periods in which a motion may become periodic, and periods at its end that are looked for in what is before them."""

BACK = 1e-3
"""r.m.s. difference of bridge forces below which a motion has come back."""


def finer(p: Parameters, times: int) -> Parameters:
    """Return the same string on a finer grid of samples."""
    lengths = {name: getattr(p, name) * times for name in ("period", "bow_bridge", "torsion_half")}
    lengths |= {name: getattr(p, name) * times for name in ("sample_rate", "tau_f", "torsion_width")}
    return p.replace(**lengths, nut_cutoff=p.nut_cutoff / times)


def six() -> None:
    """Print the six exponents, with another kick and on finer grids."""
    for model, v_mid, f_asym in SIX:
        p = Parameters(model=model, v_mid=v_mid, f_asym=f_asym)
        values = [exponent(p).value, exponent(p, seed=1).value, *(exponent(finer(p, k)).value for k in (2, 4))]
        *_, last = verdicts(p.replace(periods=400), {"f_asym": [f_asym]})
        cells = (model, f"{v_mid:g}", f"{f_asym:g}", REGIMES[int(last.regime[0])], *(f"{x:+.3f}" for x in values))
        print(f"| {' | '.join(cells)} |", flush=True)


def lag_of_return(force: NDArray[np.float32], samples: int) -> int | None:
    """Return how many samples before the end the last `samples` of a waveform were there already, nearly; or None."""
    count = len(force) - samples
    last = force[count:].astype(float)
    size = 1 << (len(force) - 1).bit_length()
    shared = np.fft.irfft(np.fft.rfft(force, size) * np.conj(np.fft.rfft(last, size)), size)[:count]
    total = np.concatenate([[0.0], np.cumsum(force.astype(float) ** 2)])
    squares = total[samples : samples + count] - total[:count] + float(last @ last) - 2 * shared
    near = np.flatnonzero(squares < samples * BACK**2)
    return int(count - near[-1]) if len(near) else None


def periodic() -> None:
    """Print from when on each of the six motions repeats itself to the last bit."""
    for model, v_mid, f_asym in SIX:
        p = Parameters(model=model, v_mid=v_mid, f_asym=f_asym, periods=LONG)
        block = Block(p, {"f_asym": [f_asym]})
        force = np.concatenate([block.advance().bridge_force[0].copy() for _ in range(p.chunks)])
        lag = lag_of_return(force, LOOKED_AT * p.period)
        text = "has not come back"
        if lag is not None:
            unequal = np.flatnonzero(force[lag:] != force[:-lag])
            begin = (int(unequal[-1]) + lag) / p.period if len(unequal) else 0.0
            text = f"comes back after {lag} samples; to the last bit from period {begin:.0f} on"
        print(f"{model}, {v_mid:g}, {f_asym:g}: {text}", flush=True)


def drawn() -> None:
    """Print the exponents of gestures drawn at random from the six maps, by regime."""
    random = np.random.default_rng(SEED)
    found: dict[str, list[float]] = {}
    for model, v_mid in MAPS:
        forces = np.exp(random.uniform(np.log(0.5), np.log(20), GESTURES))
        ratios = random.uniform(0, 2, GESTURES)
        p = Parameters(model=model, v_mid=v_mid, periods=300)
        *_, last = verdicts(p, {"f_asym": forces, "f_init_ratio": ratios})
        for force, ratio, regime in zip(forces.tolist(), ratios.tolist(), last.regime.tolist(), strict=True):
            value = exponent(p.replace(f_asym=force, f_init_ratio=ratio), periods=300).value
            found.setdefault(REGIMES[regime], []).append(value)
            if value > 0:
                late = exponent(p.replace(f_asym=force, f_init_ratio=ratio), skip=2000, periods=2000).value
                print(f"{model}, {v_mid:g}, {force:.5f}, {ratio:.5f}: {value:+.4f}, from period 2000 on {late:+.4f}")
    for name, values in found.items():
        ends = f"{min(values):+.3f} | {np.median(values):+.3f} | {max(values):+.3f}"
        print(f"| {name} | {len(values)} | {ends} | {sum(x > 0 for x in values)} |", flush=True)


def edges() -> None:
    """Print the number of edges of each kind of the six maps, and what their decisions have in common."""
    everything = []
    for model, v_mid in MAPS:
        sweep = Sweep.from_spec("", [f"model={model}", f"v_mid={v_mid}", "x.count=64", "y.count=32"])
        found = bisect(sweep, edges_of(MapFile.of(sweep, compute(sweep), ""), "helmholtz"))
        everything.append(found)
        numbers = [str(len(found)), *map(str, found.counts().values())]
        print(f"| {model}, {v_mid:g} | {' | '.join(numbers)} |", flush=True)
    print({name: sum(found.counts()[name] for found in everything) for name in KINDS})

    def joined(values: Callable[[Edges], NDArray[np.float64]], *kinds: int) -> NDArray[np.float64]:
        return np.concatenate([values(found)[np.isin(found.kind, kinds)] for found in everything])

    step = joined(lambda found: found.step[:, -1] / found.period, DECISION, GRAIN)
    late = joined(lambda found: found.settled, DECISION, GRAIN) < 1e-5
    release = joined(lambda found: found.release[:, -1].astype(float), DECISION, GRAIN)
    growth = joined(lambda found: found.growth, UNSTABLE)
    print(f"{late.sum()} of {len(late)} settle below 1e-5; {100 * np.mean(release):.0f} % are releases")
    print(f"{100 * np.mean(step < 5):.0f} % in the first five periods, {100 * np.mean(step < 1):.0f} % in the first")
    print(f"growth of unstable edges {growth.min():.2f} ... {growth.max():.2f}")


def unstable() -> None:
    """Print the growth at unstable edges, and the exponent of the motion there for a time."""
    x = ["x.name=f_init_ratio", "x.first=0.02", "x.last=2", "x.count=24", "x.scale=linear"]
    y = ["y.name=f_asym", "y.first=3", "y.last=3", "y.count=1"]
    sweep = Sweep.from_spec("", [f"model={DELTA}", "v_mid=-2", *x, *y])
    found = bisect(sweep, edges_of(MapFile.of(sweep, compute(sweep), ""), "helmholtz"))
    for i in np.flatnonzero(found.kind == UNSTABLE):
        p = sweep.parameters.replace(f_asym=3.0, f_init_ratio=float(found.low[i]))
        near, late = exponent(p, skip=40, periods=30), exponent(p, skip=300, periods=200)
        second = f"{near.value:.2f} ({near.halves[1]:.2f} in the second half)"
        print(f"| {found.low[i]:.5f} | {found.growth[i]:.2f} | {second} | {late.value:.3f} |", flush=True)


PARTS: dict[str, Callable[[], None]] = {
    "six": six,
    "periodic": periodic,
    "drawn": drawn,
    "edges": edges,
    "unstable": unstable,
}


def main() -> None:
    """Print the tables that are asked for, or all."""
    parser = argparse.ArgumentParser(prog="python -m studies.chaos", description=__doc__)
    parser.add_argument("part", nargs="*", choices=[*PARTS, []], help="which tables; all, unless given")
    for name in parser.parse_args().part or PARTS:
        print(f"\n## {name}", flush=True)
        PARTS[name]()


if __name__ == "__main__":
    main()
