"""A scene as Mitsuba 3 wants it: surfaces, materials and lights as one dictionary.

Needs the extra ``hadr[generate]``. Mitsuba is only imported when a function is called, after a
variant was chosen with :func:`hadr.synthesis.rendering.mitsuba_variant.mitsuba`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from hadr.camera import Array
from hadr.synthesis.glass.surfaces import Surface
from hadr.synthesis.hand.mesh import HandMesh
from hadr.synthesis.rendering.refraction import GLASS_INDEX
from hadr.synthesis.scene.contents import Scene, Surroundings
from hadr.synthesis.textures.families import pyramid

#: Surroundings are this many meshes, or more where they have more textures.
MESHES = 24


def _mesh(mi: Any, name: str, surface: Surface, uv: Array | None = None, **properties: Any) -> Any:
    """A Mitsuba mesh of a surface, with a ``bsdf`` and perhaps an ``emitter``."""
    props = mi.Properties()
    for key, value in properties.items():
        props[f"mesh_{key}"] = value
    counts = len(surface.vertices), len(surface.faces)
    has = {"has_vertex_normals": True, "has_vertex_texcoords": uv is not None}
    mesh = mi.Mesh(name, *counts, props=props, **has)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = surface.vertices.astype(np.float32).ravel()
    parameters["vertex_normals"] = surface.normals.astype(np.float32).ravel()
    parameters["faces"] = surface.faces.astype(np.uint32).ravel()
    if uv is not None:
        parameters["vertex_texcoords"] = uv.astype(np.float32).ravel()
    parameters.update()
    return mesh


def _hand(mi: Any, hand: HandMesh) -> Any:
    color = {"type": "mesh_attribute", "name": "vertex_color"}
    matt = {"type": "mesh_attribute", "name": "vertex_roughness"}
    skin = {"type": "principled", "base_color": color, "roughness": matt, "specular": 0.5}
    mesh = _mesh(mi, "hand", hand.surface, bsdf=mi.load_dict(skin))
    mesh.add_attribute("vertex_color", 3, hand.albedo.astype(np.float32).ravel())
    roughness = np.clip(0.62 - 0.42 * hand.gloss, 0.15, 0.9)
    mesh.add_attribute("vertex_roughness", 1, roughness.astype(np.float32))
    return mesh


def _glass(mi: Any, number: int, body: Surface, transmittance: tuple[float, ...]) -> Any:
    # A wall of two millimetres absorbs half of what it does at each of its two surfaces.
    passed = {"type": "rgb", "value": [float(t) ** 0.1 for t in transmittance]}
    glass = {"type": "dielectric", "int_ior": GLASS_INDEX, "ext_ior": 1.0}
    glass = mi.load_dict({**glass, "specular_transmittance": passed})
    return _mesh(mi, f"glass{number}", body, bsdf=glass)


def _matte(mi: Any, linear: npt.NDArray[Any]) -> Any:
    """A matt material with a texture of linear RGB."""
    image = mi.Bitmap(np.ascontiguousarray(linear, dtype=np.float32))
    texture = {"type": "bitmap", "bitmap": image, "raw": True}
    return mi.load_dict({"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": texture}})


def _surroundings(mi: Any, around: Surroundings, eye: Array, pixel: float) -> dict[str, Any]:
    """One mesh per texture and tint; each texture in the level that suits its nearest corner."""
    keys = np.concatenate([around.texture[:, None], around.tint, around.repeat[:, None]], axis=1)
    groups, which = np.unique(keys, axis=0, return_inverse=True)
    shapes: dict[str, Any] = {}
    for number in range(len(groups)):
        faces = around.surface.faces[which.ravel() == number]
        used, renumbered = np.unique(faces, return_inverse=True)
        places, normals = around.surface.vertices[used], around.surface.normals[used]
        part = Surface(places, renumbered.reshape(faces.shape), normals)
        levels = pyramid(int(groups[number, 0]), around.photographs)
        nearest = float(np.linalg.norm(part.vertices - eye, axis=1).min())
        texel = groups[number, 4] / levels[0].shape[0]
        level = int(np.clip(np.floor(np.log2(max(nearest * pixel / texel, 1.0))), 0, 4))
        linear = (levels[level].astype(np.float32) / 255.0) ** 2.2 * groups[number, 1:4]
        matte = _matte(mi, np.minimum(linear, 0.9))
        name = f"surroundings{number}"
        shapes[name] = _mesh(mi, name, part, around.uv[used], bsdf=matte)
    # Mitsuba compiles its kernels anew where the number of meshes differs: fill them up.
    below = eye + np.array([0, 0, -50.0]) + 1e-3 * np.eye(3)
    spare = Surface(below, np.array([[0, 1, 2]]), np.eye(3))
    for number in range(len(groups), MESHES):
        matte, name = _matte(mi, np.full((2, 2, 3), 0.5)), f"spare{number}"
        shapes[name] = _mesh(mi, name, spare, np.zeros((3, 2)), bsdf=matte)
    return shapes


def _lights(mi: Any, scene: Scene) -> dict[str, Any]:
    lights: dict[str, Any] = {}
    transform = mi.ScalarTransform4f
    environment = scene.contents.environment
    if environment is None:
        lights["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": 0.5}}
    else:
        # Mitsuba's y is up, and its azimuth starts elsewhere and runs the other way.
        image = np.roll(environment.image[:, ::-1], environment.image.shape[1] // 4, axis=1)
        lights["sky"] = {
            "type": "envmap",
            "bitmap": mi.Bitmap(np.ascontiguousarray(image, dtype=np.float32)),
            "to_world": transform().rotate([1, 0, 0], 90),
        }
    for number, lamp in enumerate(scene.contents.lamps):
        # A mesh, since the numbers of Mitsuba's own rectangle become part of the kernel.
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        corners = lamp.center + signs @ np.stack([lamp.half_width, lamp.half_height])
        faces = np.array([[0, 1, 2], [0, 2, 3]])
        panel = Surface(corners, faces, np.tile(lamp.normal, (4, 1)))
        radiance = {"type": "rgb", "value": np.asarray(lamp.color).tolist()}
        emitter = mi.load_dict({"type": "area", "radiance": radiance})
        black = mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}})
        name = f"lamp{number}"
        lights[name] = _mesh(mi, name, panel, bsdf=black, emitter=emitter)
    return lights


def mitsuba_sensor(scene: Scene, samples: int, seed: int) -> dict[str, Any]:
    """A scene's camera of square pixels with a box filter, as Mitsuba's dictionary."""
    import mitsuba as mi

    camera = scene.camera
    if abs(camera.fx / camera.fy - 1) > 1e-3:
        raise ValueError(
            f"a path-traced picture needs square pixels, got fx {camera.fx} and fy {camera.fy}"
        )
    pose = scene.world_from_camera @ np.diag([-1.0, -1.0, 1.0, 1.0])
    width, height = camera.width, camera.height
    offset = 0.5 - (camera.cx + 0.5) / width, 0.5 - (camera.cy + 0.5) / height
    lens: dict[str, Any]
    if not scene.aperture:
        lens = {f"principal_point_offset_{axis}": o for axis, o in zip("xy", offset, strict=True)}
        lens["type"] = "perspective"
    elif max(map(abs, offset)) < 1e-6:
        lens = {"aperture_radius": scene.aperture, "focus_distance": scene.focus}
        lens["type"] = "thinlens"
    else:
        raise ValueError(f"a lens needs its principal point in the middle, got {camera}")
    return {
        **lens,
        "fov_axis": "x",
        "fov": float(np.rad2deg(2 * np.arctan(width / (2 * camera.fx)))),
        "near_clip": 0.01,
        "far_clip": 100.0,
        "to_world": mi.ScalarTransform4f(pose.tolist()),
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "pixel_format": "rgb",
            "component_format": "float32",
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "independent", "sample_count": samples, "seed": seed},
    }


def scene_to_mitsuba(scene: Scene) -> dict[str, Any]:
    """A scene for ``mitsuba.load_dict``, without the sensor and the integrator that draw it."""
    import mitsuba as mi

    contents = scene.contents
    result: dict[str, Any] = {"type": "scene"}
    if contents.hand is not None:
        result["hand"] = _hand(mi, contents.hand)
    for number, body in enumerate(contents.glass):
        result[f"glass{number}"] = _glass(mi, number, body, contents.transmittance)
    if contents.surroundings is not None:
        result |= _surroundings(
            mi, contents.surroundings, scene.world_from_camera[:3, 3], 1.0 / scene.camera.fx
        )
    return result | _lights(mi, scene)
