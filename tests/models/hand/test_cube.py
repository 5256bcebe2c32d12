"""The way into the hand's cube and back, and where the cube lies."""

import pytest
import torch

from hadr.models.hand.cube import HandCube, hand_center

INTRINSICS = torch.tensor([[200.0, 220.0, 79.5, 44.5], [100.0, 300.0, 70.0, 50.0]])


def cubes(size: int = 60) -> HandCube:
    return HandCube(torch.tensor([[0.0, 0.0, 0.6], [0.05, -0.02, 0.8]]), INTRINSICS, 0.3, size)


def test_centre_and_sides_by_hand() -> None:
    points = torch.tensor([[[0.0, 0.0, 0.6], [0.15, -0.15, 0.6], [0.0, 0.0, 0.75]]])
    found = HandCube(torch.tensor([[0.0, 0.0, 0.6]]), INTRINSICS[:1], 0.3, 8).into(points)
    wanted = torch.tensor([[[0.0, 0, 0], [1, -1, 0], [0, 0, 1]]])
    torch.testing.assert_close(found, wanted)


def test_a_pixel_s_point_is_where_the_camera_saw_it() -> None:
    """A tilted plane's depth, cut out and lifted, lies on the plane."""
    v, u = torch.meshgrid(torch.arange(100.0), torch.arange(160.0), indexing="ij")
    fx, fy, cx, cy = INTRINSICS[:, :, None, None].unbind(dim=1)
    x, y = (u - cx) / fx, (v - cy) / fy
    depth = 0.66 / (1 + 0.3 * x - 0.2 * y)  # z + 0.3 x - 0.2 y = 0.66 in metres
    cube = cubes()
    points, valid = cube.points(cube.crop(depth), stride=2)
    assert points.shape == (2, 3, 30, 30)
    found = cube.out_of(points.flatten(2).transpose(1, 2))  # (2, 900, 3)
    height = found[..., 2] + 0.3 * found[..., 0] - 0.2 * found[..., 1] - 0.66
    assert valid.sum() > 1000
    # the crop takes the nearest pixel: at most half of one away
    pixel = 0.8 * torch.tensor([0.3 / 200 + 0.2 / 220, 0.3 / 100 + 0.2 / 300]) / 2
    assert (height.abs() <= pixel[:, None] * 1.05)[valid.flatten(1)].all()


def test_crop_with_a_pixel_for_a_pixel_is_the_image() -> None:
    """At 0.6 m a cube of 0.3 m spans 100 pixels of a camera with f = 200."""
    intrinsics = torch.tensor([[200.0, 200.0, 59.5, 59.5]])
    depth = torch.full((1, 120, 120), 0.6)
    depth[0, 10, 110], depth[0, 20, 30], depth[0, 40, 50] = 0.5, 0.69, 0.9
    depth[0, 50, 60], depth[0, 60, 70] = 0.44, 0.0
    crop = HandCube(torch.tensor([[0.0, 0.0, 0.6]]), intrinsics, 0.3, 100).crop(depth)
    wanted = torch.zeros(100, 100)
    wanted[10, 20] = 0.6
    wanted[30, 40] = wanted[40, 50] = wanted[50, 60] = 1.0  # behind, before, missing
    torch.testing.assert_close(crop[0, 0], wanted, atol=1e-5, rtol=0)


def test_outside_of_the_image_there_is_nothing() -> None:
    intrinsics = torch.tensor([[200.0, 200.0, 9.5, 59.5]])
    crop = HandCube(torch.tensor([[0.0, 0.0, 0.6]]), intrinsics, 0.3, 100).crop(
        torch.full((1, 120, 120), 0.6)
    )
    assert (crop[0, 0, :, :40] == 1).all()
    assert (crop[0, 0, :, 40:] == 0).all()


def hand_and_arm() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """A glass, a hand beside it 0.6 m away, an arm that goes on to the right and away."""
    depth = torch.full((1, 144, 256), 1.5)
    held, hand = (torch.zeros(1, 144, 256, dtype=torch.bool) for _ in range(2))
    held[0, 60:90, 100:120] = True
    hand[0, 60:90, 120:240] = True
    depth[0, 60:90, 120:240] = 0.6 + torch.arange(120) / 400
    depth[held] = 0
    return depth, hand, held


CAMERA = torch.tensor([[200.0, 200.0, 127.5, 71.5]])


def test_the_hand_s_centre_is_beside_the_object_and_not_on_the_arm() -> None:
    depth, hand, held = hand_and_arm()
    center = hand_center(depth, hand, held, CAMERA)
    # columns 120..123 and rows 60..89 lie within 4 pixels of the glass
    z = 0.6 + torch.arange(4) / 400
    column, row = torch.arange(120, 124), torch.arange(60, 90)
    x = (column - 127.5) / 200 * z
    y = (row[:, None] - 71.5) / 200 * z
    assert center[0, 2] == pytest.approx(0.60375)
    assert center[0, 0] == pytest.approx(float((x[1] + x[2]) / 2))
    assert center[0, 1] == pytest.approx(float(y.flatten().quantile(0.5)))


def test_without_an_object_all_of_the_hand_counts() -> None:
    depth, hand, held = hand_and_arm()
    center = hand_center(depth, hand, torch.zeros_like(held), CAMERA)
    assert center[0, 2] == pytest.approx(0.6 + 59.5 / 400)


def test_a_hand_without_depth_is_named() -> None:
    depth, hand, held = hand_and_arm()
    two = [torch.cat((images, images)) for images in (depth, hand, held)]
    two[0][1][hand[0]] = 0
    with pytest.raises(ValueError, match="frame 1 of the batch shows no hand: of the 3600 pixels"):
        hand_center(*two, CAMERA.repeat(2, 1))
