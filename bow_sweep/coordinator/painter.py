"""The picture of a run, and the process that draws it beside the coordinator, where `bow sweep` has started one.

It loads the picture's libraries while the graph starts, on a core that waits then, and draws while the coordinator
writes the other results. If it dies or hangs, the coordinator draws the picture itself.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import socket
import warnings
from pathlib import Path

from bow_sim.graph.environment import PAINTER_SOCKET
from bow_sim.graph.imports import absent, uncollected
from bow_sweep.maps.map_file import MapFile, read_map_npz

ANSWER_S = 5.0
"""So long the coordinator waits for a picture, which takes a quarter of a second: it sends no heartbeats meanwhile."""

LONGEST = 1 << 16
"""Bytes of a message: the paths of map and picture, or why there is no picture."""


def prepare() -> None:
    """Import the library that draws the map, which takes a fifth of a second."""
    with contextlib.suppress(Exception), warnings.catch_warnings(), absent("mpl_toolkits.mplot3d"), uncollected():
        warnings.simplefilter("ignore")  # that there are no pictures in three dimensions
        _leave_out_signatures()
        from bow_sweep.figures import maps  # noqa: F401  # where it fails, draw reports it


def _leave_out_signatures() -> None:
    """Let Matplotlib not describe what `set` takes for each of its classes, for people at a prompt.

    That is a quarter of its import.
    """
    from matplotlib.artist import Artist

    if hasattr(Artist, "_update_set_signature_and_docstring"):
        Artist._update_set_signature_and_docstring = classmethod(lambda _: None)


def draw(result: MapFile, picture: Path) -> str:
    """Draw a map into a file; return why there is no picture, or ""."""
    try:
        from bow_sweep.figures.maps import draw_map  # needs matplotlib: without it only the picture is missing

        draw_map(result, picture)
    except Exception as error:  # whatever a library raises: no other result depends on the picture
        with contextlib.suppress(OSError):
            picture.unlink(missing_ok=True)  # it may show an earlier state of the run
        return f"{picture}: {error or type(error).__name__}"
    return ""


def serve(descriptor: int) -> int:
    """Draw the pictures that are asked for until the other end is closed; return 0, the exit status.

    Parameters
    ----------
    descriptor
        Of a socket of type SOCK_SEQPACKET.
    """
    prepare()
    gc.freeze()
    with socket.socket(fileno=descriptor) as channel:
        while asked := channel.recv(LONGEST):
            written, picture = map(Path, json.loads(asked))
            channel.send(json.dumps(draw(read_map_npz(written), picture)).encode())
            gc.collect()  # the parts of a figure refer to each other
    return 0


class Painter:
    """Asks the process for a picture.

    Parameters
    ----------
    descriptor
        Of the other end of its socket.
    """

    def __init__(self, descriptor: int) -> None:
        self._channel = socket.socket(fileno=descriptor)
        self._channel.settimeout(ANSWER_S)

    @classmethod
    def given(cls) -> Painter | None:
        """Return the one that the parent of this process has started for it; None if there is none."""
        descriptor = os.environ.pop(PAINTER_SOCKET, "")
        return cls(int(descriptor)) if descriptor else None

    def ask(self, written: Path, picture: Path) -> bool:
        """Have the map in a file ``map.npz`` drawn; return False if the process has ended."""
        try:
            self._channel.send(json.dumps([str(written), str(picture)]).encode())
        except OSError:
            return False
        return True

    def problem(self) -> str | None:
        """Return why there is no picture, "" if there is one; None if the process has ended or does not answer."""
        try:
            answer = self._channel.recv(LONGEST)
        except OSError:
            return None
        return str(json.loads(answer)) if answer else None

    def close(self) -> None:
        """Ask for no more pictures."""
        self._channel.close()
