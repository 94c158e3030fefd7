"""The user's web browser."""

from __future__ import annotations

import os
import threading
import webbrowser
from collections.abc import Callable

_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")


def open_in_browser(address: str, failed: Callable[[str], None]) -> None:
    """Open an address in the user's browser, without waiting for it.

    Parameters
    ----------
    address
        URL.
    failed
        Called with the reason where there is no browser, maybe from another thread.
    """
    if not any(os.environ.get(name) for name in _DISPLAYS):
        failed("there is no display here")  # a browser for terminals would take over this one
        return
    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        failed("no browser is found")
        return

    def run() -> None:  # some browsers are waited for until they are closed
        try:
            opened = browser.open(address)
        except (OSError, webbrowser.Error):
            opened = False
        if not opened:
            failed("the browser could not be started")

    threading.Thread(target=run, name="browser", daemon=True).start()
