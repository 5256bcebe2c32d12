"""A headless browser over the built book, driven through Chromium's DevTools protocol."""

import asyncio
import json
import os
import shutil
import subprocess
import tempfile
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from tornado.websocket import websocket_connect

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
#: A phone in portrait; without it, the window of FLAGS.
PHONE = {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}
#: The page's theme, and what the reader's system prefers: all four on each page, two a device.
AT_ODDS = [("light", "dark"), ("dark", "light")]
AT_ONE = [("light", "light"), ("dark", "dark")]
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-quic",
    "--no-first-run",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--window-size=1280,900",
    "--remote-debugging-port=0",
)
# What a page says about itself once MathJax has finished.
INSPECT = r"""
(async () => {
  if (window.MathJax && MathJax.startup) await MathJax.startup.promise;
  for (const image of document.images) image.loading = "eager";
  await Promise.all([...document.images].map(i => i.decode().catch(() => null)));
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  const raw = [];
  while (walker.nextNode()) {
    const node = walker.currentNode;
    if (node.parentElement.closest("pre, code, script, style, mjx-container, textarea")) continue;
    if (/\$\$|\\\(|\\\)|\\\[|\\(frac|mathbf|text|delta|sum|in)\b/.test(node.data) ||
        /(^|\s)\$[^$\n]+\$($|[\s.,;:])/.test(node.data) || /\{\{[A-Z_]+\}\}/.test(node.data))
      raw.push(node.data.trim().slice(0, 80));
  }
  const math = [...document.querySelectorAll("span.math, div.math")];
  const fonts = [...document.fonts].filter(f => f.status === "error").map(f => f.family);
  return {
    title: document.title,
    text: document.body.innerText.length,
    missing: [...document.images].filter(i => !i.complete || !i.naturalWidth).map(i => i.src),
    unlabelled: [...document.querySelectorAll("article img, main img")]
      .filter(i => !(i.getAttribute("alt") || "").trim()).map(i => i.src),
    raw, fonts,
    unrendered: math.filter(m => !m.querySelector("mjx-container"))
      .map(m => m.textContent.trim().slice(0, 80)),
    formulas: math.length,
    errors: [...document.querySelectorAll("mjx-merror, [data-mjx-error]")]
      .map(e => e.textContent.trim().slice(0, 80)),
    links: [...document.querySelectorAll("a[href]")].map(a => a.href),
    ids: [...document.querySelectorAll("[id]")].map(e => e.id),
    wider: document.documentElement.scrollWidth - window.innerWidth,
  };
})()
"""


@dataclass
class Page:
    """What the browser saw on one page."""

    path: Path
    console: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    seen: dict[str, Any] = field(default_factory=dict)
    layout: dict[str, list[str]] = field(default_factory=dict)
    contrast: dict[tuple[str, str], dict[str, Any]] = field(default_factory=dict)


class Browser:
    """One tab of a headless Chromium."""

    def __init__(self, program: str, profile: Path) -> None:
        self.process = subprocess.Popen(
            [program, *FLAGS, f"--user-data-dir={profile}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self.loop = asyncio.new_event_loop()
        self.port = self._port(profile / "DevToolsActivePort")
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/json", timeout=20) as answer:
            tabs = json.load(answer)
        address = next(tab["webSocketDebuggerUrl"] for tab in tabs if tab["type"] == "page")
        self.number = 0
        self.events: list[dict[str, Any]] = []
        self.socket = self._wait(lambda: websocket_connect(address, max_message_size=2**28))
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def _port(self, file: Path) -> int:
        end = time.monotonic() + 60
        while time.monotonic() < end:
            if file.exists() and file.read_text():
                return int(file.read_text().split()[0])
            if self.process.poll() is not None:
                raise RuntimeError(f"Chromium ended at once, status {self.process.returncode}")
            time.sleep(0.05)
        raise RuntimeError("Chromium opened no debugging port within 60 s")

    def _wait(self, start: Callable[[], Any]) -> Any:
        async def limited() -> Any:
            return await asyncio.wait_for(start(), 60)

        return self.loop.run_until_complete(limited())

    def _next(self) -> dict[str, Any]:
        message = self._wait(self.socket.read_message)
        if message is None:
            raise RuntimeError("Chromium closed the connection")
        return json.loads(message)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self.number += 1
        content = {"id": self.number, "method": method, "params": parameters}
        self._wait(lambda: self.socket.write_message(json.dumps(content)))
        while True:
            message = self._next()
            if message.get("id") == self.number:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']}")
                return message["result"]
            self.events.append(message)

    def visit(self, path: Path) -> Page:
        self.events.clear()
        page = Page(path)
        self.call("Page.navigate", url=path.as_uri())
        while not any(event["method"] == "Page.loadEventFired" for event in self.events):
            self.events.append(self._next())
        page.seen = self.evaluate(INSPECT)
        for event in self.events:
            self._note(page, event["method"], event.get("params", {}))
        return page

    def evaluate(self, expression: str) -> Any:
        """A JavaScript expression's value on the page; a promise is awaited."""
        answer = self.call(
            "Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True
        )
        if "exceptionDetails" in answer:
            raise RuntimeError(f"{expression[:80]}: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def screen(self, *, phone: bool) -> None:
        """Become a phone, or the desktop's window again."""
        if phone:
            self.call("Emulation.setDeviceMetricsOverride", **PHONE)
        else:
            self.call("Emulation.clearDeviceMetricsOverride")
        self.call("Emulation.setTouchEmulationEnabled", enabled=phone)

    def shade(self, theme: str, system: str) -> None:
        """Set the page's theme, and the scheme that the reader's system prefers."""
        wish = [{"name": "prefers-color-scheme", "value": system}]
        self.call("Emulation.setEmulatedMedia", features=wish)
        self.evaluate(
            f"(() => {{ const root = document.documentElement; root.dataset.theme = {theme!r};"
            f" root.dataset.mode = {theme!r};"
            " root.style.colorScheme = ''; })()"
        )

    def examine(self, path: Path, shades: list[tuple[str, str]]) -> Page:
        """Visit a page, open all that is folded, and see it in each of the shades."""
        page = self.visit(path)
        self.evaluate(
            "document.head.append(Object.assign(document.createElement('style'),"
            " {textContent: '* { transition: none !important; animation: none !important; }'}))"
        )
        page.layout = self.evaluate((HERE / "layout.js").read_text(encoding="utf-8"))
        look = (HERE / "contrast.js").read_text(encoding="utf-8")
        for shade in shades:
            self.shade(*shade)
            page.contrast[shade] = self.evaluate(look)
        self.call("Emulation.setEmulatedMedia", features=[])
        return page

    @staticmethod
    def _note(page: Page, method: str, told: dict[str, Any]) -> None:
        if method == "Runtime.exceptionThrown":
            details = told["exceptionDetails"]
            text = details.get("exception", {}).get("description", details["text"])
            page.console.append(f"{details.get('url', '')}:{details['lineNumber']} {text}")
        elif method == "Runtime.consoleAPICalled" and told["type"] in ("error", "assert"):
            page.console.append(" ".join(str(item.get("value", item)) for item in told["args"]))
        elif method == "Log.entryAdded" and told["entry"]["level"] == "error":
            page.console.append(f"{told['entry'].get('url', '')} {told['entry']['text']}")
        elif method == "Network.requestWillBeSent":
            page.requests.append(told["request"]["url"])
        elif method == "Network.loadingFailed" and not told.get("canceled"):
            page.failed.append(told["errorText"])

    def close(self) -> None:
        self.socket.close()
        self.process.terminate()
        try:
            self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
        self.loop.close()


@pytest.fixture(scope="session")
def html() -> Path:
    """The folder of the built book."""
    folder = Path(os.environ.get("HADR_BOOK_HTML", ROOT / "build" / "html" / "_build" / "html"))
    if not (folder / "index.html").exists():
        pytest.skip(f"no built book in {folder}: run `make book` first")
    return folder


@pytest.fixture(scope="session")
def chromium() -> str:
    """The program that shows the pages."""
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    wish = os.environ.get("CHROME_BIN")
    program = wish or next((found for name in names if (found := shutil.which(name))), None)
    if program is None:
        pytest.skip("no Chromium found: install the package chromium, or set CHROME_BIN")
    return program


@contextmanager
def opened(program: str) -> Iterator[Browser]:
    """A headless Chromium with a profile of its own."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        browser = Browser(program, Path(profile))
        try:
            yield browser
        finally:
            browser.close()


@pytest.fixture(scope="session")
def browser(chromium: str) -> Iterator[Browser]:
    """One browser for all pages that are files."""
    with opened(chromium) as browser:
        yield browser


@pytest.fixture(scope="module")
def second_browser(chromium: str) -> Iterator[Browser]:
    """One that is thrown away: an application in it may hold on to its page."""
    with opened(chromium) as browser:
        yield browser


def all_paths(html: Path) -> list[Path]:
    """Every page that is part of the book."""
    return [
        p for part in ("", "notebooks/", "library/") for p in sorted(html.glob(part + "*.html"))
    ]


@pytest.fixture(scope="session")
def pages(html: Path, browser: Browser) -> list[Page]:
    """Every page of the book, visited once in the desktop's window, in its own shade."""
    return [browser.examine(path, []) for path in all_paths(html)]


@pytest.fixture(scope="session")
def shaded_pages(html: Path, browser: Browser) -> list[Page]:
    """Every page of the book in the desktop's window, the theme at odds with the system."""
    return [browser.examine(path, AT_ODDS) for path in all_paths(html)]


@pytest.fixture(scope="session")
def phone_pages(html: Path, browser: Browser) -> list[Page]:
    """Every page of the book on a phone, the theme at one with the system."""
    browser.screen(phone=True)
    try:
        return [browser.examine(path, AT_ONE) for path in all_paths(html)]
    finally:
        browser.screen(phone=False)
