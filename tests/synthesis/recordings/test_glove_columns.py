import pytest

from hadr.hand import ANGLE_NAMES
from hadr.synthesis.recordings.glove_columns import (
    ANGLE_COLUMNS,
    find_angle_columns,
    read_column_name,
)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Index_PIP_Flex", (None, "index", "pip", "stretch")),
        ("IndexPIPStretch", (None, "index", "pip", "stretch")),
        ("index_pip_stretch", (None, "index", "pip", "stretch")),
        ("Left_Pinky_MCP_Spread", ("left", "little", "mcp", "spread")),
        ("R_ThumbCMCFlex (deg)", ("right", "thumb", "cmc", "stretch")),
        ("IndexSpread", (None, "index", "", "spread")),
        ("RightHand_Ring_DIP_Flexion", ("right", "ring", "dip", "stretch")),
        ("Index_PIP_X", None),
        ("Pinch_ThumbToIndex", None),
        ("Index_PIP_Flex_Velocity", None),
        ("Frame", None),
        ("Time", None),
    ],
)
def test_column_names_of_several_programs(name, said):
    assert read_column_name(name) == said


def test_the_thumbs_joints_are_taken_in_their_order_whatever_their_names():
    for joints in (("CMC", "MCP", "IP"), ("CMC", "PIP", "DIP"), ("MCP", "PIP", "DIP")):
        header = [f"Thumb_{j}_Flex" for j in reversed(joints)]
        found = find_angle_columns(header)[None]
        assert found == {f"thumb_{j}_stretch": 2 - i for i, j in enumerate(("cmc", "mcp", "ip"))}


def test_our_own_columns_are_the_twenty_angles_in_their_order():
    found = find_angle_columns(ANGLE_COLUMNS)[None]
    assert [found[name] for name in ANGLE_NAMES] == list(range(20))
    assert ANGLE_COLUMNS[0] == "Thumb_CMC_Spread"
    assert ANGLE_COLUMNS[-1] == "Pinky_DIP_Stretch"
