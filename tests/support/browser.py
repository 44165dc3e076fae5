"""A real browser without a screen, and what the tests of pages ask of it."""

from __future__ import annotations

import importlib.util
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")

PLAYWRIGHT = importlib.util.find_spec("playwright") is not None

WHY_NOT = "" if PLAYWRIGHT and CHROMIUM else f"needs {'Chromium' if PLAYWRIGHT else 'playwright'}"

# Nothing of the browser's own goes to the network either.
ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-default-apps",
    "--no-first-run",
    "--disable-dev-shm-usage",
]


@contextmanager
def chromium() -> Iterator:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as tools:
        browser = tools.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield browser
        browser.close()


class Shown:
    """A page file as the browser shows it, with all that it said and asked for."""

    def __init__(self, browser, file: Path, *, width: int = 1300, height: int = 900, **context) -> None:
        self.context = browser.new_context(viewport={"width": width, "height": height}, **context)
        self.page = self.context.new_page()
        self.said: list[str] = []
        self.asked: list[str] = []
        self.page.on("console", lambda message: self.said.append(message.text))
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(file.as_uri())
        self.settle()

    def settle(self) -> None:
        """Wait until what was asked for is drawn."""
        self.page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def close(self) -> None:
        self.context.close()

    def require_quiet(self) -> None:
        """No word in the console, and nothing fetched but the file itself."""
        assert self.said == []
        assert all(url.startswith(("file:", "data:")) for url in self.asked)

    def ticks(self, picture: str, axis: str) -> dict[float, float]:
        """Values that stand on an axis of a picture, with their pixels in the window."""
        found = self.page.eval_on_selector_all(
            f"{picture} text.{axis}", f"list => list.map(e => [e.textContent, +e.getAttribute('{axis}')])"
        )
        # A label stands with its middle 4 pixels above its line of writing.
        begin = self.page.locator(picture).bounding_box()[axis] - (4.0 if axis == "y" else 0.0)
        return {float(value): begin + pixel for value, pixel in found}

    def pixel(self, picture: str, axis: str, value: float) -> float:
        """Where a value is in the window, by the two outermost ticks of its axis."""
        ticks = self.ticks(picture, axis)
        low, high = min(ticks), max(ticks)
        return ticks[low] + (value - low) / (high - low) * (ticks[high] - ticks[low])

    def value(self, picture: str, axis: str, pixel: float) -> float:
        """What stands at a pixel of the window."""
        ticks = self.ticks(picture, axis)
        low, high = min(ticks), max(ticks)
        return low + (pixel - ticks[low]) / (ticks[high] - ticks[low]) * (high - low)

    def middle(self, picture: str) -> tuple[float, float]:
        self.page.locator(picture).scroll_into_view_if_needed()
        box = self.page.locator(picture).bounding_box()
        return box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]

    def point_at(self, x: float, y: float) -> str:
        """Move the hand there, and return what is told."""
        self.page.mouse.move(x, y)
        self.settle()
        return self.page.locator("#tip").inner_text()

    def drawn(self, selector: str) -> list[str]:
        """Shapes of the lines that a selector finds."""
        return self.page.eval_on_selector_all(selector, "list => list.map(e => e.getAttribute('d'))")

    def count(self, selector: str) -> int:
        return self.page.locator(selector).count()


def numbers_after(text: str, *names: str) -> list[float]:
    """Return the number after each of the names.

    Examples
    --------
    >>> numbers_after("s 1.5 mm  X -2", "s", "X")
    [1.5, -2.0]
    """
    return [float(re.search(rf"\b{name} (-?[\d.]+)", text).group(1)) for name in names]
