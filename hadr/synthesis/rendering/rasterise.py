"""A quick OpenGL preview of a scene's surfaces: colour and depth without refraction.

The ray caster needs no graphics driver and makes every frame of the data sets. Where OpenGL is
there, this draws the same surfaces in milliseconds, to look around in a scene, and as a witness
that the labels are right.
"""

from __future__ import annotations

import os
import sys
from typing import Any

import numpy as np
import numpy.typing as npt

from hadr.camera import Intrinsics
from hadr.data.camera_log import BLENDER_FROM_OPENCV
from hadr.synthesis.rendering.raycast import GLASS, RayCaster

Array = npt.NDArray[np.float64]

_ADVICE = (
    "No OpenGL here: install a driver with EGL, or Mesa (libegl1 and libgl1-mesa-dri) and set "
    "PYOPENGL_PLATFORM=egl before Python starts. The ray caster (hadr generate) needs neither"
)


def _pyrender() -> Any:
    """Import pyrender, headless on Linux unless the user has chosen a platform."""
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    try:
        import pyrender
    except (ImportError, OSError, AttributeError) as error:
        raise RuntimeError(f"{_ADVICE} ({type(error).__name__}: {error})") from error
    return pyrender


def rasterise(
    scene: RayCaster, camera: Intrinsics, world_from_camera: Array
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32]]:
    """Draw a preview.

    Args:
        scene: The surfaces, world frame.
        camera: Intrinsics.
        world_from_camera: Pose of the OpenCV camera, shape (4, 4).

    Returns:
        sRGB, shape (H, W, 3) uint8, the glass half transparent; and the z-depth of the first
        surface at the pixel centres, metres, (H, W) float32, 0 where there is none.

    Raises:
        RuntimeError: There is no OpenGL; the message says what to install.
    """
    pyrender = _pyrender()
    drawn = pyrender.Scene(bg_color=(0.5, 0.5, 0.5, 1.0), ambient_light=(0.5, 0.5, 0.5))
    nodes: dict[Any, int] = {}
    colors = {GLASS: (0.6, 0.8, 1.0, 0.45)}
    for kind, surface in scene.meshes:
        rgba = colors.get(kind, (0.75, 0.6, 0.5, 1.0))
        material = pyrender.MetallicRoughnessMaterial(
            baseColorFactor=rgba,
            alphaMode="BLEND" if kind == GLASS else "OPAQUE",
            metallicFactor=0.0,
        )
        primitive = pyrender.Primitive(
            positions=surface.vertices.astype(np.float32),
            normals=surface.normals.astype(np.float32),
            indices=np.concatenate([surface.faces, surface.faces[:, ::-1]]).astype(np.uint32),
            material=material,
        )
        nodes[drawn.add(pyrender.Mesh([primitive]))] = kind
    # OpenGL counts pixels from their corners and looks along -z with y up.
    lens = pyrender.IntrinsicsCamera(
        camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5, znear=0.05, zfar=20.0
    )
    pose = np.asarray(world_from_camera, dtype=float) @ BLENDER_FROM_OPENCV
    drawn.add(lens, pose=pose)
    drawn.add(pyrender.DirectionalLight(intensity=4.0), pose=pose)
    try:
        renderer = pyrender.OffscreenRenderer(camera.width, camera.height)
    except Exception as error:  # each platform of PyOpenGL raises its own type
        raise RuntimeError(f"{_ADVICE} ({type(error).__name__}: {error})") from error
    try:
        color, _ = renderer.render(drawn)
        # A picture is multisampled: its depth is that of a sample beside the pixel's centre. The
        # pass that draws segments is not. It leaves faces out that look away, hence both windings.
        _, depth = renderer.render(drawn, pyrender.RenderFlags.SEG, nodes)
    finally:
        renderer.delete()
    return np.asarray(color[..., :3], dtype=np.uint8), np.asarray(depth, dtype=np.float32)
