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
    """Import the library that draws the map, and have it load fonts and formulas: a quarter of a second."""
    with contextlib.suppress(Exception), warnings.catch_warnings(), absent("mpl_toolkits.mplot3d"), uncollected():
        warnings.simplefilter("ignore")  # that there are no pictures in three dimensions
        _leave_out_documentation()
        from bow_sweep.figures.maps import load_fonts

        load_fonts()  # where it fails, draw reports it


def _leave_out_documentation() -> None:
    """Let Matplotlib not list what its classes take, for people at a prompt: that is a third of its import."""
    from matplotlib import artist

    artist.kwdoc = lambda artist: ""
    if hasattr(artist.Artist, "_update_set_signature_and_docstring"):
        artist.Artist._update_set_signature_and_docstring = classmethod(lambda _: None)


def draw(result: MapFile, picture: Path) -> str:
    """Draw a map into a file; return why that cannot be done, or ""."""
    try:
        from bow_sweep.figures.maps import draw_map  # needs matplotlib: without it only the picture is missing

        draw_map(result, picture)
    except Exception as error:  # whatever a library raises: no other result depends on the picture
        return str(error) or type(error).__name__
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
            answer = json.dumps(draw(read_map_npz(written), picture)).encode()
            try:
                channel.send(answer)
            except OSError:  # the coordinator has ended, or does not wait any more
                picture.unlink(missing_ok=True)
                break
            gc.collect()  # the parts of a figure refer to each other
    return 0


class Painter:
    """Asks the process for a picture, which is drawn into a file beside its own until it is complete.

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
        self._picture = picture
        self._aside = picture.with_name(f".{picture.stem}.drawn{picture.suffix}")
        try:
            self._channel.send(json.dumps([str(written), str(self._aside)]).encode())
        except OSError:
            return False
        return True

    def problem(self) -> str | None:
        """Return why there is no picture, "" if there is one; None if the process has ended or does not answer.

        One that does not answer is not asked again: a late answer must not be taken for that of the next run.
        """
        try:
            answer = self._channel.recv(LONGEST)
        except OSError:
            answer = b""
        if not answer:
            self.close()
            self._aside.unlink(missing_ok=True)
            return None
        why = str(json.loads(answer))
        if not why:
            try:
                self._aside.replace(self._picture)
            except OSError as error:
                self._aside.unlink(missing_ok=True)
                return str(error)
        return why

    def close(self) -> None:
        """Ask for no more pictures."""
        self._channel.close()
