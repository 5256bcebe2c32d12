"""What the page on which a reader restores a glass needs: a network and frames, as scripts.

The page's arithmetic is `book/extensions/live_network.js`. It runs where the book is opened as a
file, too: nothing is fetched but scripts beside it.
"""

import base64
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hadr.camera import resize_color
from hadr.data.frame import Frame
from hadr.data.frame_pictures import encode_color
from hadr.models import hadr_plus
from hadr.models.network_input import frame_to_input
from hadr.synthesis.glass.objects import OBJECTS
from hadr.trained_networks import DepthNetwork

DEPTH_UNIT = 1e-4
"""Metres of a step of the frames' depth."""
SHOWN = 2
"""How many times larger the picture is that is shown."""


def weights_script(checkpoint: str | Path) -> str:
    """A HADR-plus as a call of ``live.weights``: configuration, constants, names, halves in base64.

    Raises:
        ValueError: The checkpoint is not a HADR-plus, or has a part that the page doesn't know.
    """
    network = DepthNetwork.load(checkpoint)
    model = network.model
    if not isinstance(model, hadr_plus.HADRPlus) or model.config.lite:
        raise ValueError(f"{checkpoint} is not a HADR-plus without a further encoder")
    plain = hadr_plus.HADRPlusConfig()
    for name in ("metric_crop", "hand_depth", "keypoint_maps", "color", "hand_vector"):
        if getattr(model.config, name) != getattr(plain, name):
            raise ValueError(f"{checkpoint} has {name} off, which the page doesn't know")
    tensors = {
        name: value.numpy().astype("<f2")
        for name, value in model.state_dict().items()
        if value.is_floating_point()
    }
    config = {n: getattr(model.config, n) for n in ("crop", "pixel_m", "candidates", "plane")}
    constants = {n: getattr(hadr_plus, n) for n in ("DEPTH_M", "NEAR_M", "GROUPS", "UNITS")}
    names = [(name, value.shape) for name, value in tensors.items()]
    return _call(
        "live.weights",
        config,
        constants,
        names,
        _text(b"".join(value.tobytes() for value in tensors.values())),
    )


def frames_script(frames: Sequence[Frame], size: tuple[int, int]) -> str:
    """Frames as calls of ``live.frame``, at a network's size (width, height), with their truth."""
    return "".join(_call("live.frame", _frame(one, size)) for one in frames)


def _frame(frame: Frame, size: tuple[int, int]) -> dict[str, Any]:
    """Of a frame a square around the mask, as high as the frame; ValueError without raw depth."""
    if frame.raw_depth is None:
        raise ValueError(f"frame {frame.stem} has no raw depth")
    raw = np.where(frame.object_mask, 0, frame.raw_depth)
    seen, true = (
        frame_to_input(frame.color, depth, frame.object_mask, frame.keypoints, frame.camera, size)
        for depth in (raw, frame.depth)
    )
    width, height = size
    columns = seen.mask[0].any(dim=0).nonzero()
    left = int(np.clip((int(columns.min()) + int(columns.max()) - height) // 2, 0, width - height))
    part = slice(left, left + height)
    fx, fy, cx, cy = seen.intrinsics[0].tolist()
    color = (255 * seen.color[0, :, :, part]).round().byte().permute(1, 2, 0).numpy()
    shown = resize_color(frame.color, SHOWN * width, SHOWN * height)
    return {
        "name": f"{OBJECTS[frame.object_id].name}, {frame.object_id}/{frame.stem}",
        "width": height,
        "height": height,
        "camera": [fx, fy, cx - left, cy],
        "keypoints": seen.keypoints[0].tolist(),
        "color": _text(color.tobytes()),
        "shown": _text(encode_color(shown[:, SHOWN * left : SHOWN * (left + height)], 85)),
        "depth": _text(_steps(seen.depth[0, :, part].numpy())),
        "truth": _text(_steps(true.depth[0, :, part].numpy())),
        "unit": DEPTH_UNIT,
        "mask": _text(np.packbits(seen.mask[0, :, part].numpy()).tobytes()),
    }


def _steps(depth: npt.NDArray[np.float32]) -> bytes:
    steps = np.clip(np.rint(depth / DEPTH_UNIT), 0, 65535).astype("<u2")
    return bytes(steps.tobytes())


def _text(data: bytes) -> str:
    return base64.b64encode(data).decode()


def _call(name: str, *values: Any) -> str:
    return f"{name}({', '.join(json.dumps(value, separators=(',', ':')) for value in values)});\n"
