"""The sweeps that the claims are about: what `bow validate --beyond` runs through the graph, and how maps are found."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from bow_classifier.verdict.thresholds import THRESHOLD_PRESETS
from bow_sim.physics.reflection import Reflection, gaussian
from bow_sweep.maps.map_file import MAP, MapFile, MapFileError, read_map
from bow_sweep.plan.sweep import Sweep

WOLF_N, WOLF_BRIDGE = 128, 24
"""Period and round trip bow-bridge-bow of the wolf of 1983, samples."""

PAPER_F_0 = 440.0
"""Nominal frequency of the paper's string, 61160 Hz over 139 samples, Hz."""


JUDGED_BY = "trial"
"""The thresholds of all verdicts here: those that the figures were found with which the claims compare with."""

THRESHOLDS = THRESHOLD_PRESETS[JUDGED_BY]


class Wanted(NamedTuple):
    """A sweep that claims are about.

    Parameters
    ----------
    preset : str
        That its settings begin from; "" for the defaults.
    settings : tuple of str
        "name=value" over the preset.
    small : tuple of str
        What is set instead where the maps may be coarse.
    """

    preset: str
    settings: tuple[str, ...]
    small: tuple[str, ...] = ()

    def sweep(self, small: bool = False) -> Sweep:
        """Return the sweep."""
        return Sweep.from_spec(
            self.preset, (*self.settings, f"classifier.preset={JUDGED_BY}", *(self.small if small else ()))
        )


def _text(r: Reflection) -> str:
    return f"first={r.first} taps={','.join(map(repr, r.taps))}"


def _axis(name: str, of: str, scale: str, first: float, last: float, count: int) -> tuple[str, ...]:
    parts = {"name": of, "scale": scale, "first": repr(first), "last": repr(last), "count": str(count)}
    return tuple(f"{name}.{part}={value}" for part, value in parts.items())


def wolf_settings(q: float, kappa: float) -> tuple[str, ...]:
    """Return the string of McIntyre, Schumacher and Woodhouse's wolf (1983): narrow Gaussians at both ends.

    Parameters
    ----------
    q, kappa
        Of the mode, whose frequency is 64/65 of the string's.
    """
    ends = (gaussian(float(delay), 3.0, 1.0, 12) for delay in (WOLF_BRIDGE, WOLF_N - WOLF_BRIDGE))
    bridge, nut = map(_text, ends)
    rate = 61160.0
    return (
        "model=torsion_absorbed",
        "torsion_admittance=0.2",
        f"sample_rate={rate!r}",
        f"period={WOLF_N}",
        f"bow_bridge={WOLF_BRIDGE}",
        f"bridge_function={bridge}",
        f"nut_function={nut}",
        "v_mid=0.0",
        f"body_modes={64 / 65 * rate / WOLF_N!r}/{q!r}/k{kappa!r}",
        "f_init_ratio=1.0",
        "periods=400",
    )


HYPERBOLA = ("friction=hyperbola", "mu_s=0.8", "mu_d=0.3", "v_0=0.1")
THERMAL = ("friction=thermal", "rosin=rosin")
RIGID = ("hair_k=0", "hair_r=0")
WARM = (*THERMAL, "mu_s=1.05")  # in place of the mu_s of a preset


def _guettler(letter: str, *settings: str) -> Wanted:
    return Wanted("guettler_cello", (f"string=cello_g_{letter}", *settings), ("x.count=16", "y.count=16"))


def _schelleng(speed: float, *settings: str) -> Wanted:
    """Return a plane of the preset, with force along x: limits of force are sought in its rows."""
    axes = _axis("x", "force", "log", 0.08, 5.0, 64) + _axis("y", "beta", "linear", 0.02, 0.2, 10)
    start = (f"v_unit={speed!r}", f"speed={speed!r}")
    return Wanted(
        "schelleng_cello", (*start, *settings, *axes), ("x.count=24", "y.first=0.06", "y.last=0.14", "y.count=3")
    )


SPEEDS = (0.05, 0.1, 0.2)
"""Bow speeds of the measured Schelleng planes, m/s."""

STEEL_BRIDGE = (8.0, 22.0)
"""First and last bow position on the steel D string, round trip in samples: beta 0.06 to 0.16."""


def _steel(speed: float) -> Wanted:
    axes = _axis("x", "force", "log", 0.125 * speed, 33.0 * speed, 80) + _axis(
        "y", "bow_bridge", "linear", *STEEL_BRIDGE, 8
    )
    start = ("string=violin_d_steel", f"v_unit={speed!r}", "bridge=monochord", "periods=100", *SUSTAINED)
    return Wanted("", (*start, *THERMAL, *axes), ("x.count=24", "y.count=2"))


SUSTAINED = ("sustained=0.6", "tau_f=1500.0")
"""A force that comes from 0.6 of Schelleng's maximum."""

JITTERS = {f"repeats_{jitter:.0e}": jitter for jitter in (1e-6, 1e-4, 1e-3, 1e-2)}
"""Sweep -> jitter of its repeats."""

EDGES = {
    "edge_1": "stiff -2, f 8",
    "edge_2": "stiff 0.9, f 3.7",
    "edge_3": "stiff 0.2, f 1.2",
    "edge_4": "delta 0.2, f 2",
    "edge_5": "delta -2, f 3",
}
"""Sweep along the ratio of the forces -> model, v_mid and force."""


def _wolf(q: float, kappa: float) -> Wanted:
    axes = _axis("x", "f_asym", "linear", 0.8, 6.0, 53) + _axis("y", "body_scale", "linear", 0.0, 1.0, 2)
    return Wanted("", wolf_settings(q, kappa) + axes, ("x.count=14",))


PAPER_STIFFNESS = ("stiffness_b=5e-05",)
"""Stiffness of the paper's string, which the trial's strings of a violin had too: see docs/validation.md."""

FROM_7 = f"sustained={7 * 1.617 * 15 / 139 * 0.5!r}"
"""Start at a bow force of 7, over Schelleng's maximum v_b/(Y beta (mu_s - mu_d)) of the paper's bow."""


def _notes(*settings: str) -> Wanted:
    axes = _axis("x", "f_asym", "log", 0.08, 8.0, 21) + _axis("y", "semitone", "linear", 0.0, 24.0, 25)
    return Wanted("playability", (FROM_7, *settings, *axes), ("x.count=15",))


def _edge(title: str) -> Wanted:
    words = title.replace(",", "").split()
    force = float(words[3])
    axes = _axis("x", "f_init_ratio", "linear", 0.02, 2.0, 24) + _axis("y", "f_asym", "linear", force, force, 1)
    return Wanted("", (f"model={words[0]}_cremer", f"v_mid={words[1]}", "periods=100", *axes))


SWEEPS: dict[str, Wanted] = {
    "wolf": _wolf(30.0, 0.02),
    "wolf_q50": _wolf(50.0, 0.01),
    "mode_at_f_0": Wanted(
        "",
        (
            "v_mid=0.2",
            "periods=150",
            "f_init_ratio=1.0",
            f"body_modes={PAPER_F_0!r}/30/k0.003",
            *_axis("x", "f_asym", "log", 0.5, 20.0, 65),
            *_axis("y", "body_scale", "linear", 0.0, 1.0, 2),
        ),
        ("x.count=17",),
    ),
    **{f"guettler_{letter}": _guettler(letter) for letter in "abcd"},
    "guettler_rigid": _guettler("b", *RIGID),
    "guettler_thermal": _guettler("b", *RIGID, *WARM),
    **{f"schelleng_thermal_{speed:g}": _schelleng(speed) for speed in SPEEDS},
    **{f"schelleng_hyperbola_{speed:g}": _schelleng(speed, *HYPERBOLA) for speed in SPEEDS},
    "least_force": Wanted(
        "",
        (
            "v_mid=0.2",
            "periods=150",
            "body=wolf_83",
            "sustained=0.698",  # f = 8 at the paper's bow position
            "tau_f=2500.0",
            *_axis("x", "f_asym", "log", 0.2, 8.0, 80),
            *_axis("y", "body_1_ratio", "linear", 0.8, 1.25, 10),
        ),
        ("x.count=40",),
    ),
    "f_max": Wanted(
        "",
        (
            "v_mid=0.2",
            "periods=100",
            *SUSTAINED,
            *_axis("x", "f_asym", "log", 8.0, 48.0, 81),
            *_axis("y", "bow_bridge", "linear", 5.0, 10.0, 6),
        ),
        ("x.count=40",),
    ),
    "stoppani": _notes(*PAPER_STIFFNESS),
    "stoppani_own": _notes(),
    **{f"steel_{speed:g}": _steel(speed) for speed in SPEEDS},
    **{
        name: Wanted(
            "",
            (
                "v_mid=0.2",
                "repeats=2",
                f"jitter={jitter!r}",
                *_axis("x", "f_asym", "log", 0.5, 20.0, 16),
                *_axis("y", "f_init_ratio", "linear", 0.0, 2.0, 8),
            ),
            ("x.count=8", "y.count=4"),
        )
        for name, jitter in JITTERS.items()
    },
    **{name: _edge(title) for name, title in EDGES.items()},
}
"""The sweeps by name, in the order in which they are run."""


NO_MATTER = ("block_cells", "string_length")
"""Settings on which no motion depends."""


def _values(sweep: Sweep) -> dict[str, str]:
    return dict(line.partition("=")[::2] for line in sweep.settings())


def differences(plane: MapFile, sweep: Sweep) -> list[str]:
    """Return the settings of a map that are not those of a sweep, as "name = value, should be value"."""
    own, given = _values(sweep), _values(Sweep.from_spec()) | plane.values  # a map that is older has fewer settings
    names = sorted(name for name in own if name not in NO_MATTER)
    return [f"{name} = {given.get(name)}, should be {own[name]}" for name in names if given.get(name) != own[name]]


def find(directory: Path, names: Iterable[str], small: bool = False) -> dict[str, MapFile]:
    """Return the maps of finished runs in a directory, by the name of their sweep, which is that of their folder.

    Raises
    ------
    MapFileError
        Where a folder has the name of a sweep and a map of another one.
    """
    found = {}
    for name in names:
        run = directory / name
        if not (run / MAP).exists():
            continue
        plane = read_map(run)
        if wrong := differences(plane, SWEEPS[name].sweep(small)):
            more = f" and {len(wrong) - 1} more" if len(wrong) > 1 else ""
            raise MapFileError(f"{run}: not the sweep {name}: {wrong[0]}{more}; remove it, or give another directory")
        found[name] = plane
    return found
