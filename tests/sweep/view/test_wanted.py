"""What is asked of the dashboard is checked before anything starts."""

from __future__ import annotations

import socket
import sys

import pytest

from bow_sweep.view import wanted as module
from bow_sweep.view.wanted import Wanted, WantedError, has_display, port_problem, wanted

SCREEN = {"DISPLAY": ":0"}


@pytest.mark.parametrize("port", ["99999", "65536", "-1", "x", "", "1.5", "0x50", " 80", "٣", "1" * 400])
def test_a_port_is_a_number_that_there_is(port: str) -> None:
    with pytest.raises(WantedError, match="should be a whole number from 1 to 65535, or 0 for none") as error:
        wanted(False, port, False, SCREEN)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("address", ["127.0.0.1", "0.0.0.0", "::"])
def test_a_port_that_is_taken_is_refused(address: str) -> None:
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    with socket.socket(family) as other:
        try:
            other.bind((address, 0))
        except OSError:
            pytest.skip(f"no {address} here")
        other.listen()
        port = str(other.getsockname()[1])
        with pytest.raises(
            WantedError, match=rf"--port {port}: cannot be used on 127.0.0.1 \(Address already in use\)"
        ):
            wanted(False, port, False, SCREEN)
    assert wanted(False, port, False, SCREEN) == Wanted(True, port=int(port))


def test_a_privileged_port_is_named_as_such(monkeypatch: pytest.MonkeyPatch) -> None:
    class Refused(socket.socket):
        def bind(self, address: object) -> None:
            raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(module.socket, "socket", Refused)
    assert port_problem(80) == "is kept for privileged users; should be 1024 or more"


@pytest.mark.parametrize(("view", "port"), [(True, "0"), (False, "9876"), (True, "9876")])
def test_nobody_views_what_is_left_out(view: bool, port: str) -> None:
    with pytest.raises(WantedError, match="needs the dashboard that --no-dashboard leaves out"):
        wanted(view, port, True, SCREEN)
    assert wanted(False, "0", True, SCREEN) == Wanted(False)


def test_without_a_display_the_map_is_served_and_that_is_said() -> None:
    assert wanted(True, "0", False, SCREEN) == Wanted(True, window=True)
    unseen = wanted(True, "0", False, {"DISPLAY": ""})
    assert (unseen.dashboard, unseen.window) == (True, False)
    assert unseen.port > 1023
    assert wanted(True, "9876", False, {"DISPLAY": ""}).port == 9876
    assert "no display" in unseen.notes[0]
    assert has_display({"WAYLAND_DISPLAY": "wayland-0"})


@pytest.mark.parametrize("how", ["missing", "replaced"])
def test_without_rerun_there_is_no_dashboard_and_that_is_said(how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if how == "missing":
        monkeypatch.setattr(module.importlib.util, "find_spec", lambda _: None)
    else:
        monkeypatch.setitem(sys.modules, "rerun", None)
    found = wanted(False, "0", False, SCREEN)
    assert not found.dashboard
    assert "rerun is not installed" in found.notes[0]
