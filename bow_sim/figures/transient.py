"""The files of `bow transient`: the waveforms of one cell as arrays and picture, and a summary."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bow_sim.atomic_files import replacing
from bow_sim.physics.motion import regular_from, slip_onsets
from bow_sim.physics.parameters import Parameters

Waveforms = Mapping[str, np.ndarray]
"""As :func:`bow_sim.kernel.block.transient` returns them: name -> (samples,)."""


def describe(parameters: Parameters, waveforms: Waveforms) -> str:
    """Return a summary of the transient, in a line."""
    onset = regular_from(waveforms["slipping"], parameters.period)
    slips = len(slip_onsets(waveforms["slipping"]))
    begin = f"{parameters.model}, {len(waveforms['v'])} samples, {slips} slips: "
    if onset is None:
        return begin + "no regular one-slip-a-period motion by the end"
    return begin + f"one slip a period from slip onset {onset} on (period {onset / parameters.period:.1f})"


def save_npz(path: Path, parameters: Parameters, waveforms: Waveforms) -> None:
    """Write the waveforms and the settings as a NumPy archive."""
    arrays: dict[str, Any] = {"settings": np.array(parameters.settings()), **waveforms}
    with replacing(path) as file:
        np.savez_compressed(file, **arrays)


def check_plot(path: Path) -> None:
    """Raise ValueError if the suffix of a picture is not .png, .svg or .pdf."""
    if path.suffix not in (".png", ".svg", ".pdf"):
        raise ValueError(f"--plot {path}: should end in .png, .svg or .pdf")


def draw(path: Path, parameters: Parameters, waveforms: Waveforms) -> None:
    """Draw surface velocity, bridge force and friction force over time, as in Fig 6.

    Raises
    ------
    ValueError
        If the suffix is not .png, .svg or .pdf.
    """
    check_plot(path)
    from matplotlib.figure import Figure

    rows = {
        "v": "surface velocity $v$ / $v_b$",
        "bridge_force": "bridge force",
        "friction_force": "friction force $f$",
    }
    figure = Figure(figsize=(11, 7), layout="constrained")
    axes = figure.subplots(len(rows), 1, sharex=True)
    periods = np.arange(len(waveforms["v"])) / parameters.period
    for axis, (name, label) in zip(axes, rows.items(), strict=True):
        axis.plot(periods, waveforms[name], lw=0.6, color="#1f4e79")
        axis.set_ylabel(label)
        axis.margins(x=0)
        axis.grid(alpha=0.25)
    axes[-1].set_xlabel("time (nominal periods)")
    p = parameters
    axes[0].set_title(
        f"{p.model.replace('_', '/')}, $v_{{mid}}$ = {p.v_mid:g}, $f_{{asym}}$ = {p.f_asym:g}, "
        f"$f_{{init}}/f_{{asym}}$ = {p.f_init_ratio:g}, $\\beta$ = {p.bow_bridge}/{p.period}"
    )
    with replacing(path) as file:
        figure.savefig(file, format=path.suffix[1:], dpi=150)
