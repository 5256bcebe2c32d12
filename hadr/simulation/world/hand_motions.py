"""How the hand moves while it holds something out: six kinds, each reproducible from its seed.

People who hand something over come to rest, so every motion but the tremor dies down, unless the
hand is restless; the hand of `give-and-withdraw` offers, pulls back, waits, and offers again, that
of `step-aside` goes with its person to another place and offers there. All in the robot's base
frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Literal, get_args

import numpy as np
from scipy.spatial.transform import Rotation

from hadr.camera import Array
from hadr.simulation.world.scenes import HeldScene

MotionKind = Literal["still", "drift", "swing", "turn", "give-and-withdraw", "step-aside"]
KINDS: tuple[MotionKind, ...] = get_args(MotionKind)

_TREMOR_SHARES = np.array([0.8, 0.52, 0.3])
"""Slow sway, its overtone and the muscles' tremor; their squares add up to 1."""
_TREMOR_BANDS = ((0.5, 1.1), (2.0, 4.0), (8.0, 11.0))
"""Frequencies of the three, hertz."""


DRIFT, SWING = 0.04, 0.05
"""Largest displacement of a drift along each axis, and of a swing to the side, metres."""
SWING_TURN, TURN = float(np.deg2rad(8.0)), float(np.deg2rad(18.0))
"""Rotation about the vertical that goes with a swing; largest rotation of a turn, radians."""
PERIODS: dict[str, tuple[float, float]] = {"swing": (2.0, 3.0), "turn": (3.0, 4.5)}
DRIFT_PERIODS = (3.0, 6.0)
"""Shortest and longest period, seconds; of a drift, and of kinds that `PERIODS` has not."""
CALM_AFTER = 2.0
"""A motion dies down over about this long, seconds."""
TREMOR, TREMOR_TURN = 0.001, float(np.deg2rad(0.2))
"""Root mean square of the tremor's displacement, metres, and rotation, radians."""
WITHDRAW, GIVEN_AGAIN = (0.15, 0.25), 0.02
"""Shortest and longest way back of a hand that withdraws, and how far from the first place it may
offer again along each axis, metres."""
WITHDRAW_AT, WITHDRAW_LASTS, WITHDRAWN_FOR = (1.5, 3.0), 1.0, (1.0, 2.0)
"""Earliest and latest time at which it starts to; how long the way back takes, and the way forth;
shortest and longest wait between the two, seconds."""
STEP, STEP_AT, STEP_LASTS = (0.12, 0.20), (1.5, 3.0), 1.0
"""Shortest and longest way of a step to the side, metres; earliest and latest time at which it
begins, and how long it takes, seconds."""


@dataclass(frozen=True)
class SeededMotion:
    """A hand's motion about where it started.

    Attributes:
        kind: What it does.
        wrist: Its place at the start, base frame, metres, (3,): what turns, turns about it.
        seed: Chooses directions, periods and times.
        speed: 1 is normal; 3 goes through the same motion three times as fast. When a hand comes
            to rest, and when it withdraws or steps aside, does not depend on it.
        restless: A drift, a swing or a turn goes on for good.
        turn: Largest rotation of a turn to each side, radians.
    """

    kind: MotionKind
    wrist: Array
    seed: int = 0
    speed: float = 1.0
    restless: bool = False
    turn: float = TURN

    def moved(self, time: float) -> Array:
        """base_now_from_base_start (4, 4) at a time in seconds; the identity up to time 0."""
        if time <= 0:
            return np.eye(4)
        shift, turn = self._displaced(time) - self._start
        return turned_about(self.wrist, shift, turn)

    @cached_property
    def _start(self) -> Array:
        return self._displaced(0.0)

    def _displaced(self, time: float) -> Array:
        """Displacement in metres and rotation vector in radians, shape (2, 3)."""
        drawn = self._drawn
        lasted = calmed(time, np.inf if self.restless else CALM_AFTER)
        wave = drawn.signs * np.sin(2 * np.pi * self.speed * lasted / drawn.periods)  # (2, 3)
        out = self._tremor(time)
        if self.kind == "drift":
            out[0] += DRIFT * wave[0]
        elif self.kind == "swing":
            out[0] += SWING * wave[0, 0] * drawn.aside
            out[1] += SWING_TURN * wave[0, 0] * np.array([0.0, 0.0, 1.0])
        elif self.kind == "turn":
            out[1] += self.turn * wave[1, 0] * drawn.axis
        elif self.kind == "give-and-withdraw":
            lasts = WITHDRAW_LASTS / self.speed
            back = _eased((time - drawn.leaves) / lasts)
            forth = _eased((time - drawn.leaves - lasts - drawn.waits) / lasts)
            out[0] += back * drawn.way_back + forth * (drawn.again - drawn.way_back)
        elif self.kind == "step-aside":
            out[0] += _eased((time - drawn.steps_at) / (STEP_LASTS / self.speed)) * drawn.step
        return out

    def _tremor(self, time: float) -> Array:
        """The part that never rests, shape (2, 3)."""
        drawn = self._drawn
        waves = np.sin(2 * np.pi * drawn.tremor_frequencies * time + drawn.tremor_phases)
        size = np.array([[TREMOR], [TREMOR_TURN]])
        # a sine's mean square is 1/2, and three axes share it
        tremor: Array = size * (waves @ _TREMOR_SHARES) * np.sqrt(2 / 3)
        return tremor

    @cached_property
    def _drawn(self) -> SimpleNamespace:
        """The random numbers of the motion; (2, 3) is displacement and rotation, axis."""
        rng = np.random.default_rng([self.seed, KINDS.index(self.kind), 17])
        periods = rng.uniform(*PERIODS.get(self.kind, DRIFT_PERIODS), size=(2, 3))
        signs = rng.choice([-1.0, 1.0], size=(2, 3))
        bearing = np.pi / 2 + rng.uniform(-0.5, 0.5)  # sideways, seen from the robot
        aside = np.array([np.cos(bearing), np.sin(bearing), 0.0])
        axis = rng.normal(size=3)
        back = np.array([1.0, *rng.uniform(-0.3, 0.3, size=2)])
        bands = [rng.uniform(low, high, size=(2, 3)) for low, high in _TREMOR_BANDS]
        return SimpleNamespace(
            periods=periods,
            signs=signs,
            aside=aside,  # of a swing
            axis=axis / np.linalg.norm(axis),  # of a turn
            tremor_frequencies=np.stack(bands, axis=2),  # (2, 3, 3)
            tremor_phases=rng.uniform(0, 2 * np.pi, size=(2, 3, 3)),
            way_back=rng.uniform(*WITHDRAW) * back / np.linalg.norm(back),
            leaves=float(rng.uniform(*WITHDRAW_AT)),
            waits=float(rng.uniform(*WITHDRAWN_FOR)),
            again=rng.uniform(-GIVEN_AGAIN, GIVEN_AGAIN, size=3),
            step=-rng.uniform(*STEP) * aside,  # to the side on which the camera sees farther
            steps_at=float(rng.uniform(*STEP_AT)),
        )


def turned_about(wrist: Array, shift: Array, turn: Array) -> Array:
    """The rigid motion (4, 4) that turns by a vector (3,) about a wrist (3,) and shifts it (3,)."""
    moved = np.eye(4)
    moved[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    moved[:3, 3] = wrist + shift - moved[:3, :3] @ wrist
    return moved


def calmed(time: float, calm_after: float) -> float:
    """How much of a motion has been gone through, seconds, if it dies down over about a time."""
    return float(calm_after * np.tanh(time / calm_after)) if np.isfinite(calm_after) else time


def _eased(share: float) -> float:
    """From 0 to 1 with the least jerk, as hands reach; flat before 0 and after 1."""
    s = min(max(share, 0.0), 1.0)
    return s**3 * (10 - 15 * s + 6 * s**2)


def kind_for(object_id: str, hold_number: int, seed: int = 0) -> MotionKind:
    """Which motion an attempt has: six holds in a row of one object have all six kinds."""
    return KINDS[(int(object_id) + hold_number + seed) % len(KINDS)]


def motion_for(
    scene: HeldScene,
    hold_number: int,
    seed: int = 0,
    *,
    speed: float = 1.0,
    restless: bool = False,
    turn: float | None = None,
) -> SeededMotion:
    """The hand's motion in one attempt at a scene; `seed` is the experiment's.

    With an angle every hand turns, by at most so much to each side, radians.
    """
    object_id = scene.hold.object_id
    number = int(np.random.SeedSequence([seed, int(object_id), hold_number]).generate_state(1)[0])
    wrist = scene.base_from_wrist[:3, 3].copy()
    if turn is not None:
        return SeededMotion("turn", wrist, number, speed, restless, turn)
    return SeededMotion(kind_for(object_id, hold_number, seed), wrist, number, speed, restless)
