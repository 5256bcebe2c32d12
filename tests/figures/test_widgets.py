import matplotlib.pyplot as plt
import numpy as np

from hadr.figures.widgets import corrupt_glass


def test_the_sliders_mix_missing_and_background() -> None:
    depth, background = np.full((40, 40), 0.6, np.float32), np.full((40, 40), 0.9, np.float32)
    mask = np.zeros((40, 40), bool)
    mask[10:30, 10:30] = True
    sliders = corrupt_glass(depth, background, mask)
    assert [child.description for child in sliders.children[:2]] == ["missing", "background"]
    sliders.f(missing=0.25, background=1.0)
    assert plt.gca().get_title() == "25% missing, median error +30.0 cm"
    sliders.f(missing=0.5, background=0.0)
    assert plt.gca().get_title() == "50% missing, median error +0.0 cm"
