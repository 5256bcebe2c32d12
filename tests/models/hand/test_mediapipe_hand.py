"""The lift of MediaPipe's landmarks on a result made by hand; MediaPipe itself is not needed."""

from dataclasses import dataclass, field
from types import ModuleType

import numpy as np
import pytest

from hadr.camera import Intrinsics, project, unproject
from hadr.models.hand.mediapipe_hand import MediaPipeHand, lift_landmarks
from hadr.models.hand.plausible import NoHandError

CAMERA = Intrinsics(200.0, 220.0, 79.5, 59.5, 160, 120)


@dataclass
class Point:
    x: float
    y: float
    z: float


@dataclass
class Result:
    hand_landmarks: list[list[Point]] = field(default_factory=list)


def hand() -> np.ndarray:
    points = np.random.default_rng(0).uniform(-0.06, 0.06, (21, 3)) + np.array([0.02, 0, 0.6])
    points[0] = [0.0, 0.0, 0.6]
    return points


def result_of(points: np.ndarray) -> Result:
    """What a perfect landmarker would say."""
    u = CAMERA.fx * points[:, 0] / points[:, 2] + CAMERA.cx
    v = CAMERA.fy * points[:, 1] / points[:, 2] + CAMERA.cy
    z = (points[:, 2] - points[0, 2]) * CAMERA.fx / (CAMERA.width * points[0, 2])
    image = [Point((a + 0.5) / 160, (b + 0.5) / 120, c) for a, b, c in zip(u, v, z, strict=True)]
    return Result([image])


def wall() -> np.ndarray:
    return np.full((120, 160), 0.6, dtype=np.float32)


def spread() -> np.ndarray:
    """A hand whose landmarks are 11 pixels or more from each other: five rows of five."""
    rows, columns = np.divmod(np.arange(21), 5)
    z = 0.6 + np.random.default_rng(1).uniform(-0.05, 0.05, 21)
    uv = np.stack([30 + 15 * columns, 20 + 15 * rows], axis=1)
    return unproject(uv, z, CAMERA)


def skin_of(points: np.ndarray) -> np.ndarray:
    """Depth of 5 x 5 pixels around each of them, and nothing else."""
    depth = np.zeros((120, 160), dtype=np.float32)
    for (u, v), z in zip(project(points, CAMERA).round().astype(int), points[:, 2], strict=True):
        depth[v - 2 : v + 3, u - 2 : u + 3] = z
    return depth


def test_all_landmarks_with_depth_say_how_far_the_hand_is() -> None:
    """The wrist is hidden, five landmarks lie behind what is before them, and two on the wall."""
    depth = skin_of(spread())
    for number, seen in {0: 0.0, 1: 0.4, 2: 0.4, 3: 0.41, 4: 0.42, 5: 0.38, 6: 2.0, 7: 2.0}.items():
        depth[(near := skin_of(spread()[[number]]) > 0)] = seen
        assert near.sum() == 25
    found = lift_landmarks(result_of(spread()), depth, CAMERA)
    np.testing.assert_allclose(found, spread(), atol=1e-6)
    fingers = skin_of(spread()[8:]) > 0
    few = np.where(skin_of(spread()[:4]) > 0, depth, 0)
    with pytest.raises(NoHandError, match="depth is known at 3 of its 21 landmarks"):
        lift_landmarks(result_of(spread()), few, CAMERA)
    away = np.where(fingers, depth, 3.0).astype(np.float32)
    found = lift_landmarks(result_of(spread()), away, CAMERA, fingers)
    np.testing.assert_allclose(found, spread(), atol=1e-6)


def test_the_depth_at_the_landmarks_moves_and_scales_the_whole_hand_along_its_rays() -> None:
    found = lift_landmarks(result_of(spread()), skin_of(spread()) * 0.9, CAMERA)
    np.testing.assert_allclose(found, spread() * 0.9, atol=1e-6)


def test_of_several_hands_the_one_at_the_glass_is_taken() -> None:
    near, far = hand(), hand() + np.array([0.15, 0.0, 0.0])
    both = result_of(far)
    both.hand_landmarks += result_of(near).hand_landmarks
    glass = np.zeros((120, 160), dtype=bool)
    glass[50:70, 60:70] = True  # left of the nearer hand's wrist, at pixel (80, 60)
    for beside, expected in ((glass, near), (None, far), (np.zeros_like(glass), far)):
        found = lift_landmarks(both, wall(), CAMERA, beside=beside)
        np.testing.assert_allclose(project(found, CAMERA), project(expected, CAMERA), atol=1e-6)


def test_no_hand_is_said() -> None:
    with pytest.raises(NoHandError, match="it sees none in the picture"):
        lift_landmarks(Result(), wall(), CAMERA)


def test_wrong_results_are_named() -> None:
    short = result_of(hand())
    short.hand_landmarks[0].pop()
    with pytest.raises(ValueError, match=r"21 keypoints, shape \(21, 3\) in metres; got \(20, 3\)"):
        lift_landmarks(short, wall(), CAMERA)
    broken = result_of(hand())
    broken.hand_landmarks[0][8].x = float("nan")
    with pytest.raises(ValueError, match="not so: index_tip"):
        lift_landmarks(broken, wall(), CAMERA)
    with pytest.raises(ValueError, match=r"depth must be \(120, 160\).*got \(4, 4\)"):
        lift_landmarks(result_of(hand()), np.ones((4, 4)), CAMERA)


def test_without_the_package_or_the_file_it_is_said_what_to_do(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ImportError, match=r"pip install 'hadr\[mediapipe\]'"):
        MediaPipeHand(tmp_path / "hand_landmarker.task")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: "there")
    with pytest.raises(FileNotFoundError, match=r"no hand landmarker model at .*other\.task"):
        MediaPipeHand(tmp_path / "other.task")


class FakeLandmarker:
    closed = False

    def __init__(self, options: dict[str, object]) -> None:
        self.options = options

    @classmethod
    def create_from_options(cls, options: dict[str, object]) -> "FakeLandmarker":
        with open(options["base_options"]["model_asset_path"], "rb") as file:
            if file.read() != b"model":
                raise RuntimeError("Unable to open zip archive.\nline 2")
        return cls(options)

    def detect(self, image: dict[str, object]) -> Result:
        assert image["image_format"] == "RGB"
        assert image["data"].shape == (120, 160, 3)
        return result_of(spread())

    def close(self) -> None:
        FakeLandmarker.closed = True


@pytest.fixture
def fake_mediapipe(monkeypatch: pytest.MonkeyPatch) -> None:
    fake, tasks, vision = (ModuleType(n) for n in ("mediapipe", "tasks", "vision"))
    vision.HandLandmarker, vision.HandLandmarkerOptions = FakeLandmarker, dict
    tasks.vision, tasks.BaseOptions = vision, dict
    fake.tasks, fake.Image = tasks, dict
    fake.ImageFormat = type("ImageFormat", (), {"SRGB": "RGB"})
    monkeypatch.setitem(__import__("sys").modules, "mediapipe", fake)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: "there")


@pytest.mark.usefixtures("fake_mediapipe")
def test_the_landmarker_is_asked_and_closed(tmp_path) -> None:
    path = tmp_path / "hand_landmarker.task"
    path.write_bytes(b"model")
    color = np.zeros((120, 160, 3), dtype=np.uint8)
    with MediaPipeHand(path) as detector:
        found = detector.find(color, skin_of(spread()), CAMERA)
        assert detector._landmarker.options["base_options"] == {"model_asset_path": str(path)}
        assert detector._landmarker.options["min_hand_detection_confidence"] == 0.5
        with pytest.raises(ValueError, match=r"color must be \(120, 160, 3\) uint8"):
            detector.find(color[:4], wall(), CAMERA)
    np.testing.assert_allclose(found, spread(), atol=1e-6)
    assert FakeLandmarker.closed


@pytest.mark.usefixtures("fake_mediapipe")
def test_another_file_is_no_model(tmp_path) -> None:
    path = tmp_path / "other.task"
    path.write_bytes(b"no model")
    with pytest.raises(ValueError, match=r"can't use .*other\.task .*: Unable to open zip arch.*;"):
        MediaPipeHand(path)
