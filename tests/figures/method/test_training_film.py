import numpy as np
import pytest

from hadr.data.samples import open_samples
from hadr.figures.method.training_film import distances, epoch_picture
from hadr.training.frames.batches import load_frames


@pytest.fixture(scope="module")
def frames():
    samples = open_samples("val")
    return load_frames([samples[k] for k in (0, 5, 10, 15)], (64, 36))


@pytest.fixture
def stages(frames):
    truth = frames.true_depth.numpy()
    return {"first": truth + 0.5, "second": truth + 0.02, "last": truth.copy()}


def panel(figure, xlabel):
    return next(ax for ax in figure.axes if ax.get_xlabel() == xlabel)


def test_a_glass_is_as_far_as_the_median_of_its_own_pixels(frames):
    depth = np.full(frames.true_depth.shape, 9.0)
    for n, mask in enumerate(frames.inputs.mask.numpy()):
        depth[n][mask] = np.linspace(0, n + 1, mask.sum()) ** 2  # median: (n + 1)^2 / 4
    np.testing.assert_allclose(distances(depth, frames), [0.25, 1, 2.25, 4], rtol=0.2)
    assert distances(np.where(depth == 9.0, 0, 9.0), frames).tolist() == [9.0] * 4


def test_dots_stand_at_true_and_restored_distance(frames, stages):
    figure = epoch_picture(stages, frames, (0, 1, 2), 1)
    ax = panel(figure, "true distance (m)")
    true, said = ax.collections[0].get_offsets().T
    np.testing.assert_allclose(true, distances(frames.true_depth.numpy(), frames))
    np.testing.assert_allclose(said - true, 0.02, atol=1e-6)
    assert "4 glasses: mean error 2.0 cm" in ax.get_title()


def test_each_glass_is_seen_from_above_beside_its_truth(frames, stages):
    figure = epoch_picture(stages, frames, (2, 1, 0), 1)
    above = [ax for ax in figure.axes if ax.get_xlabel() == "sideways (cm)"]
    assert len(above) == 3
    for ax in above:
        true, restored = (np.asarray(line.get_ydata()) for line in ax.lines)
        assert np.median(true) == pytest.approx(0, abs=1e-4)
        np.testing.assert_allclose(restored - true, 2.0, atol=1e-3)
    assert sum(ax.get_xlabel() == "error 2.0 cm" for ax in figure.axes) == 3
