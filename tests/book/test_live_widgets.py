"""The book's widgets with a live kernel: JupyterLab in a browser, a slider that is moved."""

import base64
import json
import os
import secrets
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import cv2
import nbformat
import numpy as np
import psutil
import pytest

from hadr.press.chapters import private_jupyter
from hadr.press.notebook_twins import KERNELSPEC

ROOT = Path(__file__).resolve().parents[2]
PATIENCE = 180.0
"""Seconds that the server, a kernel or the page may take."""

pytestmark = pytest.mark.browser

GLASS = """import numpy as np
from hadr.figures.depth.sensor import corrupt_glass
row, column = np.mgrid[:48, :64]
mask = (abs(row - 24) < 14) & (abs(column - 32) < 9)
wall = np.full((48, 64), 0.9)
corrupt_glass(np.where(mask, 0.5, wall), wall, mask)"""
NAME = "glass.ipynb"
CELL = ".jp-Notebook .jp-Cell .cm-content"
HANDLE = ".jp-OutputArea .widget-slider [role=slider]"
OUTPUT = ".jp-OutputArea .widget-output"


def check(condition, what, seconds, told=lambda: ""):
    """Wait until the condition holds, and return what it returned; else say what was missing."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if found := condition():
            return found
        time.sleep(0.2)
    raise AssertionError(f"{what}: not within {seconds} s\n{told()}")


class Server:
    """A JupyterLab of its own: free port, token, and no folder of the user's.

    The folder holds the notebooks below ``notebooks`` and all that the server writes.
    """

    def __init__(self, folder):
        self.token = secrets.token_hex(16)
        self.notebooks = folder / "notebooks"
        self.log = folder / "server.log"
        self.notebooks.mkdir(parents=True, exist_ok=True)
        settings = folder / "settings" / "@jupyterlab" / "apputils-extension"
        settings.mkdir(parents=True)
        # no question about news on the first start, and no search for updates
        quiet = {"fetchNews": "false", "checkForUpdates": False, "doNotDisturbMode": True}
        (settings / "notification.jupyterlab-settings").write_text(json.dumps(quiet))
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]
        own = {
            "JUPYTER_DATA_DIR": str(folder / "data"),
            "JUPYTERLAB_SETTINGS_DIR": str(folder / "settings"),
            "JUPYTERLAB_WORKSPACES_DIR": str(folder / "workspaces"),
            "PYTHONPATH": os.pathsep.join(filter(None, paths)),
        }
        options = [
            "--no-browser",
            "--allow-root",
            "--expose-app-in-browser",
            "--ServerApp.ip=127.0.0.1",
            f"--ServerApp.port={self.port}",
            "--ServerApp.port_retries=0",
            f"--ServerApp.root_dir={self.notebooks}",
            f"--IdentityProvider.token={self.token}",
        ]
        command = [sys.executable, "-m", "jupyterlab", *options]
        with self.log.open("wb") as log, private_jupyter(folder):
            self.process = subprocess.Popen(
                command, cwd=folder, env=os.environ | own, stdout=log, stderr=log
            )
        try:
            check(self._answers, "the Jupyter server answers", PATIENCE, self.tail)
        except BaseException:
            self.close()
            raise

    def tail(self):
        """The last lines that the server wrote."""
        lines = self.log.read_text(encoding="utf-8", errors="replace").splitlines()
        return "the server's log ends:\n" + "\n".join(lines[-20:])

    def ask(self, path):
        """What the server's own interface tells."""
        address = f"http://127.0.0.1:{self.port}{path}"
        asked = urllib.request.Request(address, headers={"Authorization": f"token {self.token}"})
        with urllib.request.urlopen(asked, timeout=10) as answer:
            return json.load(answer)

    def _answers(self):
        if self.process.poll() is not None:
            raise AssertionError(
                f"the server ended, status {self.process.returncode}\n{self.tail()}"
            )
        try:
            return "version" in self.ask("/api")
        except (urllib.error.URLError, OSError, ValueError):
            return False

    def idle(self):
        """Whether the notebook has a kernel that waits for work."""
        sessions = self.ask("/api/sessions")
        return any(session["kernel"]["execution_state"] == "idle" for session in sessions)

    def close(self):
        """End the server and every process that it has started."""
        try:
            family = [*psutil.Process(self.process.pid).children(recursive=True)]
        except psutil.NoSuchProcess:
            family = []
        self.process.terminate()
        try:
            self.process.wait(30)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait(10)
        _, left = psutil.wait_procs(family, timeout=5)
        for process in left:
            process.kill()
        psutil.wait_procs(left, timeout=5)


@pytest.fixture
def server(tmp_path):
    pytest.importorskip("jupyterlab", reason="not installed: pip install jupyterlab")
    server = Server(tmp_path)
    yield server
    server.close()


def picture(source):
    data = np.frombuffer(base64.b64decode(source.split(",", 1)[1]), np.uint8)
    return cv2.imdecode(data, cv2.IMREAD_COLOR).astype(int)


def test_moving_a_slider_changes_the_figure(tab, server):
    page = tab.page
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(GLASS)])
    notebook.metadata["kernelspec"] = KERNELSPEC
    nbformat.write(notebook, server.notebooks / NAME)
    page.set_default_timeout(1000 * PATIENCE)
    page.goto(f"http://127.0.0.1:{server.port}/lab/tree/{NAME}?token={server.token}")
    page.wait_for_selector(CELL)
    check(server.idle, "a kernel is ready", PATIENCE, server.tail)
    page.click(CELL)
    open_now = f"window.jupyterapp.shell.currentWidget?.context?.path === '{NAME}'"
    page.wait_for_function(open_now)
    page.evaluate("void window.jupyterapp.commands.execute('notebook:run-all-cells')")
    slider = page.locator(HANDLE).first
    first = page.locator(f"{OUTPUT} img").first.get_attribute("src")
    stood = slider.get_attribute("aria-valuenow")
    slider.focus()
    # Versions of JupyterLab differ in whether they take the arrows for themselves.
    for key in ("ArrowRight", "End"):
        page.keyboard.press(key)
        page.wait_for_timeout(1000)
        if slider.get_attribute("aria-valuenow") != stood:
            break
    else:
        raise AssertionError(f"no key moves the slider from {stood}\n{server.tail()}")

    def redrawn():
        # While a figure is drawn anew there is none for a moment.
        now = page.evaluate(f"document.querySelector('{OUTPUT} img')?.src")
        return now if now != first else None

    second = check(redrawn, "the figure is another", 20, server.tail)
    # A changed notebook would ask before it is left.
    page.evaluate("window.jupyterapp.commands.execute('docmanager:save-all')")
    page.wait_for_function("!window.jupyterapp.shell.currentWidget.context.model.dirty")
    before, after = picture(first), picture(second)
    assert before.shape != after.shape or (np.abs(before - after).max(axis=2) > 40).mean() > 0.002
