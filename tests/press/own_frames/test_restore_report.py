"""The comparison picture: what has no probability is told from what has no depth."""

import numpy as np
import pytest

from hadr.camera import Intrinsics
from hadr.press.own_frames.restore_command import Made
from hadr.press.own_frames.restore_report import comparison_figure
from hadr.restoration import restore


@pytest.mark.parametrize(
    ("truth", "said"),
    [
        (None, {"no depth", "restored, without probability"}),
        (0.7, {"outside the mask", "the truth is not known"}),
    ],
)
def test_what_is_left_blank_is_named_below_the_picture(truth: float | None, said: set[str]) -> None:
    camera = Intrinsics(80.0, 80.0, 31.5, 23.5, 64, 48)
    depth = np.full(camera.shape, 0.8, np.float32)
    depth[:5] = 0
    mask = np.zeros(camera.shape, bool)
    mask[20:30, 20:40] = True
    known = None if truth is None else np.where(np.indices(mask.shape)[1] < 30, truth, 0)
    color = np.zeros((*camera.shape, 3), np.uint8)
    result = restore(color, depth, camera, mask, method="nearest")
    figure = comparison_figure(Made(color, depth, camera, known, {}, result, {}))
    legend = figure.axes[1].get_legend()
    assert {text.get_text() for text in legend.get_texts()} == said
    # Below stands what the confidence means, where it is drawn.
    assert ("cannot say how sure it is" in figure.get_supxlabel()) == (truth is None)
