"""A Sphinx extension: scripts, network and frames of the page on which a reader restores a glass.

The scripts stand beside this file, since Jupyter Book puts all of `_static` on every page.
"""

import shutil
from pathlib import Path
from typing import Any

from hadr.data.samples import open_samples, samples_dir
from hadr.press.live_network import frames_script, weights_script
from hadr.trained_networks import DepthNetwork

CHECKPOINT = "hadr-plus-imagenet.safetensors"
FRAMES = 12


def setup(app: Any) -> dict[str, Any]:
    """Hook into Sphinx."""

    def on_end(app: Any, problem: Exception | None) -> None:
        if problem is not None:
            return
        checkpoint = samples_dir() / "checkpoints" / CHECKPOINT
        every = list(open_samples("test"))
        frames = [every[n * len(every) // FRAMES] for n in range(FRAMES)]
        folder = Path(app.outdir) / "_static"
        size = DepthNetwork.load(checkpoint).size
        for script in ("live_network.js", "live_page.js"):
            shutil.copyfile(Path(__file__).with_name(script), folder / script)
        (folder / "live_frames.js").write_text(frames_script(frames, size), encoding="utf-8")
        (folder / "live_weights.js").write_text(weights_script(checkpoint), encoding="utf-8")

    app.connect("build-finished", on_end)
    return {"parallel_read_safe": True}
