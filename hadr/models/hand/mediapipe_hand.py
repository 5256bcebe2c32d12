"""Hand keypoints as the paper's real system finds them: MediaPipe's landmarks, lifted by depth.

The paper's authors found the regression from depth to suffer from occlusion and noise on real
frames. Their robot takes the 21 landmarks that MediaPipe finds in the colour picture instead: each
has a pixel and a depth relative to the wrist's, and the camera's depth at the wrist makes them 3D.
A wrist is often hidden, so `lift_landmarks` asks all landmarks that are seen.

MediaPipe is no part of this library: it is the extra "mediapipe", and `hadr hand-model` makes its
model's file. Only `MediaPipeHand` needs them; `lift_landmarks`, which follows on it, does not.

Of the two depths relative to the wrist's that MediaPipe gives, the landmarks' own is taken: it
erred by 16.9 mm on 117 photographs of real hands, of which it found 116, that of its world
landmarks by 20.6 mm. On the bundled computed frames it finds 394 of 480 hands; the median frame
errs by 30 mm, lifted by the wrist alone by 47 mm (32 and 56 mm by the world landmarks).

Source: paper, "Implementation" of the real-world experiments; MediaPipe, hand landmark detection:
landmarks have x and y in 0..1 of the picture's width and height, and z relative to the wrist's in
about the unit of x. The order of the 21 is that of `hadr.hand.KEYPOINT_NAMES`.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from hadr.camera import BoolArray, FloatArray, Intrinsics
from hadr.frame_io import quiet
from hadr.hand import check_keypoints, lift_keypoints
from hadr.models.hand.plausible import LEAST_SEEN, NoHandError, median_depth

NEAR_PIXELS = 2
"""How many pixels around a landmark's are looked at for its depth."""
HANDS = 4
"""At most so many hands are looked at: those of two people."""
CONFIDENCE = 0.5
"""From this confidence on a hand counts as found."""


def lift_landmarks(
    result: Any,
    depth: FloatArray,
    camera: Intrinsics,
    hand_mask: BoolArray | None = None,
    *,
    beside: BoolArray | None = None,
) -> npt.NDArray[np.float64]:
    """Lift the landmarks of a hand that MediaPipe found: camera frame, metres, (21, 3).

    Each at whose pixel depth was measured says how far away the wrist is, and their median counts.
    Depth is z-depth in metres, registered to the colour, (H, W), 0 or NaN = missing; only that in
    the hand mask counts, (H, W), if there is one. Of several hands the one whose landmarks are the
    nearest to the pixels `beside`, (H, W), of what it holds, is taken; the first one without.

    The camera measures the skin, one or two centimetres in front of the joint; as in the paper no
    correction is made, so all points lie that much too near.

    Raises:
        NoHandError: No hand was found, depth is known at too few of its landmarks, or a keypoint
            would lie behind the camera.
        ValueError: It has not 21 landmarks, or one is not finite; or an image is of another size.
    """
    if depth.shape != camera.shape:
        raise ValueError(f"depth must be {camera.shape} as the intrinsics, got {depth.shape}")
    if hand_mask is not None and hand_mask.shape != camera.shape:
        raise ValueError(f"hand_mask must be {camera.shape}, got {hand_mask.shape}")
    if not result.hand_landmarks:
        raise NoHandError("it sees none in the picture")
    # Each (21, 3): to the right, down, and away from the camera.
    hands = [check_keypoints([[p.x, p.y, p.z] for p in hand]) for hand in result.hand_landmarks]
    size = np.array([camera.width, camera.height])
    pixels = [hand[:, :2] * size - 0.5 for hand in hands]  # from the edges to pixel centres
    chosen = 0 if beside is None else _nearest(pixels, beside)
    picture, uv = hands[chosen], pixels[chosen]
    # Of the wrist's depth so many times more: z is in picture widths at that depth.
    deeper = (picture[:, 2] - picture[0, 2]) * camera.width / camera.fx
    try:
        seen = depth if hand_mask is None else np.where(hand_mask, depth, 0)
        measured = np.array([median_depth(seen, pixel, NEAR_PIXELS) for pixel in uv])
        known = np.isfinite(measured)
        if known.sum() < LEAST_SEEN:
            raise ValueError(f"depth is known at {known.sum()} of its 21 landmarks alone")
        wrist = float(np.median((measured / (1 + deeper))[known]))
        return lift_keypoints(uv, deeper * wrist, wrist, camera)
    except ValueError as error:
        raise NoHandError(f"what it sees can't be lifted to 3D: {error}") from error


def _nearest(hands: Sequence[npt.NDArray[np.float64]], pixels: BoolArray) -> int:
    """Number of the hand, each (21, 2) pixels, with the least mean distance to some pixels."""
    if len(hands) < 2 or not pixels.any():
        return 0
    away = ndimage.distance_transform_edt(~pixels)
    rows_columns = [np.rint(uv[:, ::-1]).clip(0, np.array(pixels.shape) - 1) for uv in hands]
    return int(np.argmin([away[tuple(at.astype(int).T)].mean() for at in rows_columns]))


class MediaPipeHand:
    """MediaPipe's hand landmarker, loaded once; use it in a `with` statement.

    Args:
        model: Its model's file, `hand_landmarker.task`, as `hadr hand-model` makes it.

    Raises:
        ImportError: MediaPipe is not installed.
        FileNotFoundError: There is no such file.
        ValueError: The file is no such model.
    """

    name = "MediaPipe"
    needs_hand_mask = False

    def __init__(self, model: str | Path) -> None:
        if importlib.util.find_spec("mediapipe") is None:
            raise ImportError(
                "hand keypoints from colour need MediaPipe, which is not installed: "
                "pip install 'hadr[mediapipe]'"
            )
        if not Path(model).is_file():
            raise FileNotFoundError(
                f"there is no hand landmarker model at {model}; make one with "
                "'hadr hand-model --out hand_landmarker.task' and give its path"
            )
        import mediapipe

        self._mediapipe: Any = mediapipe
        tasks: Any = mediapipe.tasks
        try:
            with quiet():
                self._landmarker: Any = tasks.vision.HandLandmarker.create_from_options(
                    tasks.vision.HandLandmarkerOptions(
                        base_options=tasks.BaseOptions(model_asset_path=str(model)),
                        num_hands=HANDS,
                        min_hand_detection_confidence=CONFIDENCE,
                    )
                )
        except (RuntimeError, ValueError) as error:
            raise ValueError(
                f"MediaPipe can't use {model} as its hand landmarker model: "
                f"{str(error).splitlines()[0]}; make one with 'hadr hand-model'"
            ) from error

    def find(
        self,
        color: npt.NDArray[np.uint8],
        depth: FloatArray,
        camera: Intrinsics,
        mask: BoolArray | None = None,
        hand_mask: BoolArray | None = None,
    ) -> npt.NDArray[np.float64]:
        """Find the keypoints of the hand in one frame that is the nearest to the glass.

        From RGB (H, W, 3) uint8 and the glass's mask (H, W), without which the first hand is taken;
        depth, camera, hand mask, result and errors as of `lift_landmarks`.
        """
        if color.shape != (*camera.shape, 3) or color.dtype != np.uint8:
            raise ValueError(
                f"color must be {(*camera.shape, 3)} uint8, got {color.shape} {color.dtype}"
            )
        image = self._mediapipe.Image(
            image_format=self._mediapipe.ImageFormat.SRGB, data=np.ascontiguousarray(color)
        )
        with quiet():
            result = self._landmarker.detect(image)
        return lift_landmarks(result, depth, camera, hand_mask, beside=mask)

    def close(self) -> None:
        """Free the landmarker."""
        self._landmarker.close()

    def __enter__(self) -> MediaPipeHand:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
