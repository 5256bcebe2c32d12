"""A rehearsal as the pictures of a film need it: its hand and glass, and its moments as states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hadr.hand import HandShape
from hadr.simulation.trials.rehearsal import HeldGlass, Moment, MovingHand
from hadr.simulation.world.scenes import HeldScene
from hadr.simulation.world.state import WorldState
from hadr.synthesis.hand.mesh import SKIN_TONES
from hadr.synthesis.holding.hold import Hold


def film_scene(held: HeldGlass, tone: int = 1) -> HeldScene:
    """Hand and glass of a rehearsal as a scene that can be drawn.

    Args:
        held: Hand and glass at rest.
        tone: Which of the skin's tones, see `hadr.synthesis.hand.mesh`.

    Returns:
        The same hand and glass at the same place. Nothing is known of where the skin touches.
    """
    wrist_from_object = np.linalg.inv(held.base_from_wrist) @ held.base_from_glass
    object_id = held.glass.object_id
    hold = Hold(
        f"{object_id}-rehearsal", object_id, "stem", HandShape(), held.angles, wrist_from_object, {}
    )
    return HeldScene(hold, held.base_from_wrist, np.asarray(SKIN_TONES[tone]))


def film_states(moments: Sequence[Moment], hand: MovingHand) -> list[WorldState]:
    """The moments of a rehearsal as states of the world.

    Args:
        moments: What `rehearse` recorded.
        hand: The hand that it was rehearsed with.

    Returns:
        One state a moment. The gripper holds the object where that is no longer in the hand; there
        are no forces in a rehearsal, so they are 0.
    """
    states = []
    for moment in moments:
        moved = hand.motion(moment.time)
        taken = not np.allclose(moment.glass, moved @ hand.scene.base_from_glass, atol=1e-6)
        states.append(
            WorldState(
                time=moment.time,
                joints=moment.joints,
                gripper_width=moment.opening,
                base_from_wrist=moved @ hand.scene.base_from_wrist,
                base_from_object=moment.glass,
                holder="gripper" if taken else "hand",
                hand_force=0.0,
                hand_distance=max(0.0, moment.to_hand),
            )
        )
    return states
