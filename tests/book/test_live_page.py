"""The page's network gives what PyTorch gives; its controls do what they say."""

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy import ndimage

from hadr.data.samples import open_samples, samples_dir
from hadr.models.network_input import frame_to_input
from hadr.press.live_network import frames_script, weights_script
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
    return DepthNetwork.load(CHECKPOINTS / "hadr-plus-mini.safetensors")


@pytest.fixture
def page(tab, tmp_path, frames, network):
    """The page's arithmetic with the bundled weights, without the page."""
    scripts = (
        NETWORK.read_text(encoding="utf-8"),
        "live.frames = []; live.frame = (stored) => live.frames.push(stored);",
        weights_script(CHECKPOINTS / "hadr-plus-mini.safetensors"),
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
            (place,) = np.nonzero(hole.any(axis=0))
            left = int(np.clip((place[0] + rounds + place[-1] - rounds - height) // 2,
                               0, width - height))  # fmt: skip
            part = np.s_[:, left : left + height]
            assert np.array_equal(np.reshape(mask, (height, height)) > 0, hole[part])
            off = np.abs(np.reshape(found, (height, height)) - expected[part])
            assert off.max() < 1e-4, (number, move, rounds)
    assert page.console == []


def test_only_a_whole_hadr_plus_is_taken(network) -> None:
    with pytest.raises(ValueError, match=r"hadr-mini.safetensors is not a HADR-plus"):
        weights_script(CHECKPOINTS / "hadr-mini.safetensors")


def test_the_built_page_restores_moves_and_refuses(tab, html) -> None:
    tab.visit(html / "try_it.html")
    part = "document.querySelector('[data-part={}]')"
    told = part.format("told") + ".textContent"
    assert "load the network" in tab.evaluate(told)
    tab.page.click("[data-part=load]")
    said = []
    for change in ("", "right", "away"):
        if change:
            slider = part.format(change)
            tab.evaluate(f"void ({slider}.value = 6, {slider}.dispatchEvent(new Event('input')))")
        tab.page.wait_for_function(f"{told}.includes('root mean') && !{said!r}.includes({told})")
        said.append(tab.evaluate(told))
    tab.evaluate("live.show(5)")
    tab.page.wait_for_function(f"{told}.includes('root mean') && !{said!r}.includes({told})")
    for _ in range(60):
        tab.page.click("[data-part=narrower]")
    tab.page.wait_for_function(f"{told}.includes('No answer: nothing is to be restored')")
    assert tab.console == []
    assert tab.foreign() == []
