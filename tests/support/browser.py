"""A real browser, Debian's chromium without a window, and what it says of the page of `bow explore`."""

from __future__ import annotations

import contextlib
import shutil
import time
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
NEEDED = "needs a browser: Debian's chromium"

WAIT_MS = 60_000

_PLACES = """async ([name, points]) => {
    const view = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name(name));
    const places = () => {
        const box = view.el.getBoundingClientRect();
        return points.map(([x, y]) => [box.x + view.frame.x_scale.compute(x), box.y + view.frame.y_scale.compute(y)]);
    };
    let now = places();
    for (let still = 0; still < 4; still++) { // frames in a row without a change: the layout is done
        await new Promise(requestAnimationFrame);
        const next = places();
        if (String(next) !== String(now)) still = 0;
        now = next;
    }
    return now;
}"""

_SHOWN = """([name, wanted]) => {
    const {data} = Bokeh.documents[0].get_model_by_name(name);
    return Object.entries(wanted).every(([column, values]) =>
        data[column].length === values.length && values.every((value, n) => data[column][n] === value));
}"""

_COLUMNS = """(name) => Object.fromEntries(
    Object.entries(Bokeh.documents[0].get_model_by_name(name).data).map(([key, values]) => [key, Array.from(values)])
)"""


class Tab:
    """A page in the browser; what it complains of and what it asks for is collected.

    Attributes
    ----------
    page
        Playwright's page.
    complaints
        Errors and warnings of its console, and uncaught exceptions.
    requests
        Addresses of everything it asked for.
    """

    def __init__(self, page: Any) -> None:
        self.page = page
        self.complaints: list[str] = []
        self.requests: list[str] = []
        page.set_default_timeout(WAIT_MS)
        page.on("console", lambda m: self.complaints.append(m.text) if m.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("websocket", lambda socket: self.requests.append(socket.url))

    def open(self, address: str) -> Tab:
        """Open an address, and wait until everything is drawn."""
        self.page.goto(address)
        self.page.wait_for_function("window.Bokeh?.documents[0]?.is_idle && bow.maps.length > 0")
        return self

    def place(self, figure: str, x: float, y: float) -> tuple[float, float]:
        """Return where a point of a figure is in the window, pixels."""
        [(across, down)] = self._places(figure, [(x, y)])
        return across, down

    def _places(self, figure: str, points: list[tuple[float, float]]) -> list[tuple[float, float]]:
        return [tuple(place) for place in self.page.evaluate(_PLACES, [figure, points])]

    def click_cell(self, ix: int, iy: int, figure: str = "map") -> None:
        """Click the middle of a cell of a map."""
        self.page.mouse.click(*self.place(figure, ix + 0.5, iy + 0.5))

    def chosen(self) -> list[int]:
        """Return the chosen cell of each run."""
        return [int(cell) for cell in self.columns("chosen")["cell"]]

    def columns(self, source: str) -> dict[str, np.ndarray]:
        """Return the data of a source of the page."""
        return {name: np.array(values) for name, values in self.page.evaluate(_COLUMNS, source).items()}

    def until(self, condition: str) -> None:
        """Wait until a condition in JavaScript holds; `model` is Bokeh's lookup by name."""
        self.page.wait_for_function(
            f"(() => {{ const model = name => Bokeh.documents[0].get_model_by_name(name); return {condition}; }})()"
        )

    def until_shown(self, source: str, columns: Mapping[str, np.ndarray]) -> None:
        """Wait until a source of the page has these data: each comes in a message of its own."""
        wanted = {name: np.asarray(values, float).tolist() for name, values in columns.items()}
        self.page.wait_for_function(_SHOWN, arg=[source, wanted])

    def hover(self, figure: str, x: float, y: float, *words: str) -> str:
        """Point at a place of a figure; return what is said there, once the words are in it or `WAIT_MS` is over."""
        self.page.mouse.move(*self.place(figure, x - 0.1, y))
        self.page.mouse.move(*self.place(figure, x, y))
        end = time.monotonic() + WAIT_MS / 1000
        while True:  # at first it may be what was said of the place before
            said = " ".join(" ".join(self.page.locator(".bk-tooltip-content").all_inner_texts()).split())
            if all(word in said for word in words) or time.monotonic() > end:
                return said
            self.page.wait_for_timeout(100)

    def show(self, layer: str, periods: float | None = None) -> None:
        """Show a layer, after a test, as the widgets do."""
        self.page.evaluate("name => { Bokeh.documents[0].get_model_by_name('layer').value = name; }", layer)
        if periods is not None:
            self.page.evaluate("at => { Bokeh.documents[0].get_model_by_name('test').value = at; }", periods)

    def play(self, letter: str = "") -> np.ndarray:
        """Press a play button; return the samples that are played."""
        self.page.evaluate("bow.sound = null")
        self.page.evaluate("document.title")  # one round trip, so that what was clicked before has arrived
        buttons = self.page.get_by_role("button", name="Play")
        buttons.nth(1 if letter == "B" else 0).click()
        self.page.wait_for_function("bow.sound !== null")
        assert self.page.evaluate("bow.sound.rate") == 48_000
        return np.array(self.page.evaluate("Array.from(bow.sound.samples)"))

    def colours(self, figure: str, nx: int, ny: int) -> np.ndarray:
        """Return the colour at the middle of each cell of a map on the screen, (ny, nx, 3) uint8."""
        import io

        from matplotlib.image import imread

        self.page.mouse.move(2, 2)
        picture = imread(io.BytesIO(self.page.screenshot()))
        cells = [(ix + 0.5, iy + 0.5) for iy in range(ny) for ix in range(nx)]
        across, down = np.array(self._places(figure, cells)).astype(int).T
        return np.round(255 * picture[down, across, :3]).astype(np.uint8).reshape(ny, nx, 3)

    def wrong_colours(self, figure: str, wanted: np.ndarray, marked: int) -> list[list[int]]:
        """Return which cells of a map, (iy, ix), have not the colours (ny, nx, 3) when it is drawn.

        The cell `marked` is left out: the mark of the chosen cell is there.
        """
        ny, nx, _ = wanted.shape
        end = time.monotonic() + WAIT_MS / 1000
        while True:
            wrong = (self.colours(figure, nx, ny) != wanted).any(axis=2)
            wrong.ravel()[marked] = False
            if not wrong.any() or time.monotonic() > end:
                return np.argwhere(wrong).tolist()
            self.page.wait_for_timeout(100)


@contextlib.contextmanager
def chromium() -> Iterator[Any]:
    """Start the browser, without a network beyond this machine as far as it can be told."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, timeout=WAIT_MS)
        try:
            yield browser
        finally:
            browser.close()
