"""What `bow sweep` checks and prints of runs that are finished."""

from __future__ import annotations

import json
import shlex
import time
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bow_sim.graph import environment
from bow_sim.physics.parameters import parse_settings
from bow_sim.protocol.recording import DEFAULT
from bow_sweep.cli.terminal import warn
from bow_sweep.maps.reliability import in_words

if TYPE_CHECKING:
    from bow_sweep.record.verify import SelfCheck

MENTIONED_S = 2.0
"""A self-check that takes longer is mentioned."""

SHOWN = 5
"""Problems of a self-check that are printed."""

PLACE = ("file", "block", "chunk")
"""What is printed of their place."""

FILES = {
    "map.png": "the basin map, to look at",
    "map.npz": "the same as arrays",
    "dashboard.rrd": "rerun {path}",
    "bag": "{held}, rosbag2/MCAP: ros2 bag play, rosbags, Foxglove, rerun",
    "report.json": "accounts, versions, parameters",
}
"""Files of a run directory that are for people; the pictures may be missing."""

HELD = {
    "all": "every sample",
    "last": "every verdict, and the samples of the last five periods",
    "verdicts": "every verdict, no samples",
}
"""What is in the bag, by what the run recorded."""


class RunCheck:
    """The check of bag, ledger, map and report of a finished run against each other.

    Parameters
    ----------
    directory
        Run directory.
    print_line
        Called with a line for the user.
    whole
        Read every byte of the bag; otherwise only its index. A run that was resumed is read whole, because what
        happened to its files in between is unknown.
    """

    def __init__(self, directory: Path, print_line: Callable[[str], None], *, whole: bool) -> None:
        self._directory, self._print_line, self._whole = directory, print_line, whole

    @cached_property
    def _check(self) -> SelfCheck:
        from bow_sweep.record.verify import SelfCheck

        return SelfCheck(self._directory, whole=self._whole)

    def begin(self) -> bool:
        """Check what is complete when the bag is closed; return False if that has to be asked again."""
        return self._check.begin()

    def end(self) -> str:
        """Check the rest when all files are complete; return what does not agree, "" where all of it does."""
        from bow_sweep.record.run_bags import unseen_in_words

        began = time.monotonic()
        result = self._check.end()
        took = time.monotonic() - began
        if took > MENTIONED_S:
            self._print_line(f"checking bag, ledger, map and report took {took:.1f} s")
        for line in unseen_in_words(result.get("unseen", {})):
            self._print_line(line)
        if result["ok"]:
            return ""
        lines = [
            ", ".join([problem["what"], *(f"{name} {problem[name]}" for name in PLACE if name in problem)])
            for problem in result["problems"][:SHOWN]
        ]
        run = shlex.quote(str(self._directory))
        return (
            f"the run has {result['problem_count']} problems:\n  " + "\n  ".join(lines) + "\n"
            f"all of them: bow verify {run}\ndamaged blocks are computed again by: bow sweep --resume {run}"
        )


def print_run(directory: Path, left_out: Sequence[Path], *, nothing_to_do: bool) -> bool:
    """Print the summary of a finished run.

    Parameters
    ----------
    directory
        Run directory.
    left_out
        Logs of the processes that the sweep went on without.
    nothing_to_do
        The run was finished before this command.

    Returns
    -------
    bool
        Whether blocks were quarantined.
    """
    found: dict[str, Any] = json.loads((directory / "report.json").read_text())
    nothing = "nothing to do: every block of this run is done or quarantined\n\n" if nothing_to_do else ""
    print_text(nothing + _summary(directory, found, left_out))
    return bool(found["cells"]["quarantined"])


def print_text(text: str) -> None:
    """Print to stdout; where that fails, the sweep is still done."""
    try:
        print(text, flush=True)
    except OSError as error:
        environment.silence("stdout")
        warn(f"the sweep is done, but standard output: {error.strerror}")


def left_out_line(log: Path) -> str:
    """Return what is said of a process that a sweep went on without, by its log."""
    return f"without {log.stem} to its end: see {log}"


def _in_si(found: dict[str, Any]) -> list[str]:
    """Return what all cells share in SI units, as a line, where the run has such units."""
    shared = found.get("si")  # older reports have no such entry
    if not shared:
        return []
    return ["in all cells: " + ", ".join(f"{n} {e['value']:.4g} {e['unit']}".rstrip() for n, e in shared.items())]


def _of_plane(found: dict[str, Any]) -> int:
    """Return how many cells of the plane a run has planned, from its report."""
    return int(found["cells"]["planned"]) // (1 + found.get("repeats", {"repeats": 0})["repeats"])


def _summary(directory: Path, found: dict[str, Any], left_out: Sequence[Path]) -> str:
    cells = found["cells"]
    regimes = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in found["regimes"].items() if count)
    predicted = found.get("cells_predicted", 0)
    whole = f"the map, of which {predicted} cells are predicted" if predicted else "them"
    repeats = found.get("repeats")
    if repeats:
        whole = "the map"
    held = HELD[parse_settings(found["settings"]).get("record", DEFAULT)]
    number = f" ({_of_plane(found)} of the map and their repeats)" if repeats else ""
    lines = [
        f"{cells['done']} of {cells['planned']} cells{number} in {found['wall_seconds']:.1f} s; "
        f"Helmholtz motion in {found['helmholtz_fraction']:.3f} of {whole}",
        f"at the last test: {regimes}",
        *_in_si(found),
        *(in_words(repeats) if repeats else ()),
        *map(left_out_line, left_out),
        "",
        f"{directory}/",
        *(
            f"  {name + '/' * (directory / name).is_dir():15} "
            + what.format(path=shlex.quote(str(directory / name)), held=held)
            for name, what in FILES.items()
            if (directory / name).exists()
        ),
        "",
        f"check it: bow verify {shlex.quote(str(directory))}",
    ]
    if found.get("not_drawn"):  # older reports have no such entry
        lines.insert(2, f"not drawn: {found['not_drawn']}")
    for block, why in found["quarantined_blocks"].items():
        lines.insert(2, f"QUARANTINED block {block}: {why}")
    return "\n".join(lines)
