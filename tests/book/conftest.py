"""A headless Chromium over the built book, driven by Playwright; the book's extensions."""

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page, sync_playwright

ROOT = Path(__file__).resolve().parents[2]
DESKTOP = {"viewport": {"width": 1200, "height": 900}}
#: A phone in portrait.
PHONE = {
    "viewport": {"width": 390, "height": 844},
    "device_scale_factor": 2,
    "is_mobile": True,
    "has_touch": True,
}
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-dev-shm-usage",
]


@dataclass
class Tab:
    """One page in the browser, and what it told and asked for since it was opened."""

    page: Page
    console: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        def told(message: ConsoleMessage) -> None:
            if message.type in ("error", "assert"):
                self.console.append(f"{message.location.get('url', '')} {message.text}")

        self.page.on("console", told)
        self.page.on("pageerror", lambda error: self.console.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("requestfailed", lambda request: self.failed.append(request.url))

    def visit(self, path: Path) -> None:
        for told in (self.console, self.requests, self.failed):
            told.clear()
        self.page.goto(path.as_uri())

    def foreign(self) -> list[str]:
        """What was asked from anywhere but the folder of the pages."""
        return [url for url in self.requests if not url.startswith(("file:", "data:", "blob:"))]

    def evaluate(self, expression: str) -> Any:
        """A JavaScript expression's value on the page; a promise is awaited."""
        return self.page.evaluate(expression)

    def picture(self) -> np.ndarray:
        """What the window shows, (H, W, 3) in RGB, after two more frames were drawn."""
        self.evaluate("new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))")
        drawn = np.frombuffer(self.page.screenshot(), np.uint8)
        return cv2.imdecode(drawn, cv2.IMREAD_COLOR)[..., ::-1].astype(int)

    def drag(self, start: tuple[int, int], path: list[tuple[int, int]]) -> None:
        """With a mouse, from one place over others."""
        self.page.mouse.move(*start)
        self.page.mouse.down()
        for place in path:
            self.page.mouse.move(*place)
        self.page.mouse.up()

    def needs_webgl(self) -> None:
        if not self.evaluate("document.createElement('canvas').getContext('webgl') !== null"):
            pytest.skip("this Chromium draws no WebGL, not even in software: try another one")


@pytest.fixture(scope="session")
def html() -> Path:
    """The folder of the built book."""
    folder = Path(os.environ.get("HADR_BOOK_HTML", ROOT / "build" / "html" / "_build" / "html"))
    if not (folder / "index.html").exists():
        pytest.skip(f"no built book in {folder}: run `make book` first")
    return folder


@pytest.fixture(scope="module")
def extension(request: pytest.FixtureRequest) -> ModuleType:
    """The book's extension that the file's tests are of, test_NAME.py of NAME.py."""
    pytest.importorskip("sphinx", reason="needs the extra: pip install -e '.[book]'")
    name = request.path.stem.removeprefix("test_")
    spec = spec_from_file_location(name, ROOT / "book" / "extensions" / f"{name}.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """The system's Chromium.

    It lives as long as a file's tests: while Playwright runs, its event loop is the thread's
    running one, and any other test that starts a loop would fail.
    """
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    program = os.environ.get("CHROME_BIN") or next(filter(None, map(shutil.which, names)), None)
    if program is None:
        pytest.skip("no Chromium found: install the package chromium, or set CHROME_BIN")
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=program, args=FLAGS)
        yield running
        running.close()


@pytest.fixture(scope="module")
def opened(browser: Browser) -> Callable[[bool], AbstractContextManager[Tab]]:
    """Opens a page on a phone or in a desktop's window, with a profile of its own."""

    @contextmanager
    def opened(on_phone: bool) -> Iterator[Tab]:
        with browser.new_context(**(PHONE if on_phone else DESKTOP)) as context:
            yield Tab(context.new_page())

    return opened


@pytest.fixture
def tab(opened: Callable[[bool], AbstractContextManager[Tab]]) -> Iterator[Tab]:
    with opened(False) as tab:
        yield tab


@pytest.fixture
def phone(opened: Callable[[bool], AbstractContextManager[Tab]]) -> Iterator[Tab]:
    with opened(True) as tab:
        yield tab
