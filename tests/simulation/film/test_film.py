"""Pictures and films of the handover: what stands where, and what comes back from the files."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
import pytest
from PIL import Image

from hadr.camera import project, transform_points
from hadr.handover.simulated_ur5 import SimulatedUR5
from hadr.handover.stages import Stage, Transition
from hadr.simulation.camera.moving_view import SeenLabels
from hadr.simulation.film.film import (
    CAPTION_HEIGHT,
    STAGE_COLORS,
    captioned,
    film_frames,
    film_times,
    nearest_state,
    stage_at,
    write_film,
)
from hadr.simulation.film.world_view import FilmSet, View, close_view, side_view, view_from
from hadr.simulation.world.scenes import HeldScene, held_scene
from hadr.simulation.world.state import WorldState

SMALL = side_view(240, 136)
CHANGES = [
    Transition(1.0, Stage.WAIT_AND_OBSERVE, Stage.APPROACH_AND_REACT, "chose a grasp"),
    Transition(3.0, Stage.APPROACH_AND_REACT, Stage.STOPPED, "no hand seen for 0.30 s"),
]


@pytest.fixture(scope="module")
def scene() -> HeldScene:
    return held_scene("0001", 920)


@pytest.fixture(scope="module")
def start(scene: HeldScene, at: Callable[..., WorldState]) -> WorldState:
    return at(scene, 0.0, gripper_width=0.06)


@pytest.fixture(scope="module")
def picture(scene: HeldScene, start: WorldState) -> np.ndarray:
    return FilmSet(scene, SMALL).draw(start)


def shown(scene: HeldScene, view: View, state: WorldState) -> SeenLabels:
    return FilmSet(scene, view).at(state).seen(view.camera, view.base_from_camera)


def pixel(view: View, point: object) -> np.ndarray:
    """Where a point of the base frame (3,), metres, appears: column and row."""
    seen = transform_points(np.linalg.inv(view.base_from_camera), np.array([point], dtype=float))
    return project(seen, view.camera)[0]


def there(mask: np.ndarray, point: np.ndarray) -> bool:
    u, v = pixel(SMALL, point)
    return bool(mask[round(v), round(u)])


def test_a_view_looks_where_it_is_told_and_is_as_wide_as_told() -> None:
    view = view_from((0.3, -2.0, 0.4), (0.3, 0.0, 0.4), width=201, height=101, across=1.0)
    assert pixel(view, (0.3, 0.0, 0.4)) == pytest.approx((100.0, 50.0))
    assert pixel(view, (0.8, 0.0, 0.4)) == pytest.approx((200.5, 50.0))
    assert pixel(view, (0.3, 0.0, 0.5)) == pytest.approx((100.0, 50.0 - 20.1))


def test_fingers_hand_glass_and_sleeve_stand_at_their_pixels(
    scene: HeldScene, start: WorldState
) -> None:
    labels = shown(scene, SMALL, start)
    tool = SimulatedUR5().tool_pose()
    for side in (-1, 1):  # the middle of each finger
        finger = tool @ [side * (0.03 + 0.005), 0.0, -0.03, 1.0]
        assert there(labels.arm_mask, finger[:3])
    assert there(labels.arm_mask, tool[:3, 3] - 0.11 * tool[:3, 2])  # the gripper's body
    assert there(labels.object_mask, (scene.base_from_object @ [0, 0, 0.15, 1])[:3])
    forearm, sleeve = ((scene.base_from_wrist @ [0, y, 0, 1])[:3] for y in (-0.08, -0.25))
    assert there(labels.hand_mask, forearm)
    assert not there(labels.hand_mask, sleeve)
    assert there(labels.arm_mask, sleeve)


def test_skin_is_reddish_and_the_sleeve_is_blue(scene: HeldScene, picture: np.ndarray) -> None:
    assert picture.shape == (136, 240, 3)
    assert picture.dtype == np.uint8

    def color(y: float) -> np.ndarray:
        u, v = pixel(SMALL, (scene.base_from_wrist @ [0, y, 0, 1])[:3])
        return picture[round(v), round(u)].astype(float)

    red, _, blue = color(-0.08)
    assert red > 1.2 * blue
    red, _, blue = color(-0.25)
    assert blue > 1.2 * red


def test_the_object_is_drawn_where_the_state_says(
    scene: HeldScene, start: WorldState, picture: np.ndarray
) -> None:
    moved = start.base_from_object.copy()
    moved[:3, 3] += [-0.25, 0.0, 0.25]
    state = replace(start, base_from_object=moved)
    mask = shown(scene, SMALL, state).object_mask
    assert all(there(mask, (moved @ [0, 0, z, 1])[:3]) for z in (0.12, 0.14, 0.16))
    before = [(start.base_from_object @ [0, 0, z, 1])[:3] for z in (0.14, 0.16)]
    assert not any(there(mask, point) for point in before)
    changed = (FilmSet(scene, SMALL).draw(state) != picture).any(axis=2)
    assert changed[mask].mean() > 0.5


def test_a_moment_is_drawn_without_noise(
    scene: HeldScene, start: WorldState, picture: np.ndarray
) -> None:
    drawn = FilmSet(scene, SMALL)
    drawn.draw(replace(start, joints=start.joints + 0.1))
    np.testing.assert_array_equal(drawn.draw(start), picture)


def test_glass_is_seen_through_and_has_darker_and_brighter_places(
    scene: HeldScene, start: WorldState
) -> None:
    view = close_view(tuple((start.base_from_object @ [0, 0, 0.14, 1])[:3]), 160, 90)
    light = FilmSet(scene, view).draw(start).astype(float).mean(axis=2)
    labels = shown(scene, view, start)
    glass = light[labels.object_mask]
    wall = np.median(light[:20][labels.depth[:20] == 0])
    assert abs(np.median(glass) - wall) < 45  # the wall shows through
    assert np.percentile(glass, 3) < wall - 25  # outlines
    assert glass.max() > np.median(glass) + 20  # mirrored panels


def test_an_arm_over_the_table_throws_a_shadow(scene: HeldScene, start: WorldState) -> None:
    view = view_from((0.3, -0.8, 1.2), (0.15, 0.1, 0.0), width=120, height=90, across=1.0)
    away = replace(start, joints=start.joints + np.array([np.pi, 0, 0, 0, 0, 0]))
    here, turned = (FilmSet(scene, view).draw(s).astype(float).mean(axis=2) for s in (start, away))
    both = np.ones(view.camera.shape, dtype=bool)
    for state in (start, away):
        labels = shown(scene, view, state)
        both &= (labels.depth > 0) & ~(labels.arm_mask | labels.hand_mask | labels.object_mask)
    change = (here - turned)[both]
    assert (change < -25).sum() > 40
    assert (change > 25).sum() > 40


def test_the_stage_is_the_last_one_entered() -> None:
    assert stage_at(0.5, CHANGES) == (Stage.WAIT_AND_OBSERVE, "")
    assert stage_at(1.0, CHANGES) == (Stage.APPROACH_AND_REACT, "chose a grasp")
    assert stage_at(9.0, CHANGES) == (Stage.STOPPED, "no hand seen for 0.30 s")
    assert stage_at(9.0, []) == (Stage.WAIT_AND_OBSERVE, "")


def test_the_ribbon_has_each_stage_in_its_place() -> None:
    picture = np.full((60, 400, 3), 255, dtype=np.uint8)
    whole = captioned(picture, 2.0, CHANGES, (0.0, 4.0))
    assert whole.shape == (60 + CAPTION_HEIGHT, 400, 3)
    np.testing.assert_array_equal(whole[-50:], picture[-50:])
    for column, stage in (
        (50, Stage.WAIT_AND_OBSERVE),  # 0 to 1 s: columns 0 to 100
        (150, Stage.APPROACH_AND_REACT),
        (290, Stage.APPROACH_AND_REACT),
        (310, Stage.STOPPED),
        (399, Stage.STOPPED),
    ):
        expected = tuple(int(STAGE_COLORS[stage][i : i + 2], 16) for i in (1, 3, 5))
        assert tuple(whole[CAPTION_HEIGHT - 5, column]) == expected
    assert whole[CAPTION_HEIGHT - 5, 200].max() < 60  # the mark of the time: 2 of 4 s
    # the caption changes with stage, time and note
    assert not np.array_equal(whole, captioned(picture, 2.1, CHANGES, (0.0, 4.0)))
    assert not np.array_equal(whole, captioned(picture, 2.0, CHANGES, (0.0, 4.0), "a note"))


def test_pictures_are_spread_over_the_whole_run(start: WorldState) -> None:
    states = [replace(start, time=0.5 + 0.1 * k) for k in range(21)]
    assert film_times(states, 5) == pytest.approx(np.linspace(0.5, 2.5, 11))
    assert film_times(states[:1], 5) == [0.5]
    assert film_times(states, 3)[-1] == 2.5
    assert nearest_state(states, 1.04).time == pytest.approx(1.0)
    with pytest.raises(ValueError, match="at least one state, got none"):
        film_times([], 5)
    with pytest.raises(ValueError, match="rate must be positive, got 0"):
        film_times(states, 0)


@pytest.fixture(scope="module")
def frames(scene: HeldScene, start: WorldState) -> list[np.ndarray]:
    """Four pictures of a film, the arm turning."""

    def moved(k: int) -> WorldState:
        joints = start.joints + np.array([-0.1 * k, 0, 0, 0, 0, 0])
        return replace(start, time=0.2 * k, joints=joints)

    states, view = [moved(k) for k in range(4)], side_view(128, 72)
    return list(film_frames(states, scene, CHANGES, view=view, rate=5, hold=0.0))


@pytest.mark.parametrize("ending", [".mp4", ".gif"])
def test_a_film_read_back_has_its_pictures(
    ending: str, tmp_path: Path, frames: list[np.ndarray]
) -> None:
    assert len(frames) == 4
    path = write_film(tmp_path / "new" / f"film{ending}", frames, rate=5)
    if ending == ".gif":
        with Image.open(path) as film:
            assert film.n_frames == 4
            assert film.size == (128, 72 + CAPTION_HEIGHT)
            film.seek(3)
            last = np.asarray(film.convert("RGB"))
    else:
        read = [np.asarray(frame) for frame in imageio.get_reader(path).iter_data()]
        assert len(read) == 4
        assert read[0].shape == (72 + CAPTION_HEIGHT, 128, 3)
        assert imageio.get_reader(path).get_meta_data()["fps"] == 5
        last = read[-1]
    error = [np.abs(last.astype(float) - frame).mean() for frame in frames]
    assert int(np.argmin(error)) == 3
    assert error[3] < 4


def test_the_ending_stands_below_the_last_picture_alone(
    scene: HeldScene, start: WorldState
) -> None:
    states = [replace(start, time=0.2 * k) for k in range(2)]

    def frames(**words: str) -> list[np.ndarray]:
        view = side_view(128, 72)
        return list(film_frames(states, scene, CHANGES, view=view, rate=5, hold=0.4, **words))

    with_ending, without = frames(ending="drop after 0.2 s"), frames()
    assert len(with_ending) == 4
    np.testing.assert_array_equal(with_ending[0], without[0])
    for k in range(1, 4):  # as long as the last one stays
        assert not np.array_equal(with_ending[k], without[k])


@pytest.mark.parametrize("ending", [".mp4", ".gif"])
def test_a_film_is_written_whole_or_not_at_all(ending: str, tmp_path: Path) -> None:
    frame = np.zeros((20, 30, 3), dtype=np.uint8)
    path = tmp_path / f"film{ending}"
    path.write_bytes(b"the film before")

    def broken() -> Iterator[np.ndarray]:
        yield frame
        raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        write_film(path, broken())
    assert path.read_bytes() == b"the film before"
    assert list(tmp_path.iterdir()) == [path]
    write_film(path, [frame, frame])
    assert path.read_bytes() != b"the film before"
    assert list(tmp_path.iterdir()) == [path]


def test_what_is_no_film_is_refused(tmp_path: Path) -> None:
    frame = np.zeros((20, 30, 3), dtype=np.uint8)
    with pytest.raises(ValueError, match=r"must end in \.mp4 or \.gif, got 'film\.avi'"):
        write_film(tmp_path / "film.avi", [frame])
    with pytest.raises(ValueError, match="at least one picture, got none"):
        write_film(tmp_path / "film.mp4", [])
    with pytest.raises(ValueError, match="even height and width, got 21 x 30"):
        write_film(tmp_path / "film.mp4", [np.zeros((21, 30, 3), dtype=np.uint8)])
    with pytest.raises(ValueError, match=r"one size .* got \(18, 30, 3\) uint8"):
        write_film(tmp_path / "film.gif", [frame, frame[:18]])
