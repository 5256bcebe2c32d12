"""An attempt shown live in MuJoCo's viewer, where there is a display."""

from __future__ import annotations

import os
import sys
import time

from hadr.handover.stages import Stage
from hadr.simulation.trials.trial import Run, Trial, run_trial
from hadr.simulation.world.physics import World
from hadr.simulation.world.state import WorldState


def check_display() -> None:
    """Check that a window can be opened.

    Raises:
        ValueError: There is no display; the message says what to do instead.
    """
    seen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform.startswith("linux") and not seen:
        raise ValueError(
            "--watch opens a window, but there is no display (DISPLAY is not set); "
            "--film writes an MP4 of each attempt instead"
        )


def watch_trial(trial: Trial) -> Run:
    """Make one attempt and show it at the speed of life, or slower where the machine is."""
    check_display()
    import mujoco.viewer

    viewer = None
    started = time.perf_counter()

    def show(world: World, state: WorldState, stage: Stage) -> None:
        nonlocal viewer
        if viewer is None:
            viewer = mujoco.viewer.launch_passive(*world.physics)
        viewer.sync()
        time.sleep(max(0.0, started + state.time - time.perf_counter()))

    try:
        return run_trial(trial, on_step=show)
    finally:
        if viewer is not None:
            viewer.close()
