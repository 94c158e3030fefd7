"""Where a measure of playability is best: parameters are asked for, a small map is made, its measure is told.

The optimiser is Optuna's tree-structured Parzen estimator (Bergstra et al., Adv. Neural Inf. Process. Syst. 24, 2011),
which bears noise, and needs some tens of maps for a few parameters. With the same seed and the same answers it asks the
same questions, so a search that was interrupted goes on by asking and answering again.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from bow_sim.atomic_files import replacing
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import parse_settings
from bow_sweep.maps.playability import MEASURES
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run.directory import SEARCH
from bow_sweep.study.asked import read_asked, write_asked
from bow_sweep.study.over import SCALES, Range
from bow_sweep.study.plan import Member, run_name
from bow_sweep.study.statistics import LEVEL, Measured, p_value

SEARCH_REPORT = "optimise.json"
FORMAT = 1

TRIALS, MOST_TRIALS = 30, 2000
RANDOM = 10
"""Maps at random places before the optimiser learns from them, at most a third of all."""

HIGHEST, LOWEST = "highest", "lowest"

GOALS = {
    "helmholtz": HIGHEST,
    "largest_area": HIGHEST,
    "median_transient": LOWEST,
    "spread_transient": LOWEST,
    "boundary": LOWEST,
    "black": LOWEST,
    "smooth": HIGHEST,
    "safe_speckle": HIGHEST,
    "speckle": LOWEST,
    "streaky": LOWEST,
}
"""What is easier to play, for each measure."""


class NoOptuna(ImportError):
    """Optuna is not installed; the message says how to install it."""


@dataclass(frozen=True)
class Search:
    """A search for the place where a measure is best.

    Attributes
    ----------
    preset, settings
        As of :class:`bow_sweep.study.plan.Study`.
    ranges
        The parameters that are changed.
    measure
        Name of one of `bow_sweep.maps.playability.MEASURES`.
    goal
        `HIGHEST` or `LOWEST`.
    trials
        Number of maps.
    seed
        Of the optimiser.
    """

    preset: str
    settings: tuple[str, ...]
    ranges: tuple[Range, ...]
    measure: str
    goal: str
    trials: int = TRIALS
    seed: int = 0

    def check(self) -> None:
        """Raise ParameterError where the search cannot be: it names what is wrong, and what would be right."""
        if not self.ranges:
            raise ParameterError("a search changes a parameter: --over NAME=FIRST:LAST")
        names = [each.name for each in self.ranges]
        given = parse_settings(self.settings)
        for name in names:
            if names.count(name) > 1:
                raise ParameterError(f"--over {name}: is given twice; should be once")
            if name in given:
                raise ParameterError(f"--over {name}: is also given for all maps; should be one of the two")
        if self.measure not in GOALS:
            raise ParameterError(f"--measure {self.measure}: no such measure; one of {', '.join(GOALS)}")
        if not 1 <= self.trials <= MOST_TRIALS:
            raise ParameterError(f"--trials {self.trials}: should be 1 ... {MOST_TRIALS}")
        if not 0 <= self.seed < 1 << 32:
            raise ParameterError(f"--seed {self.seed}: should be 0 ... {(1 << 32) - 1}")
        for ends in ("low", "high"):
            self.trial(0, {each.name: each.text(getattr(each, ends)) for each in self.ranges})

    def trial(self, number: int, values: Mapping[str, str]) -> Member:
        """Return a map of the search.

        Raises
        ------
        ParameterError
            Where it cannot be.
        """
        settings = [*self.settings, *(f"{name}={value}" for name, value in values.items())]
        try:
            sweep = Sweep.from_spec(self.preset, settings)
        except ParameterError as error:
            at = ", ".join(f"{name} = {value}" for name, value in values.items())
            raise ParameterError(f"at {at}: {error}") from None
        return Member(run_name(number, len(str(self.trials - 1)), values), values, sweep)

    def worst(self, sweep: Sweep) -> float:
        """Return what is told where a map has no value of the measure, as no transient."""
        return -math.inf if self.goal == HIGHEST else float(sweep.parameters.periods)

    def begin(self, directory: Path) -> None:
        """Write what is searched into a directory, so that the search can be resumed."""
        content: dict[str, Any] = {
            "optimise": FORMAT,
            "preset": self.preset,
            "settings": list(self.settings),
            "over": [{"name": r.name, "low": r.low, "high": r.high, "scale": r.scale} for r in self.ranges],
            "measure": self.measure,
            "goal": self.goal,
            "trials": self.trials,
            "seed": self.seed,
        }
        write_asked(directory / SEARCH, content)

    @classmethod
    def in_directory(cls, directory: Path) -> Search:
        """Return the search that was begun in a directory.

        Raises
        ------
        RunError
            Where there is none, or its file cannot be read, or is of a later version.
        """

        def build(content: Any) -> Search:
            search = cls(
                str(content["preset"]),
                tuple(str(line) for line in content["settings"]),
                tuple(_range(entry) for entry in content["over"]),
                str(content["measure"]),
                str(content["goal"]),
                int(content["trials"]),
                int(content["seed"]),
            )
            search.check()
            return search

        return read_asked(directory / SEARCH, "search", "optimise", FORMAT, build)


def _range(entry: Mapping[str, Any]) -> Range:
    if entry["scale"] not in SCALES:
        raise ValueError(f"scale {entry['scale']!r}: should be one of {', '.join(SCALES)}")
    return Range(str(entry["name"]), float(entry["low"]), float(entry["high"]), str(entry["scale"]))


class Optimiser:
    """Asks for parameters, and is told what a map with these has given; deterministic.

    Raises
    ------
    NoOptuna
        Where Optuna is not installed.
    """

    def __init__(self, search: Search) -> None:
        try:
            import optuna
        except ImportError:
            right = "pip install 'bow[optimise]', or pip install optuna"
            raise NoOptuna(f"bow optimise needs optuna, which is not installed here; {right}") from None
        from optuna.distributions import FloatDistribution, IntDistribution

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        self._search = search
        sampler = optuna.samplers.TPESampler(seed=search.seed, n_startup_trials=max(1, min(RANDOM, search.trials // 3)))
        goal = optuna.study.StudyDirection.MAXIMIZE if search.goal == HIGHEST else optuna.study.StudyDirection.MINIMIZE
        self._study = optuna.create_study(sampler=sampler, direction=goal)
        self._within: dict[str, Any] = {
            each.name: IntDistribution(int(each.low), int(each.high), log=each.scale == "log")
            if each.whole
            else FloatDistribution(each.low, each.high, log=each.scale == "log")
            for each in search.ranges
        }
        self._asked: Any = None

    def ask(self) -> dict[str, str]:
        """Return the parameters of the next map: name -> value, as settings are written."""
        self._asked = self._study.ask(self._within)
        return {each.name: each.text(self._asked.params[each.name]) for each in self._search.ranges}

    def tell(self, value: float) -> None:
        """Say what the map has given that was asked for last; an infinite value is a failure."""
        import optuna

        if math.isfinite(value):
            self._study.tell(self._asked, value)
        else:
            self._study.tell(self._asked, state=optuna.trial.TrialState.FAIL)


class Trial(NamedTuple):
    """A map of a search that is finished."""

    run: str
    values: Mapping[str, str]
    found: Measured


def best(search: Search, trials: Sequence[Trial]) -> int | None:
    """Return the index of the best trial, the first of equal ones; None where none has a value."""
    known = [(trial.found.value, index) for index, trial in enumerate(trials) if trial.found.value is not None]
    if not known:
        return None
    sign = -1 if search.goal == HIGHEST else 1
    return min(known, key=lambda each: (sign * each[0], each[1]))[1]


def as_good(trials: Sequence[Trial], index: int) -> list[int]:
    """Return the trials of which it is not known that they are worse than one: by Welch's t test at `LEVEL`."""
    found = []
    for number, trial in enumerate(trials):
        p = p_value(trials[index].found, trial.found)
        if number != index and p is not None and p > LEVEL:
            found.append(number)
    return found


def write_report(directory: Path, search: Search, trials: Sequence[Trial]) -> dict[str, Any]:
    """Write optimise.json: every trial, and the best; return its contents."""
    top = best(search, trials)
    content: dict[str, Any] = {
        "optimise": FORMAT,
        "measure": search.measure,
        "goal": search.goal,
        "trials": [
            {"run": each.run, "values": dict(each.values), "value": each.found.value, "error": each.found.error}
            for each in trials
        ],
        "planned": search.trials,
        "best": None if top is None else trials[top].run,
        "as_good": [] if top is None else [trials[number].run for number in as_good(trials, top)],
    }
    with replacing(directory / SEARCH_REPORT) as file:
        file.write(json.dumps(content, indent=2).encode() + b"\n")
    return content


assert set(GOALS) == {measure.name for measure in MEASURES}
