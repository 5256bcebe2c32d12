"""Edges of colour and depth: where they fit, and what is said where they don't."""

import numpy as np
import pytest

from hadr.confidence.registration import REACH, fit_of_edges, told_apart
from hadr.data.samples import open_samples


def scene(seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Boxes before a wall, each of its own depth and colour, and a glass without edges."""
    rng = np.random.default_rng(seed)
    color, depth = np.full((252, 448, 3), 90.0), np.full((252, 448), 1.2, np.float32)
    for number in range(9):
        row, column = rng.integers(30, 180), rng.integers(30, 370)
        box = slice(row, row + 40), slice(column, column + 50)
        color[box], depth[box] = rng.integers(120, 250, 3), 0.5 + 0.06 * number
    mask = np.zeros((252, 448), bool)
    mask[100:130, 200:230] = True
    noise = rng.normal(0, 4, color.shape)
    return np.clip(color + noise, 0, 255).astype(np.uint8), depth, mask


@pytest.mark.parametrize(
    ("right", "down", "words"),
    [
        (15, 6, "15 pixels to the right and 6 down"),
        (-12, 9, "12 pixels to the left and 9 down"),
        (5, -20, "5 pixels to the right and 20 up"),
    ],
)
def test_a_depth_that_lies_beside_its_picture_is_told_with_the_move_that_mends_it(
    right, down, words
):
    color, depth, mask = scene()
    moved = np.roll(depth, (-down, -right), axis=(0, 1))
    fit = fit_of_edges(color, moved, mask)
    best = np.unravel_index(fit.argmax(), fit.shape)
    np.testing.assert_allclose(np.array(best) - REACH, (down, right), atol=1)
    (said,) = told_apart(color, moved, mask)
    assert said.startswith("colour and depth may not be aligned")
    assert words in said


def test_what_belongs_together_passes_at_any_size_and_another_picture_does_not():
    color, depth, mask = scene()
    assert told_apart(color, depth, mask) == ()
    double = [np.repeat(np.repeat(image, 2, 0), 2, 1) for image in (color, depth, mask)]
    assert told_apart(*double) == ()
    assert "of two pictures" in told_apart(scene(3)[0], depth, mask)[0]


def test_nothing_is_said_of_a_depth_without_edges_or_with_holes_or_of_a_tiny_picture():
    color, depth, mask = scene()
    holes = np.where(np.random.default_rng(0).random(depth.shape) < 0.02, 0, depth)
    assert told_apart(scene(3)[0], holes, mask) == ()
    assert fit_of_edges(color, np.full_like(depth, 0.8), mask) is None
    assert told_apart(scene(3)[0], np.full_like(depth, 0.8), mask) == ()
    assert told_apart(color[:20], depth[:20], mask[:20] | True) == ()


def test_bundled_frames_fit_and_not_each_other():
    """Counts, as chance may make a pair look alike."""
    frames = [open_samples("test")[n] for n in range(0, 48, 4)]
    own = [told_apart(f.color, f.depth, f.object_mask) for f in frames]
    other = [
        told_apart(f.color, g.depth, f.object_mask)
        for f, g in zip(frames, frames[5:] + frames[:5], strict=True)
    ]
    assert sum(map(bool, own)) <= 2
    assert sum(map(bool, other)) >= 9
