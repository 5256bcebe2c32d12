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
from safetensors.numpy import load_file

from hadr.data.frame import Frame
from hadr.models import hadr_plus
from hadr.models.blocks.efficientnet_lite import ENDS, ROWS
from hadr.models.network_input import frame_to_input
from hadr.synthesis.glass.objects import OBJECTS
from hadr.trained_networks import DepthNetwork
from hadr.training.checkpoints import STEP

DEPTH_UNIT = 1e-4
"""Metres of a step of the frames' depth."""


def weights_script(checkpoint: str | Path) -> str:
    """A HADR-plus as a call of ``live.weights``: configuration, constants, names and the tensors.

    Raises:
        ValueError: The checkpoint is not a HADR-plus, or has a part that the page doesn't know.
    """
    network = DepthNetwork.load(checkpoint)
    model = network.model
    if not isinstance(model, hadr_plus.HADRPlus):
        raise ValueError(f"{checkpoint} is not a HADR-plus")
    plain = hadr_plus.HADRPlusConfig()
    for name in ("metric_crop", "hand_depth", "keypoint_maps", "color", "hand_vector"):
        if getattr(model.config, name) != getattr(plain, name):
            raise ValueError(f"{checkpoint} has {name} off, which the page doesn't know")
    names: list[tuple[Any, ...]] = []
    data = b""
    tensors = load_file(checkpoint)
    for name, value in tensors.items():
        if value.dtype == np.int8 and (step := tensors.get(STEP + name)) is not None:
            names.append((name, value.shape, step.tolist()))
            data += value.tobytes()
        elif np.issubdtype(value.dtype, np.floating) and not name.startswith(STEP):
            names.append((name, value.shape))
            data += value.astype("<f2").tobytes()
    config = {n: getattr(model.config, n) for n in ("crop", "pixel_m", "candidates", "plane")}
    if lite := model.config.lite:
        ends = ENDS[: lite.stages]
        config["lite"] = {"rows": ROWS[: ends[-1] + 1], "ends": ends}
    constants = {n: getattr(hadr_plus, n) for n in ("DEPTH_M", "NEAR_M", "GROUPS", "UNITS")}
    return _call("live.weights", config, constants, names, _text(data))


def frames_script(frames: Sequence[Frame], size: tuple[int, int]) -> str:
    """Frames as calls of ``live.frame``, at a network's size (width, height), with their truth."""
    return "".join(_call("live.frame", _frame(one, size)) for one in frames)


def _frame(frame: Frame, size: tuple[int, int]) -> dict[str, Any]:
    """A frame at a network's size; ValueError without raw depth."""
    if frame.raw_depth is None:
        raise ValueError(f"frame {frame.stem} has no raw depth")
    raw = np.where(frame.object_mask, 0, frame.raw_depth)
    seen, true = (
        frame_to_input(frame.color, depth, frame.object_mask, frame.keypoints, frame.camera, size)
        for depth in (raw, frame.depth)
    )
    color = (255 * seen.color[0]).round().byte().permute(1, 2, 0).numpy()
    return {
        "name": f"{OBJECTS[frame.object_id].name}, {frame.object_id}/{frame.stem}",
        "width": size[0],
        "height": size[1],
        "camera": seen.intrinsics[0].tolist(),
        "keypoints": seen.keypoints[0].tolist(),
        "color": _text(color.tobytes()),
        "depth": _text(_steps(seen.depth[0].numpy())),
        "truth": _text(_steps(true.depth[0].numpy())),
        "unit": DEPTH_UNIT,
        "mask": _text(np.packbits(seen.mask[0].numpy()).tobytes()),
    }


def _steps(depth: npt.NDArray[np.float32]) -> bytes:
    steps = np.clip(np.rint(depth / DEPTH_UNIT), 0, 65535).astype("<u2")
    return bytes(steps.tobytes())


def _text(data: bytes) -> str:
    return base64.b64encode(data).decode()


def _call(name: str, *values: Any) -> str:
    return f"{name}({', '.join(json.dumps(value, separators=(',', ':')) for value in values)});\n"
