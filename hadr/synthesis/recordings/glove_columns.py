"""Which column of a data glove's export is which joint angle: the one place that knows names.

Names differ between programs and versions: ``Index_PIP_Flex``, ``IndexPIPStretch``,
``Left_Pinky_MCP_Spread``, ``R_Thumb_CMC_Flex (deg)``, ``index_pip_stretch``. All are read by what
they say: a side (or none), a finger, a joint (or none), and a spread or a stretch.

The thumb's three stretches are taken in the order of its joints, whatever a program calls them:
CMC, MCP, IP (anatomy), CMC, PIP, DIP or MCP, PIP, DIP (as some gloves name them).
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from hadr.hand import ANGLE_NAMES, FINGERS, Side

_FINGER_WORDS = {f: f for f in FINGERS}
_FINGER_WORDS |= {"pointer": "index", "pinky": "little", "pinkie": "little"}
_KIND_WORDS = dict.fromkeys(("spread", "abduction", "abd", "splay"), "spread")
_KIND_WORDS |= dict.fromkeys(("stretch", "flex", "flexion", "bend"), "stretch")
#: Joints from the root to the tip; where a thumb has three of them this is their order.
_JOINT_WORDS = ("cmc", "mcp", "pip", "ip", "dip")
_SIDE_WORDS: dict[str, Side] = dict.fromkeys(("left", "l", "lefthand"), "left")
_SIDE_WORDS |= dict.fromkeys(("right", "r", "righthand"), "right")
#: Units and fillers that a name may carry.
_FILLERS = ("deg", "degree", "degrees", "angle", "finger", "joint", "hand", "value")
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
#: Columns of our own recordings, in the order of ``ANGLE_NAMES``.
ANGLE_COLUMNS: tuple[str, ...] = tuple(
    "_".join(
        part.upper() if part in _JOINT_WORDS else part.replace("little", "pinky").capitalize()
        for part in name.split("_")
    )
    for name in ANGLE_NAMES
)
POSITION_COLUMNS = tuple(f"Object_Position_{axis}" for axis in "XYZ")
ROTATION_COLUMNS = tuple(f"Object_Rotation_{axis}" for axis in "WXYZ")


def read_column_name(name: str) -> tuple[Side | None, str, str, str] | None:
    """Side (or None), finger, joint (or empty), spread or stretch; None of no joint's angle."""
    side: Side | None = None
    found: dict[str, str] = {}
    for word in (w.lower() for w in _WORD.findall(name)):
        if word in _SIDE_WORDS and side is None:
            side = _SIDE_WORDS[word]
        elif word in _FINGER_WORDS and "finger" not in found:
            found["finger"] = _FINGER_WORDS[word]
        elif word in _JOINT_WORDS and "joint" not in found:
            found["joint"] = word
        elif word in _KIND_WORDS and "kind" not in found:
            found["kind"] = _KIND_WORDS[word]
        elif word not in _FILLERS:
            return None
    if "finger" not in found or "kind" not in found:
        return None
    if found["kind"] == "stretch" and "joint" not in found:
        return None
    return side, found["finger"], found.get("joint", ""), found["kind"]


def find_angle_columns(header: Sequence[str]) -> dict[Side | None, dict[str, int]]:
    """Find each hand's angles of ``ANGLE_NAMES`` in a header: their positions by side.

    The side is None where names tell none.

    Raises:
        ValueError: Two columns are the same angle of the same hand.
    """
    hands: dict[Side | None, dict[str, int]] = {}
    thumbs: dict[Side | None, list[tuple[int, int]]] = {}
    for position, name in enumerate(header):
        said = read_column_name(name)
        if said is None:
            continue
        side, finger, joint, kind = said
        hand = hands.setdefault(side, {})
        if finger == "thumb" and kind == "stretch":
            thumbs.setdefault(side, []).append((_JOINT_WORDS.index(joint), position))
            continue
        if kind == "spread":
            angle = "thumb_cmc_spread" if finger == "thumb" else f"{finger}_mcp_spread"
        else:
            angle = f"{finger}_{joint}_stretch"
        if angle in hand:
            raise ValueError(
                f"columns {header[hand[angle]]!r} and {name!r} are both the {angle} of one hand"
            )
        hand[angle] = position
    names = ("thumb_cmc_stretch", "thumb_mcp_stretch", "thumb_ip_stretch")
    for side, columns in thumbs.items():
        if len(columns) == 3:
            hands[side].update(zip(names, (p for _, p in sorted(columns)), strict=True))
        else:
            for joint_number, position in columns:
                angle = f"thumb_{_JOINT_WORDS[joint_number]}_stretch"
                if angle in hands[side]:
                    raise ValueError(f"two columns are the {angle} of one hand")
                if angle in names:
                    hands[side][angle] = position
    return hands
