"""Path-traced pictures: a scene's light by Mitsuba 3, denoised, and taken by a camera.

Needs the extra ``hadr[generate]``.
"""

from __future__ import annotations

import importlib
from contextlib import AbstractContextManager, nullcontext
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from hadr.camera import pixel_grid
from hadr.records.processes import one_thread
from hadr.synthesis.rendering.color_camera import ColorCamera, develop
from hadr.synthesis.rendering.mitsuba_scene import mitsuba_sensor, scene_to_mitsuba
from hadr.synthesis.rendering.mitsuba_variant import LLVM, mitsuba
from hadr.synthesis.rendering.raycast import rays_through
from hadr.synthesis.rendering.shading import RayTracer
from hadr.synthesis.scene.contents import Scene

#: Most surfaces on a path.
_SURFACES = 14

Light = npt.NDArray[np.float32]


def trace(
    scene: Scene, *, seed: int, samples: int = 8, variant: str | None = None
) -> tuple[Light, Light, Light]:
    """The light that reaches the camera, with the noise of few samples (paths a pixel).

    Drawn by a variant of Mitsuba, the fastest that works where none is named; ``seed`` is that of
    the paths. Linear RGB, and as guides for a denoiser the reflectance and the normals of what is
    seen first; each (H, W, 3) float32.

    Raises:
        ValueError: The number of samples is not positive, or the variant can't be used here.
    """
    if samples < 1:
        raise ValueError(f"samples must be at least 1 path a pixel, got {samples}")
    mi = mitsuba(variant)
    with _one_order(mi):
        description = scene_to_mitsuba(scene)
        description["sensor"] = mitsuba_sensor(scene, samples, seed)
        loaded = mi.load_dict(description)
        _any_lens(mi, loaded)
        paths = mi.load_dict({"type": "path", "max_depth": _SURFACES, "rr_depth": 3})
        # One integrator for both would trace every path twice.
        first = mi.load_dict({"type": "aov", "aovs": "albedo:albedo,normal:sh_normal"})

        def draw(integrator: Any) -> Light:
            picture = mi.render(loaded, integrator=integrator, spp=samples, seed=seed)
            return np.nan_to_num(np.asarray(picture, dtype=np.float32), posinf=0.0, neginf=0.0)

        light, guides = draw(paths), draw(first)
    albedo, normal = np.clip(guides[..., -6:-3], 0, 1), guides[..., -3:]
    _look_through_glass(scene, albedo)
    return light[..., :3], albedo, normal


def _any_lens(mi: Any, loaded: Any) -> None:
    """Hand the lens over as data: its numbers would compile the kernels anew for each picture."""
    if mi.variant() != LLVM:
        return
    drjit = importlib.import_module("drjit")
    lens = mi.traverse(loaded.sensors()[0])
    for name in {"aperture_radius", "focus_distance"} & set(lens.keys()):
        lens[name] = drjit.opaque(mi.Float, float(lens[name][0]))
    lens.update()


def _one_order(mi: Any) -> AbstractContextManager[None]:
    """LLVM's kernels on one thread: sums have one order, so the same seed gives the same bytes."""
    if mi.variant() != LLVM:
        return nullcontext()
    drjit = importlib.import_module("drjit")
    return one_thread(drjit.thread_count, drjit.set_thread_count)


def _look_through_glass(scene: Scene, albedo: Light) -> None:
    """Put the reflectance of what is behind glass into its pixels, from four rays each."""
    camera, pose = scene.camera, scene.world_from_camera
    tracer = RayTracer(scene.contents)
    glass = tracer.glass_alone(*rays_through(pixel_grid(camera), camera, pose))
    wide = cv2.dilate(glass.reshape(camera.shape).astype(np.uint8), np.ones((3, 3), np.uint8))
    v, u = np.nonzero(wide)
    if not len(v):
        return
    total = np.zeros((len(v), 3))
    for du, dv in ((-0.3, -0.1), (0.1, -0.3), (0.3, 0.1), (-0.1, 0.3)):
        rays = rays_through(np.stack([u + du, v + dv], axis=1), camera, pose)
        total += tracer.reflectance(*rays, 1.0 / camera.fx + scene.aperture / scene.focus)
    albedo[v, u] = total / 4


def denoise(light: Light, albedo: Light, normal: Light) -> Light:
    """Take the noise of few samples away with Open Image Denoise; all pictures are (H, W, 3)."""
    oidn = importlib.import_module("pyoidn")
    clean = np.zeros(light.shape, dtype=np.float32)
    images = {"color": light, "albedo": np.clip(albedo, 0, 1), "normal": normal, "output": clean}
    kept = {name: np.ascontiguousarray(image, dtype=np.float32) for name, image in images.items()}
    device = _denoising_device()
    with oidn.Filter(device, "RT") as task:
        for name, image in kept.items():
            task.set_image(name, image, oidn.OIDN_FORMAT_FLOAT3)
        task.set_bool("hdr", True)
        task.commit()
        task.execute()
    error = device.get_error()
    if error is not None:
        raise RuntimeError(f"Open Image Denoise failed: {error}")
    return kept["output"]


@lru_cache(maxsize=1)
def _denoising_device() -> Any:
    """Open Image Denoise on one thread that stays where it likes, as other processes' ones do."""
    device = importlib.import_module("pyoidn").Device()
    device.set_int("numThreads", 1)
    device.set_bool("setAffinity", False)
    device.commit()
    return device


def photograph(
    scene: Scene, *, seed: int, samples: int = 8, variant: str | None = None
) -> npt.NDArray[np.uint8]:
    """Take a path-traced picture of a scene, sRGB, (H, W, 3) uint8; :func:`trace` has the options.

    The same seed (of the paths and of the camera's noise) gives the same bytes.
    """
    seed = int(np.random.SeedSequence(seed).generate_state(1)[0])
    light = denoise(*trace(scene, seed=seed, samples=samples, variant=variant))
    return develop(light, np.random.default_rng(seed), ColorCamera())
