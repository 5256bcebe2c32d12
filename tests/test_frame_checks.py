"""What a picture says of the hand that was measured in it."""

import numpy as np
import pytest

from hadr.data.samples import open_samples
from hadr.frame_checks import told_color


@pytest.mark.parametrize("split", ["val", "test"])
def test_skin_is_where_the_hand_is_measured_and_not_where_another_frames_hand_was(split):
    frames = list(open_samples(split))[::2]

    def told(picture, there) -> str:
        given = picture.color, there.raw_depth, there.camera, picture.object_mask, there.keypoints
        return "".join(told_color(*given))

    assert sum(bool(told(one, one)) for one in frames) <= 0.05 * len(frames)
    other = [told(one, there) for one, there in zip(frames, frames[1:] + frames[:1], strict=True)]
    assert sum(map(bool, other)) >= 0.7 * len(frames)


def test_gray_and_swapped_pictures_are_no_skin_and_nothing_is_said_of_a_hand_not_measured():
    frame = open_samples("val")[0]
    given = frame.raw_depth, frame.camera, frame.object_mask, frame.keypoints
    for color in (frame.color[..., ::-1], frame.color[..., [1, 1, 1]], np.zeros_like(frame.color)):
        assert "only 0 % of the picture is redder than blue" in told_color(color, *given)[0]
    assert told_color(frame.color * 0, np.full_like(given[0], 3.0), *given[1:]) == ()
