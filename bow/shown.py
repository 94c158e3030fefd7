"""Pictures and sounds as Python objects: a notebook shows or plays them, a script saves them."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCREEN_DPI = 110
"""Dots an inch of a picture in a notebook."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture; a notebook shows it.

    Attributes
    ----------
    figure
        The Matplotlib figure, to be changed before it is saved.
    caption
        What the picture is of, as text: string, gesture, and everything that is the same in all cells.
    latex
        The same for LaTeX; "" where there is none.
    about
        What is written into the file beside the picture, by the names of PDF: Title, Subject, Keywords.
    """

    figure: Figure
    caption: str = ""
    latex: str = ""
    about: Mapping[str, str] = field(default_factory=dict)

    def save(self, path: str | Path) -> Path:
        """Write the picture; the suffix, .png, .svg or .pdf, sets the format. Return the path.

        Raises
        ------
        FigureError
            For another suffix; it is a ValueError.
        OSError
            Where the file cannot be written.
        """
        from bow_sim.figures.page import check_path, save

        place = check_path(path)
        save(self.figure, place, self.about)
        return place

    def _repr_png_(self) -> bytes:
        from bow_sim.figures.page import style

        file = io.BytesIO()
        with style():
            self.figure.savefig(file, format="png", dpi=SCREEN_DPI)
        return file.getvalue()

    def __repr__(self) -> str:
        width, height = self.figure.get_size_inches() * 25.4
        return f"Picture({width:.0f} x {height:.0f} mm: {self.caption.partition('. ')[0]})"


@dataclass(frozen=True, eq=False)
class Sound:
    """A sound; a notebook plays it.

    Attributes
    ----------
    samples
        (samples,) float32, between -1 and 1.
    rate
        Samples per second.
    how
        How it was made, in words.
    """

    samples: NDArray[np.float32]
    rate: int
    how: str

    @property
    def seconds(self) -> float:
        """Length."""
        return len(self.samples) / self.rate

    def save(self, path: str | Path) -> Path:
        """Write a WAV file, 16 bit; return its path.

        Raises
        ------
        SoundError
            Where the path does not end in .wav; it is a ValueError.
        OSError
            Where the file cannot be written.
        """
        from bow_sweep.cell.sound import save_wav

        place = Path(path)
        save_wav(place, self.samples)
        return place

    def _repr_html_(self) -> str:
        from bow_sweep.cell.sound import wav_bytes

        data = base64.b64encode(wav_bytes(self.samples)).decode()
        return f'<audio controls src="data:audio/wav;base64,{data}"></audio>'

    def __repr__(self) -> str:
        return f"Sound({self.seconds:.2f} s at {self.rate} Hz; {self.how})"
