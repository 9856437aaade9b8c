"""`Visit`: the workbench as a visitor meets it, in a headless Chromium that a mouse moves in."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Point = tuple[float, float]

_CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
_SIZE = {"width": 1400, "height": 800}  # px
_READY = "document.readyState === 'complete' && window.Bokeh?.documents[0]?.is_idle"
_FLOOR = "Bokeh.documents[0].get_model_by_name('floor')"

# Where a point in metres is on the page, in px.
_AT = f"""([x, y]) => {{
  const view = Bokeh.index.find_one({_FLOOR});
  const box = view.canvas_view.el.getBoundingClientRect();
  return [box.left + view.frame.x_scale.compute(x), box.top + view.frame.y_scale.compute(y)];
}}"""

# From now on, milliseconds from each act of the pointer that goes to Python until what it makes of
# the page has been painted.
_TIME = """() => {
  const [pointer, drawn] = ["pointer", "drawn"].map(
    (name) => Bokeh.documents[0].get_model_by_name(name));
  let sent = 0;
  window.redraws = [];
  pointer.properties.data.change.connect(() => { sent = performance.now(); });
  drawn.properties.data.change.connect(() => {
    const begun = sent;
    requestAnimationFrame(() => setTimeout(() => window.redraws.push(performance.now() - begun)));
  });
}"""


@dataclass(frozen=True)
class Visit:
    """A page of the workbench.

    Attributes
    ----------
    page
        Playwright's page.
    url
        Where it is.
    server
        The process that serves it.
    complaints
        What went wrong in the browser: errors, and addresses on other machines that were asked.
    """

    page: Any
    url: str
    server: "subprocess.Popen[str]"
    complaints: list[str]

    def load(self) -> None:
        """Load the page, anew where it is there."""
        self.page.goto(self.url)
        self.page.wait_for_function(_READY)

        # once it is laid out, and nothing moves any more
        before = None
        while (now := self.pixel((0.0, 0.0))) != before:
            before = now
            self.page.wait_for_timeout(300)

    def pixel(self, point: Point) -> Point:
        """Where a point of the floor in metres is on the page, in px."""
        x, y = self.page.evaluate(_AT, list(point))
        return x, y

    def take(self, point: Point) -> None:
        """Press the mouse at a point in metres."""
        self.page.mouse.move(*self.pixel(point))
        self.page.mouse.down()

    def move(self, point: Point) -> None:
        """Move the mouse, and wait until what it makes of the page is drawn."""
        self.page.mouse.move(*self.pixel(point))
        self.settle()

    def drop(self) -> None:
        """Let the mouse go."""
        self.page.mouse.up()
        self.settle()

    def drag(self, begin: Point, end: Point) -> None:
        """Drag what is at a point to another, over a point between."""
        self.take(begin)
        self.move(((begin[0] + end[0]) / 2, (begin[1] + end[1]) / 2))
        self.move(end)
        self.drop()

    def settle(self) -> None:
        """Wait until Python has answered all that the pointer did."""
        pointer = "Bokeh.documents[0].get_model_by_name('pointer')"
        self.page.wait_for_function(
            f"!{pointer}._is_busy && !{pointer}._waiting?.length", polling=5
        )

    def text(self) -> str:
        """All that the page says."""
        return str(self.page.evaluate(TEXT))

    def values(self) -> dict[str, Any]:
        """What the fields hold, by their labels."""
        found: dict[str, Any] = self.page.evaluate(VALUES)
        return found

    def models(self) -> int:
        """How many models of Bokeh the page holds."""
        return int(self.page.evaluate("Bokeh.documents[0]._all_models.size"))

    def watch_redraws(self) -> None:
        """Begin to time what follows."""
        self.page.evaluate(_TIME)

    def redraws(self) -> list[float]:
        """Milliseconds of each redraw since `watch_redraws`."""
        return [float(each) for each in self.page.evaluate("window.redraws")]

    def memory(self) -> int:
        """Bytes of memory that the server has; on Linux."""
        status = Path(f"/proc/{self.server.pid}/status").read_text()
        return 1024 * int(status.split("VmRSS:")[1].split()[0])


# Panel's widgets lie in shadow trees.
TEXT = """() => {
  const texts = [];
  const read = (node) => {
    if (node.nodeType === Node.TEXT_NODE) { texts.push(node.textContent); }
    if (["STYLE", "SCRIPT"].includes(node.tagName)) { return; }
    if (node.tagName && getComputedStyle(node).display === "none") { return; }
    for (const child of [...(node.shadowRoot?.childNodes ?? []), ...node.childNodes]) {
      read(child);
    }
  };
  read(document.body);
  return texts.join("").replace(/\\s+/g, " ");
}"""
VALUES = """() => Object.fromEntries(
  [...Bokeh.documents[0]._all_models.values()]
    .filter((model) => model.properties?.title && model.properties?.value)
    .map((model) => [model.title, model.value]))"""


@contextmanager
def visit(folder: Path, *, scene: str = "paper") -> Iterator[Visit]:
    """Serve the workbench on a free port, and open it.

    Raises
    ------
    ModuleNotFoundError
        Where Playwright is not installed.
    RuntimeError
        Where there is no Chromium, or the workbench does not begin.
    """
    from playwright.sync_api import sync_playwright

    chromium = next(filter(None, map(shutil.which, _CHROMIUM)), None)
    if chromium is None:
        raise RuntimeError(f"none of {', '.join(_CHROMIUM)} is installed")

    words = ["-m", "irs_gym.workbench", "--no-browser", "--scene", scene, "--folder", str(folder)]
    with subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            said = server.stdout.readline()
            if "http://" not in said:
                raise RuntimeError(f"the workbench does not begin: {said}")
            url = said[said.index("http://") :].split()[0]

            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(
                    executable_path=chromium, args=["--no-sandbox"]
                )
                page = browser.new_page(viewport=_SIZE)
                page.set_default_timeout(60_000)
                complaints: list[str] = []
                _listen(page, url, complaints)
                found = Visit(page, url, server, complaints)
                _load_at_last(found)
                yield found
                browser.close()
        finally:
            server.terminate()


def _listen(page: Any, url: str, complaints: list[str]) -> None:
    """Note errors and requests to other machines."""
    host = url.removeprefix("http://")

    def hear(request: Any) -> None:
        where = request.url
        if where.startswith(("http", "ws")) and where.split("/")[2] != host:
            complaints.append(f"asks for {where}")

    page.on("request", hear)
    page.on("pageerror", lambda error: complaints.append(str(error)))


def _load_at_last(found: Visit) -> None:
    """Load the page once the server, which has said where it will be, is there."""
    from playwright.sync_api import Error

    for attempt in range(100):
        try:
            found.load()
        except Error:
            if attempt == 99 or found.server.poll() is not None:
                raise
            found.page.wait_for_timeout(100)
        else:
            return
