"""Three renderers that share no code see the same surfaces: Embree, Mitsuba and OpenGL."""

import importlib.util
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from hadr.synthesis.generation.frames import build_scene, render_frame
from hadr.synthesis.generation.recipes import frame_recipe
from hadr.synthesis.rendering.rasterise import rasterise

WIDTH, HEIGHT = 160, 90


@pytest.fixture(scope="module", params=["centred", "off the axis"])
def scene(request):
    if request.param == "centred":
        return build_scene(frame_recipe(0), 0, WIDTH, HEIGHT, "fast")
    scene = build_scene(frame_recipe(6), 0, WIDTH, HEIGHT, "fast")
    # As after a crop: the axis meets the picture 9 pixels beside its middle.
    camera = scene.camera
    return replace(scene, camera=replace(camera, cx=camera.cx + 8.3, cy=camera.cy - 5.6))


def away_from_edges(labels):
    """Pixels more than two away from where the kind of surface or the depth jumps."""
    kind = 2 * labels.object_mask + labels.hand_mask
    edge = np.zeros(kind.shape, dtype=bool)
    for axis in (0, 1):
        jump = np.abs(np.diff(kind, axis=axis)) > 0
        # A plane's inverse depth is linear in the image; a jump's is not.
        inverse = 1 / labels.depth.astype(float)
        bend = np.abs(np.diff(inverse, 2, axis=axis)) / np.delete(inverse, [0, -1], axis) > 0.01
        pad = [(0, 0), (0, 0)]
        pad[axis] = (1, 0)
        edge |= np.pad(jump, pad)
        pad[axis] = (1, 1)
        edge |= np.pad(bend, pad)
    return ~binary_dilation(edge, np.ones((5, 5)), iterations=1)


def compare(depth, labels):
    clear = away_from_edges(labels)
    assert clear.mean() > 0.5
    assert (clear & labels.object_mask).any()
    assert (clear & labels.hand_mask).any()
    return np.abs(depth - labels.depth)[clear], np.abs(depth - labels.depth)


def mitsuba_depth(scene):
    """Depth at the pixel centres, by Mitsuba's own camera and its own intersections."""
    from hadr.synthesis.rendering.mitsuba_scene import mitsuba_sensor, scene_to_mitsuba
    from hadr.synthesis.rendering.mitsuba_variant import mitsuba

    mi = mitsuba("scalar_rgb")
    description = scene_to_mitsuba(scene)
    description["sensor"] = mitsuba_sensor(scene.camera, scene.world_from_camera, 1, 0)
    loaded = mi.load_dict(description)
    sensor = loaded.sensors()[0]
    forward = scene.world_from_camera[:3, 2]
    eye = scene.world_from_camera[:3, 3]
    depth = np.zeros((HEIGHT, WIDTH))
    for row in range(HEIGHT):
        for column in range(WIDTH):
            film = ((column + 0.5) / WIDTH, (row + 0.5) / HEIGHT)
            ray, _ = sensor.sample_ray(0.0, 0.5, film, (0.5, 0.5))
            met = loaded.ray_intersect(ray)
            if met.is_valid():
                depth[row, column] = (np.array(met.p).ravel() - eye) @ forward
    return depth


needs_mitsuba = pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None or importlib.util.find_spec("pyoidn") is None,
    reason="Mitsuba or Open Image Denoise is not installed: pip install 'hadr[generate]'",
)


@needs_mitsuba
def test_mitsuba_sees_the_depth_of_the_labels(scene):
    labels = scene.rays.labels(scene.camera, scene.world_from_camera)
    clear, everywhere = compare(mitsuba_depth(scene), labels)
    assert clear.max() < 0.0005
    # Single precision in Mitsuba; at an outline the two may take different sides.
    assert np.median(everywhere) < 1e-5
    assert (everywhere < 0.0005).mean() > 0.995


def test_opengl_sees_the_depth_of_the_labels(scene):
    labels = scene.rays.labels(scene.camera, scene.world_from_camera)
    try:
        color, depth = rasterise(scene.rays, scene.camera, scene.world_from_camera)
    except RuntimeError as error:
        assert "No OpenGL here: install" in str(error)  # noqa: PT017
        pytest.skip(f"{error}; on Debian: apt install libegl1 libgl1-mesa-dri")
    assert color.shape == (HEIGHT, WIDTH, 3)
    clear, everywhere = compare(depth, labels)
    assert clear.max() < 0.0005
    assert np.median(everywhere) < 3e-5
    assert (everywhere < 0.0005).mean() > 0.99


@needs_mitsuba
def test_both_engines_give_a_frame_the_same_labels():
    traced, cast = (
        render_frame(frame_recipe(6), width=48, height=27, quality="fast", engine=engine, samples=1)
        for engine in ("photo", "raycast")
    )
    assert (traced.color != cast.color).any()
    for part in (
        "depth",
        "hand_mask",
        "object_mask",
        "background_depth",
        "normals",
        "keypoints",
        "keypoints_uv",
        "world_from_camera",
        "world_from_object",
    ):
        np.testing.assert_array_equal(getattr(traced, part), getattr(cast, part), err_msg=part)
