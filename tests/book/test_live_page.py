"""The page's network gives what PyTorch gives; its controls do what they say."""

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy import ndimage

from hadr.camera import Intrinsics
from hadr.data.samples import open_samples, samples_dir
from hadr.models.network_input import frame_to_input
from hadr.press.live_network import frames_script, weights_script
from hadr.restoration import restore
from hadr.trained_networks import DepthNetwork

pytestmark = pytest.mark.browser

NETWORK = Path(__file__).parents[2] / "book" / "extensions" / "live_network.js"
CHECKPOINTS = samples_dir() / "checkpoints"
RESTORED = """([number, move, rounds]) => {
  const frame = live.unpacked(live.frames[number]), { width } = frame;
  let mask = frame.inside;
  for (let n = 0; n < rounds; n++)
    mask = mask.map((inside, i) =>
      inside || mask[i - 1] || mask[i + 1] || mask[i - width] || mask[i + width] || 0);
  const hand = frame.keypoints.map((k) => k.map((x, axis) => x + move[axis]));
  return [Array.from(mask), Array.from(live.restore(frame, hand, mask))];
}"""


@pytest.fixture(scope="module")
def frames():
    every = open_samples("test")
    return [every[n] for n in (0, 16, 33)]


@pytest.fixture(scope="module")
def network():
    return DepthNetwork.load(CHECKPOINTS / "hadr-plus-imagenet.safetensors")


@pytest.fixture
def page(tab, tmp_path, frames, network):
    """The page's arithmetic with the bundled weights, without the page."""
    scripts = (
        NETWORK.read_text(encoding="utf-8"),
        "live.frames = []; live.frame = (stored) => live.frames.push(stored);",
        weights_script(CHECKPOINTS / "hadr-plus-imagenet.safetensors"),
        frames_script(frames, network.size),
    )
    text = "".join(f"<script>{script}</script>" for script in scripts)
    (tmp_path / "page.html").write_text(f"<title>live</title>{text}", encoding="utf-8")
    tab.visit(tmp_path / "page.html")
    return tab


def test_the_page_restores_what_pytorch_restores(page, frames, network) -> None:
    width, height = network.size
    for number, frame in enumerate(frames):
        for move, rounds in (((0, 0, 0), 0), ((0.03, -0.02, 0.05), 2)):
            mask, found = page.page.evaluate(RESTORED, [number, move, rounds])
            inputs = frame_to_input(
                frame.color,
                np.where(frame.object_mask, 0, frame.raw_depth),
                frame.object_mask,
                frame.keypoints + np.array(move),
                frame.camera,
                network.size,
            )
            hole = inputs.mask[0].numpy()
            hole = ndimage.binary_dilation(hole, iterations=rounds) if rounds else hole
            inputs.mask[0] = torch.as_tensor(hole)
            with torch.inference_mode():
                expected = network.model(inputs).depth[0].numpy()
            assert np.array_equal(np.reshape(mask, (height, width)) > 0, hole)
            off = np.abs(np.reshape(found, (height, width)) - expected)
            assert off.max() < 1e-4, (number, move, rounds)
    assert page.console == []


def test_without_a_hand_the_page_does_what_hadr_restore_does(page, frames, network) -> None:
    width, height = network.size
    for number in range(len(frames)):
        stored = page.evaluate(
            f"(f => ({{ camera: f.camera, color: [...f.color], depth: [...f.depth],"
            f" inside: [...f.inside], nearest: [...live.nearest(f, f.inside)] }}))"
            f"(live.unpacked(live.frames[{number}]))"
        )
        depth, inside, nearest = (
            np.reshape(stored[name], (height, width)) for name in ("depth", "inside", "nearest")
        )
        color = np.reshape(stored["color"], (height, width, 3)).astype(np.uint8)
        camera = Intrinsics(*stored["camera"], width, height)
        expected = restore(color, depth, camera, inside > 0)
        assert expected.method == "nearest"
        assert any("not HADR" in note for note in expected.notes)
        with pytest.raises(ValueError, match="needs 21 hand keypoints and there are none"):
            restore(color, depth, camera, inside > 0, method="hadr-plus")
        # Of pixels that are equally near either may be taken.
        known = np.argwhere((inside == 0) & (depth > 0))
        agreed = 0
        for row, column in np.argwhere(inside):
            far = ((known - (row, column)) ** 2).sum(axis=1)
            may = np.float32(depth[tuple(known[far == far.min()].T)])
            assert np.float32(nearest[row, column]) in may
            assert expected.depth[row, column] in may
            agreed += np.float32(nearest[row, column]) == expected.depth[row, column]
        assert agreed > 0.8 * (inside > 0).sum()
        assert not nearest[inside == 0].any()


def test_only_a_whole_hadr_plus_is_taken(network) -> None:
    with pytest.raises(ValueError, match=r"hadr-imagenet.safetensors is not a HADR-plus"):
        weights_script(CHECKPOINTS / "hadr-imagenet.safetensors")


def test_the_built_page_restores_moves_hides_and_refuses(tab, html) -> None:
    tab.visit(html / "try_it.html")
    part = "document.querySelector('[data-part={}]')"
    told = part.format("told") + ".textContent"
    row = part.format("now") + ".textContent"
    tab.page.wait_for_function(f"{told}.includes(' ms.')")  # the network comes by itself
    said = [tab.evaluate(row)]

    def another() -> None:
        tab.page.wait_for_function(f"{told}.includes(' ms.') && !{said!r}.includes({row})")
        said.append(tab.evaluate(row))

    for change in ("right", "away"):
        slider = part.format(change)
        tab.evaluate(f"void ({slider}.value = 6, {slider}.dispatchEvent(new Event('input')))")
        another()
    tab.page.check("[data-part=hidden]")
    tab.page.wait_for_function(f"{told}.includes('Without a hand HADR-plus has no answer')")
    assert tab.evaluate(part.format("away") + ".disabled")
    another()
    tab.page.click("[data-part=reset]")
    tab.page.wait_for_function(f"{told}.includes(' ms.') && {row} === {said[0]!r}")
    assert not tab.evaluate(part.format("hidden") + ".checked")
    tab.evaluate("live.show(5)")
    another()
    for _ in range(60):
        tab.page.click("[data-part=narrower]")
    tab.page.wait_for_function(f"{told}.includes('No answer: nothing is to be restored')")
    assert tab.console == []
    assert tab.foreign() == []


#: Of all frames: what the hand's shift by 5 cm moves the glass by, and RMSE with it and without.
MEASURED = """() => live.frames.map((stored) => {
  const frame = live.unpacked(stored), glass = [...frame.inside.keys()].filter((i) => frame.inside[i]);
  const moved = (by) => live.restore(frame, frame.keypoints.map((k) => k.map((x, n) => x + by[n])), frame.inside);
  const first = moved([0, 0, 0]), [away, right] = [moved([0, 0, 0.05]), moved([0.05, 0, 0])];
  const by = (one) => glass.map((i) => one[i] - first[i]);
  const off = (one) => glass.filter((i) => frame.truth[i] > 0 && one[i] > 0).map((i) => one[i] - frame.truth[i]);
  return { away: by(away), right: by(right), first: off(first), hidden: off(live.nearest(frame, frame.inside)) };
})"""  # noqa: E501


@pytest.mark.long
def test_the_page_states_what_its_frames_show(tab, html) -> None:
    tab.visit(html / "try_it.html")
    tab.page.wait_for_function(
        "document.querySelector('[data-part=told]').textContent.includes(' ms.')"
    )
    text = " ".join(tab.evaluate("document.querySelector('article').innerText").split())
    frames = [{k: 100 * np.array(v) for k, v in one.items()} for one in tab.evaluate(MEASURED)]
    away = [np.median(one["away"]) for one in frames]
    right = [abs(np.median(one["right"])) for one in frames]
    first, hidden = (
        np.median([np.sqrt((one[name] ** 2).mean()) for one in frames])
        for name in ("first", "hidden")
    )
    for claim in (
        f"in the median of these twelve frames by {np.median(away):.1f} cm",
        f"at least by {min(away):.1f}.",
        f"in the median its depth changes by {np.median(right):.1f} cm",
        f"it jumps by {max(right):.0f} cm",
        f"off by {hidden:.0f} cm in place of {first:.1f}:",
    ):
        assert claim in text
