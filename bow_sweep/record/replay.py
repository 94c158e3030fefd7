"""Classifies a bag again, with the core of the classifier node: its input is the same from a bag and from a live graph.

Here that is done in this process; :mod:`bow_sweep.processes.replay_graph` does it through DDS.

With the thresholds of the run the verdicts must be the recorded ones, byte for byte. With others they are written
beside them, into ``verdicts-<hash>.npz``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bow_classifier.stream import Classifier
from bow_classifier.task import Task
from bow_classifier.verdict.regimes import REGIMES
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.atomic_files import replacing
from bow_sim.physics.parameters import parse_settings
from bow_sim.protocol import cdr
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sim.protocol.verdict_fields import differing
from bow_sweep.maps.basin_map import transient_lengths
from bow_sweep.maps.reliability import Reliability
from bow_sweep.record.bag import FOLDER, BagError, bag_files, bag_of, bags_in, label, run_of_bag, station_of_bag
from bow_sweep.record.bag_contents import Chunks, Key, Progress, Survey, empty_layers, put
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.notes import too_new, version_in
from bow_sweep.record.run_bags import read_run

Classify = Callable[[Survey, Task], Iterator[tuple[Key, dict[str, Any]]]]
"""Yields (chunk, fields of Verdicts) for the chunks of a bag; of each block those before the first incomplete chunk."""

SCAN_SHARE = 0.4
"""Share of reading the bag in the work; the rest is to classify it."""


def load_verdicts(run_directory: Path) -> dict[str, np.ndarray]:
    """Return the verdicts recorded in the bags of a run, even while it is being written or repaired.

    Returns
    -------
    dict
        ``correlation``, ``period``, ``confidence`` float32 (NaN where there is none), ``slips``, ``corners`` uint16,
        ``regime`` uint8 (255 where there is none), ``tested`` bool; each (tests, cells).

    Raises
    ------
    BagError
        Where there is no bag, or no plan in it.
    """
    layers: dict[str, np.ndarray] = {}
    for directory in bags_in(bag_of(run_directory)).values():
        layers = _load_bag(directory, layers)
    if not layers:
        raise BagError(f"{run_directory}: its bag holds no plan, so no verdicts can be placed")
    return layers


def _load_bag(directory: Path, layers: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Put the verdicts of one bag into arrays, which are made at its first plan where there are none; return them."""
    expected: SweepOutline | None = None
    for path in bag_files(directory):
        scan = Scan(path)
        try:
            for found in scan.messages():
                if why := too_new(version_in(scan.notes)):
                    raise BagError(f"{path}: {why}")
                message = label(scan.contents, found, path)
                if message.topic == "plan":
                    plan = cdr.decode("Plan", message.data)
                    expected = expected.followed(plan) if expected else SweepOutline.of(plan)
                    layers = layers or empty_layers(expected)
                elif message.topic == "verdicts" and expected is not None:
                    try:
                        values = expected.unseal("Verdicts", message.data)
                    except cdr.WireError:
                        continue  # `bow verify` reports it; here these cells are not tested
                    put(layers, expected, (values["block"], values["chunk"]), values)
        except OSError:
            continue  # its torn end is being cut off; no complete message was in it
    return layers


def classify_block(survey: Survey, task: Task, block: int, chunks: Chunks) -> Iterator[tuple[Key, dict[str, Any]]]:
    """Classify the recorded streams of a block: yield (chunk, fields of Verdicts) up to its first incomplete chunk.

    Raises
    ------
    BagError
        Where the classifier refuses a recorded chunk; the message states why.
    """
    classifier = Classifier("0" * 16)
    classifier.open(task)
    for chunk in range(task.outline.chunks):
        force, slip = (survey.places[topic].get((block, chunk)) for topic in ("bridge_force", "stick_slip"))
        if force is None or slip is None:
            return
        out = classifier.take("BridgeForce", chunks.read(force)) + classifier.take("StickSlip", chunks.read(slip))
        if len(out) != 1:
            why = "; ".join(classifier.complaints) or "it gave no verdict"
            raise BagError(f"block {block}, chunk {chunk}: the classifier does not take it: {why}")
        yield (block, chunk), cdr.decode("Verdicts", out[0])


def classify_here(survey: Survey, task: Task) -> Iterator[tuple[Key, dict[str, Any]]]:
    """Classify all blocks in this process; yields and raises as :func:`classify_block`."""
    with Chunks() as chunks:
        for block in range(task.outline.blocks):
            yield from classify_block(survey, task, block, chunks)


def task_of(survey: Survey, thresholds: Thresholds | None = None) -> Task:
    """Return the task of the classifier for a recorded run, with other thresholds if given.

    Raises
    ------
    BagError
        Where the bag holds no plan.
    """
    if survey.expected is None:
        raise BagError(f"{survey.directory}: holds no plan")
    task = Task.of(survey.expected)
    return task if thresholds is None else dataclasses.replace(task, thresholds=thresholds)


def changed(thresholds: Thresholds, settings: Iterable[str]) -> Thresholds:
    """Return thresholds changed by "name=value" settings; ``preset=NAME`` changes those of a named set instead.

    Raises
    ------
    ParameterError
        For an unknown or wrong setting.
    """
    given = {name.removeprefix("classifier."): value for name, value in parse_settings(settings).items()}
    base = {} if "preset" in given else dataclasses.asdict(thresholds)
    return Thresholds.from_mapping({**base, **given})


def replay(
    run_directory: Path,
    settings: Iterable[str] = (),
    progress: Progress | None = None,
    classify: Classify = classify_here,
) -> dict[str, Any]:
    """Classify the bag of a run again.

    Parameters
    ----------
    run_directory
        Of the run; or the bag itself.
    settings
        "name=value" changes to the thresholds of the run.
    progress
        Called with (done, total).
    classify
        Classifies the chunks: :func:`classify_here`, or :func:`bow_sweep.processes.replay_graph.classify_in_graph`.

    Returns
    -------
    dict
        For JSON. ``ok``; ``classifier`` and ``recorded_classifier``, hashes; ``chunks`` classified, ``equal`` of them
        as recorded; ``differing``, the first chunks that are not; ``cells``, ``helmholtz_fraction``, ``regimes`` at the
        latest test; ``repeats``, what they say, where there are some; ``file``, the new verdict set, or None where
        the thresholds are those of the run; ``unseen``, station -> the blocks that it did and whose bag is not here.
        ``ok`` means that every recorded chunk was classified and, with the thresholds of the run, as recorded.

    Raises
    ------
    BagError
        Where there is no bag, it is damaged, or the classifier refuses a chunk of it.
    ParameterError
        For an unknown or wrong setting.
    """
    survey = read_run(run_directory, progress=progress, share=SCAN_SHARE)
    directory = survey.directory
    stored = [place for places in survey.places.values() for place in places.values()]
    packed = next((place.file for place in stored if place.offset < 0), None)
    if packed is not None:
        raise BagError(f"{packed}: is compressed; bow writes bags that are not, and replays only those")
    if survey.problems:
        first = survey.problems[0]
        raise BagError(f"{directory}: {first['what']} ({first.get('file', '')}); `bow verify` tells more")
    task = task_of(survey)
    if len(task.outline.recorded_chunks) < task.outline.chunks:
        raise BagError(
            f"{directory}: was recorded with record={task.outline.record}: the streams bridge_force and stick_slip of "
            f"{task.outline.chunks - len(task.outline.recorded_chunks)} of {task.outline.chunks} chunks of each block "
            "are not in it, so they cannot be replayed; `bow verify --all` computes them again and derives the same "
            "verdicts, and a sweep with --record all records them"
        )
    recorded = task.thresholds
    task = task_of(survey, changed(recorded, settings))
    assert survey.expected is not None
    layers = empty_layers(survey.expected)
    same, same_hash = task.thresholds == recorded, task.thresholds.hash == survey.plan["classifier"]
    equal, count, unlike = 0, 0, []
    total = len(survey.places["bridge_force"])
    for key, again in classify(survey, task):
        count += 1
        put(layers, survey.expected, key, again)
        known = survey.verdicts.get(key)
        names = ["all: not recorded"] if known is None else differing(known.layers, again)
        if same_hash and known is not None and known.checksum != again["checksum"] and not names:
            names = ["checksum"]  # of all fields
        equal += not names
        if names and same:
            unlike.append({"block": key[0], "chunk": key[1], "layers": names})
        if progress is not None and (count % 64 == 0 or count == total):
            progress(SCAN_SHARE * total + (1 - SCAN_SHARE) * count, total)
    file = None
    if not same_hash:
        file = _write(run_directory, task, layers)
    return {
        "ok": not unlike and count == total and (not same or equal == count),
        "run_id": task.outline.run_id,
        "sweep_id": task.outline.sweep_id,
        "classifier": task.thresholds.hash,
        "recorded_classifier": survey.plan["classifier"],
        "thresholds": list(task.thresholds.settings()),
        "chunks": count,
        "equal": equal,
        "differing": sorted(unlike, key=lambda one: (one["block"], one["chunk"]))[:20],
        **_summary(layers, task.outline, [block for blocks in survey.unseen.values() for block in blocks]),
        "file": str(file) if file else None,
        "unseen": survey.unseen,
    }


def _summary(layers: dict[str, np.ndarray], outline: SweepOutline, unseen: Sequence[int]) -> dict[str, Any]:
    """Return the numbers of cells and regimes; shares and regimes are those of the plane, without repeats.

    They are those of the cells that are not in `unseen` blocks.
    """
    tests, plane = layers["tested"].sum(axis=0), outline.plane_cells
    latest = layers["regime"][np.maximum(tests, 1) - 1, np.arange(len(tests))]
    counts = np.bincount(latest[:plane][tests[:plane] > 0], minlength=len(REGIMES))
    lengths = transient_lengths(layers["regime"], layers["transient"])
    found = Reliability.of(outline.shape, latest, lengths, tests == outline.chunks)
    helmholtz, seen = lengths[:plane] > 0, ~outline.planned.cells_of(unseen)[:plane]
    return {
        "cells": int(np.count_nonzero(tests)),
        "helmholtz_fraction": float(helmholtz[seen].mean()) if seen.any() else 0.0,
        "regimes": {name: int(count) for name, count in zip(REGIMES, counts, strict=False)},
        **({"repeats": found.findings(outline.repeats, helmholtz.reshape(outline.shape))} if found else {}),
    }


def _write(run_directory: Path, task: Task, layers: dict[str, np.ndarray]) -> Path:
    """Write verdicts into a file of the run directory, or beside the bag; return its path."""
    directory = Path(run_directory)
    if not (directory / FOLDER).is_dir():  # `run_directory` is the bag
        directory = run_of_bag(directory) if station_of_bag(directory) else directory.parent
    path = directory / f"verdicts-{task.thresholds.hash}.npz"
    with replacing(path) as file:
        np.savez_compressed(
            file,
            run_id=task.outline.run_id,
            sweep_id=task.outline.sweep_id,
            classifier=task.thresholds.hash,
            thresholds=np.array(task.thresholds.settings()),
            regime_names=np.array(REGIMES),
            **layers,  # type: ignore[arg-type]  # all arrays
        )
    return path
