"""How well wolves are found: `python -m studies.wolves` measures it, for docs/verdicts.md.

Strings as that of McIntyre, Schumacher and Woodhouse (1983), with a mode of random mass, Q and frequency under a random
bow force, 400 periods. The truth comes from what the classifier does not see: the velocity of the bridge, and 250
periods in place of 100. The confidence of a wolf in bow_classifier/verdict/confidence.py is the one given here.
"""

from __future__ import annotations

import argparse
import itertools
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_classifier.verdict.regimes import REGIMES
from bow_sim.kernel.block import Block
from bow_sim.physics.parameters import CHUNK_PERIODS, Parameters, parse_settings
from bow_sweep.beyond.measures import beat
from bow_sweep.beyond.sweeps import wolf_settings
from bow_sweep.maps.in_process import judged_chunks
from bow_sweep.maps.slips import Pieces, join
from tools.doc_page import put

ROOT = Path(__file__).resolve().parent.parent
SEED = 1983
AT_ONCE = 64
LOOKED_AT = 250
SHARE, CHANGES, CLEAR = 0.1, 15, 0.5
"""A wolf: least share of periods with one slip and of others, least number of changes (6 in 100 periods are 15 here),
and least height of the autocorrelation of the bridge velocity's r.m.s. over 250 periods."""
SLIP = 0.1
BEATS = (0, 5, 10, 20, 29, LOOKED_AT // 2)


class Found(NamedTuple):
    """Of each string: whether it is a wolf, and its beat in periods; whether it is called one, and with what beat."""

    wolf: NDArray[np.bool_]
    beat: NDArray[np.float64]
    called: NDArray[np.bool_]
    said: NDArray[np.float64]


def strings(count: int) -> dict[str, NDArray[np.float64]]:
    """Return forces, and kappa, Q and frequency (Hz) of the mode, of some strings, all but the last on log scales."""
    rng = np.random.default_rng(SEED)
    p = _string()
    ranges = {"f_asym": (0.8, 7.0), "body_1_k": (0.003, 0.04), "body_1_q": (15.0, 80.0), "body_1_f": (0.94, 1.04)}
    drawn = {name: np.exp(rng.uniform(math.log(low), math.log(high), count)) for name, (low, high) in ranges.items()}
    return {**drawn, "body_1_f": drawn["body_1_f"] * p.sample_rate / p.period}


def _string() -> Parameters:
    return Parameters.from_mapping(parse_settings(wolf_settings(30.0, 0.02)))


def examine(lanes: dict[str, NDArray[np.float64]]) -> Found:
    """Simulate and classify strings, and look at the velocity of their bridges."""
    p, count = _string(), len(lanes["f_asym"])
    chunks, verdicts = zip(*judged_chunks(p, lanes), strict=True)
    pieces = [Pieces(each.slipping, each.offsets, each.onset, each.duration, each.slip) for each in chunks]
    verdict = verdicts[-1]
    slips, velocity = join(pieces, p.chunk_samples), _velocity(p, lanes)
    wolf, beats = np.zeros(count, bool), np.full(count, np.nan)
    for i in range(count):
        own = slips.of(i)
        ends = own.end[own.slip > SLIP * p.period]
        periods = np.minimum((ends - 1) // p.period, p.periods - 1)
        one = np.bincount(periods, minlength=p.periods)[-LOOKED_AT:] == 1
        beats[i], height = beat(velocity[:, i], p.period)
        changes = np.count_nonzero(one[1:] != one[:-1])
        wolf[i] = SHARE <= one.mean() <= 1 - SHARE and changes >= CHANGES and height > CLEAR
    return Found(wolf, beats, verdict.regime == REGIMES.index("wolf"), verdict.beat.astype(float))


def _velocity(p: Parameters, lanes: dict[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    block = Block(p, lanes, trace=True)
    place, count, parts = block.trace_names.index("bridge_velocity"), len(lanes["f_asym"]), []
    for chunk in range(p.chunks):
        block.advance()
        if chunk * CHUNK_PERIODS >= p.periods - LOOKED_AT:
            assert block.traces is not None
            parts.append(block.traces[place, :, :count].copy())
    return np.concatenate(parts)


def page(found: Found) -> str:
    """Return the table and what follows from it, in Markdown."""
    lines = ["| beat of the bridge velocity, periods | wolves | called so |", "|---|---|---|"]
    for low, high in itertools.pairwise(BEATS):
        there = found.wolf & (found.beat >= low) & (found.beat < high)
        lines.append(f"| {low} to {high} | {there.sum()} | {(there & found.called).sum()} |")
    right, called = int((found.wolf & found.called).sum()), int(found.called.sum())
    share = (right + 1) / (called + 2)
    off = np.abs(found.said - found.beat)[found.wolf & found.called]
    half, most = np.percentile(off, (50, 90))
    return "\n".join(
        [
            *lines,
            "",
            f"Of {len(found.wolf)} strings {found.wolf.sum()} are wolves. {called} are called so, {right} of them "
            f"rightly: a confidence of ({right} + 1)/({called} + 2) = {share:.3f}",
            f"(logit {math.log(share / (1 - share)):.3f}). Half of their beats are at most {half:.2f} periods "
            f"off, nine in ten at most {most:.2f}.",
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1024, help="strings (default: 1024)")
    parser.add_argument("--out", type=Path, default=ROOT / "docs", help="directory of verdicts.md")
    args = parser.parse_args()
    lanes = strings(args.count)
    parts = []
    for first in range(0, args.count, AT_ONCE):
        parts.append(examine({name: values[first : first + AT_ONCE] for name, values in lanes.items()}))
    found = Found(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    put(page(found), args.out / "verdicts.md", "studies/wolves.py")
    print(page(found))


if __name__ == "__main__":
    main()
