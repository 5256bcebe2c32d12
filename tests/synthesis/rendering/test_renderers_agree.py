"""Three renderers that share no code see the same surfaces: Embree, Mitsuba and OpenGL."""

import importlib.util
import os
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from hadr.data.camera_log import BLENDER_FROM_OPENCV
from hadr.synthesis.generation.frames import build_scene, render_frame
from hadr.synthesis.generation.settings import GenerationSettings
from hadr.synthesis.rendering.raycast import RayCaster
from hadr.synthesis.rendering.shading import RayTracer

WIDTH, HEIGHT = 160, 90
SETTINGS = GenerationSettings(width=WIDTH, height=HEIGHT, quality="fast")


@pytest.fixture(scope="module", params=["centred", "off the axis"])
def scene(request):
    if request.param == "centred":
        return replace(build_scene(SETTINGS.recipe(0), SETTINGS), aperture=0.0)
    scene = replace(build_scene(SETTINGS.recipe(6), SETTINGS), aperture=0.0)
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
    description["sensor"] = mitsuba_sensor(scene, 1, 0)
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


def opengl_depth(scene):
    """Depth of the first surface at the pixel centres, metres, (H, W); skips where OpenGL lacks."""
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    camera = scene.camera
    # OpenGL counts pixels from their corners and looks along -z with y up.
    try:
        import pyrender

        drawn, nodes = pyrender.Scene(), {}
        for kind, surface in RayCaster(scene.contents).meshes:
            primitive = pyrender.Primitive(
                positions=surface.vertices.astype(np.float32),
                normals=surface.normals.astype(np.float32),
                # Segments leave faces out that look away, hence both windings.
                indices=np.concatenate([surface.faces, surface.faces[:, ::-1]]).astype(np.uint32),
            )
            nodes[drawn.add(pyrender.Mesh([primitive]))] = kind
        lens = pyrender.IntrinsicsCamera(
            camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5, znear=0.05, zfar=20.0
        )
        drawn.add(lens, pose=scene.world_from_camera @ BLENDER_FROM_OPENCV)
        renderer = pyrender.OffscreenRenderer(camera.width, camera.height)
    except Exception as error:  # each platform of PyOpenGL raises its own type
        pytest.skip(f"no OpenGL ({error}); on Debian: apt install libegl1 libgl1-mesa-dri")
    try:
        # A picture is multisampled: its depth is that of a sample beside the pixel's centre. The
        # pass that draws segments is not.
        return np.asarray(renderer.render(drawn, pyrender.RenderFlags.SEG, nodes)[1])
    finally:
        renderer.delete()


needs_mitsuba = pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None or importlib.util.find_spec("pyoidn") is None,
    reason="Mitsuba or Open Image Denoise is not installed: pip install 'hadr[generate]'",
)


@needs_mitsuba
def test_mitsuba_sees_the_depth_of_the_labels(scene):
    labels = RayTracer(scene.contents).labels(scene.camera, scene.world_from_camera)
    clear, everywhere = compare(mitsuba_depth(scene), labels)
    assert clear.max() < 0.0005
    # Single precision in Mitsuba; at an outline the two may take different sides.
    assert np.median(everywhere) < 1e-5
    assert (everywhere < 0.0005).mean() > 0.995


def test_opengl_sees_the_depth_of_the_labels(scene):
    labels = RayTracer(scene.contents).labels(scene.camera, scene.world_from_camera)
    depth = opengl_depth(scene)
    clear, everywhere = compare(depth, labels)
    assert clear.max() < 0.0005
    assert np.median(everywhere) < 3e-5
    assert (everywhere < 0.0005).mean() > 0.99


@needs_mitsuba
def test_both_engines_give_a_frame_the_same_labels():
    small = replace(SETTINGS, width=48, height=27, samples=1)
    traced, cast = (
        render_frame(SETTINGS.recipe(6), replace(small, engine=engine))
        for engine in ("photo", "raycast")
    )
    assert (traced.color != cast.color).any()
    parts = ["depth", "hand_mask", "object_mask", "background_depth", "normals", "keypoints"]
    for part in (*parts, "keypoints_uv", "world_from_camera", "world_from_object"):
        np.testing.assert_array_equal(getattr(traced, part), getattr(cast, part), err_msg=part)
