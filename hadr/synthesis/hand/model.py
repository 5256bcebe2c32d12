"""A learned hand model that a user brings, MANO-style, instead of our procedural hand.

Such models (a template, linear-blend weights, blend shapes) come under licences of their own, so
none is inside. The adapter reads their arrays from an ``.npz`` file and poses them by our twenty
joint angles: each of the model's bones takes the direction of ours, its lengths stay its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from hadr.hand import FINGERS, HandShape, Side, forward_kinematics, wrist_frame
from hadr.synthesis.glass.surfaces import Surface
from hadr.synthesis.hand.mesh import SKIN_TONES, HandMesh, vertex_normals
from hadr.synthesis.hand.signed_distance import FOREARM_LENGTH

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

#: MANO's tip vertices.
MANO_TIPS: Mapping[str, int] = {
    "thumb": 744,
    "index": 320,
    "middle": 443,
    "ring": 554,
    "little": 671,
}
#: Number of each finger's first joint in MANO's order; two more follow it.
MANO_FINGERS: Mapping[str, int] = {"index": 1, "middle": 4, "little": 7, "ring": 10, "thumb": 13}
_NEEDED = ("v_template", "f", "weights", "J_regressor", "kintree_table")


@dataclass(frozen=True, eq=False)
class HandModel:
    """A skinned hand with 16 joints in MANO's order.

    Args:
        vertices: The template at rest, the model's own frame, metres, shape (V, 3).
        faces: Counter-clockwise from outside, shape (F, 3); the wrist may be open.
        weights: Linear-blend weights, shape (V, 16).
        joint_regressor: Joints as weighted means of the vertices, shape (16, V).
        shape_directions: Blend shapes of the person, shape (V, 3, B); B may be 0.
        pose_directions: Blend shapes of the pose, shape (V, 3, 135), or all zero.
        parents: Parent of each joint, -1 for the wrist, shape (16,).
        tips: Vertex at each finger's tip.
        side: Which hand it is.
    """

    vertices: Array
    faces: Faces
    weights: Array
    joint_regressor: Array
    shape_directions: Array
    pose_directions: Array
    parents: npt.NDArray[np.int64]
    tips: Mapping[str, int]
    side: Side


def load_hand_model(
    path: str | Path, *, side: Side = "right", tips: Mapping[str, int] = MANO_TIPS
) -> HandModel:
    """Read a MANO-style model.

    Args:
        path: An ``.npz`` file with ``v_template``, ``f``, ``weights``, ``J_regressor`` and
            ``kintree_table``, and perhaps ``shapedirs`` and ``posedirs``, named and shaped as in
            MANO. Its ``hands_mean`` is not used: our angles are absolute.
        side: Which hand the model is.
        tips: Vertex at each finger's tip; MANO's where left out.

    Returns:
        The model.

    Raises:
        ValueError: The file is a pickle, lacks an array, or one has another shape than the rest;
            a tip is no vertex; the side is neither ``right`` nor ``left``.
        OSError: The file cannot be read.
    """
    path = Path(path)
    if side not in ("right", "left"):
        raise ValueError(f"side must be 'right' or 'left', got {side!r}")
    with path.open("rb") as file:
        start = file.read(2)
    if start != b"PK":
        raise ValueError(
            f"{path.name} is no .npz file. A pickle runs code when it is read, so it is refused; "
            "convert one that you trust, once: np.savez('hand.npz', **{k: np.asarray(m[k].todense()"
            " if hasattr(m[k], 'todense') else m[k]) for k in ('v_template', 'f', 'weights', "
            "'J_regressor', 'shapedirs', 'posedirs', 'kintree_table')})"
        )
    with np.load(path, allow_pickle=False) as archive:
        missing = [name for name in _NEEDED if name not in archive.files]
        if missing:
            raise ValueError(f"{path.name} lacks {', '.join(missing)}; it has {archive.files}")
        try:
            arrays = {name: np.asarray(archive[name]) for name in archive.files}
        except ValueError as error:
            raise ValueError(f"{path.name} holds pickled objects, not plain arrays") from error
    vertices = np.asarray(arrays["v_template"], dtype=float)
    count = len(vertices)
    shape_directions = np.asarray(arrays.get("shapedirs", np.zeros((count, 3, 0))), dtype=float)
    pose_directions = np.asarray(arrays.get("posedirs", np.zeros((count, 3, 135))), dtype=float)
    for name, array, wanted in (
        ("v_template", vertices, (count, 3)),
        ("weights", arrays["weights"], (count, 16)),
        ("J_regressor", arrays["J_regressor"], (16, count)),
        ("kintree_table", arrays["kintree_table"], (2, 16)),
        ("shapedirs", shape_directions, (count, 3, shape_directions.shape[-1])),
        ("posedirs", pose_directions, (count, 3, 135)),
    ):
        if array.shape != wanted:
            raise ValueError(f"{name} of {path.name} must be {wanted}, got {array.shape}")
    wrong = {f: v for f, v in tips.items() if not 0 <= v < count}
    if set(tips) != set(FINGERS) or wrong:
        raise ValueError(
            f"tips must name a vertex below {count} for each of {list(FINGERS)}, got {dict(tips)}"
        )
    parents = arrays["kintree_table"][0].astype(np.int64)
    parents[0] = -1
    return HandModel(
        vertices,
        arrays["f"].astype(np.int64),
        np.asarray(arrays["weights"], dtype=float),
        np.asarray(arrays["J_regressor"], dtype=float),
        shape_directions,
        pose_directions,
        parents,
        dict(tips),
        side,
    )


def _keypoints(joints: Array, vertices: Array, tips: Mapping[str, int]) -> Array:
    """The 21 keypoints from the model's 16 joints and its tips, shape (21, 3)."""
    rows = [joints[0]]
    for finger in FINGERS:
        first = MANO_FINGERS[finger]
        rows += [*joints[first : first + 3], vertices[tips[finger]]]
    return np.stack(rows)


def _bone_turns(keypoints: Array, angles: npt.ArrayLike) -> Array:
    """Turn of each of the model's bones from rest to the pose, wrist frame, shape (16, 3, 3).

    At rest a bone's own axes are y along it and z as near as may be to our straight bone's.
    """
    straight, posed = forward_kinematics(np.zeros(20)), forward_kinematics(angles)
    turns = np.tile(np.eye(3), (16, 1, 1))
    for finger, indices in FINGERS.items():
        for j in range(3):
            y = keypoints[indices[j + 1]] - keypoints[indices[j]]
            y = y / np.linalg.norm(y)
            z = straight.frames[1 + indices[j], :3, 2]
            z = z - (z @ y) * y
            z = z / np.linalg.norm(z)
            rest = np.stack([np.cross(y, z), y, z], axis=1)
            turns[MANO_FINGERS[finger] + j] = posed.frames[1 + indices[j], :3, :3] @ rest.T
    return turns


def _wrist_loop(faces: Faces) -> npt.NDArray[np.int64]:
    """Vertices around the open wrist, in order; empty where the surface is closed.

    Raises:
        ValueError: There is more than one hole.
    """
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    known = {(int(a), int(b)) for a, b in edges}
    following = {b: a for a, b in known if (b, a) not in known}
    if not following:
        return np.zeros(0, dtype=np.int64)
    loop = [next(iter(following))]
    while following[loop[-1]] != loop[0]:
        loop.append(following[loop[-1]])
        if len(loop) > len(following):
            break
    if len(loop) != len(following):
        raise ValueError("the model's surface has more holes than the wrist")
    return np.asarray(loop)


def _with_forearm(vertices: Array, faces: Faces, length: float) -> tuple[Array, Faces]:
    """Close the open wrist, behind a forearm of ``length`` along -y where it is positive."""
    loop = _wrist_loop(faces)
    if len(loop) == 0:
        return vertices, faces
    ring = vertices[loop]
    center = ring.mean(0)
    offset = ring - center
    half = np.abs(offset[:, [0, 2]]).max(0)
    round_offset = np.column_stack([offset[:, 0], 0 * offset[:, 0], offset[:, 2]])
    ratio = np.hypot(offset[:, 0] / half[0], offset[:, 2] / half[1])
    round_offset /= np.maximum(ratio, 0.2)[:, None]
    points, triangles, last = [vertices], [faces], loop
    start = len(vertices)
    n = len(loop)
    shares = np.linspace(0, 1, 41)[1:] if length > 0 else np.zeros(0)
    for share in shares:
        wide = 1 + np.array([0.6, 0.0, 0.85]) * min(share * 2.6, 1.0) ** 1.4
        ease = min(share * 12, 1.0)
        section = (1 - ease) * offset + ease * round_offset
        points.append(center + section * wide - [0, share * length, 0])
        here = start + np.arange(n)
        after, here_after = np.roll(last, -1), np.roll(here, -1)
        triangles += [np.stack([last, after, here], 1), np.stack([after, here_after, here], 1)]
        last, start = here, start + n
    points.append(np.concatenate(points)[last].mean(0)[None])
    triangles.append(np.stack([last, np.roll(last, -1), np.full(n, start)], 1))
    return np.concatenate(points), np.concatenate(triangles)


def pose_hand_model(
    model: HandModel,
    angles: npt.ArrayLike,
    shape: HandShape | None = None,
    *,
    tone: npt.ArrayLike = SKIN_TONES[1],
    betas: npt.ArrayLike = (),
    forearm: bool = True,
) -> tuple[HandMesh, Array]:
    """Pose a user's hand model by our joint angles.

    Args:
        model: The model.
        angles: The twenty angles in the order of ``ANGLE_NAMES``, radians, shape (20,).
        shape: Its side and its scale count, the scale as a factor on the model's own size; a
            model of the other side is mirrored. Its lengths are not used: ``betas`` are.
        tone: Linear RGB reflectance of the skin, shape (3,).
        betas: Weights of the model's blend shapes; those left out are 0.
        forearm: An open wrist goes on as a forearm of the usual length; False closes it flat.

    Returns:
        The closed hand in the wrist frame, metres, and its 21 keypoints there, shape (21, 3).
        Bones point as those of :func:`hadr.hand.forward_kinematics`; lengths are the model's.

    Raises:
        ValueError: There are more betas than blend shapes, or the surface has several holes.
    """
    shape = shape or HandShape()
    weights = np.asarray(betas, dtype=float).reshape(-1)
    known = model.shape_directions.shape[2]
    if len(weights) > known:
        raise ValueError(f"the model has {known} blend shapes, got {len(weights)} betas")
    rest = model.vertices + model.shape_directions[:, :, : len(weights)] @ weights
    joints = model.joint_regressor @ rest
    model_from_wrist = wrist_frame(_keypoints(joints, rest, model.tips), model.side)
    axes, origin = model_from_wrist[:3, :3], model_from_wrist[:3, 3]
    mirror = np.array([-1.0 if model.side == "left" else 1.0, 1.0, 1.0])
    rest, joints = (rest - origin) @ axes * mirror, (joints - origin) @ axes * mirror
    turns = _bone_turns(_keypoints(joints, rest, model.tips), angles)

    local = turns.copy()
    for bone in range(1, 16):
        local[bone] = turns[model.parents[bone]].T @ turns[bone]
    # The pose's blend shapes are told in the model's own axes.
    to_model = axes * mirror
    feature = (to_model @ local[1:] @ to_model.T - np.eye(3)).reshape(135)
    bound = rest + (model.pose_directions @ feature) @ to_model
    places = np.zeros((16, 3))
    for bone in range(16):
        parent = model.parents[bone]
        if parent >= 0:
            places[bone] = places[parent] + turns[parent] @ (joints[bone] - joints[parent])
    moved = places - np.einsum("bij,bj->bi", turns, joints)
    posed = np.einsum("vb,bij,vj->vi", model.weights, turns, bound) + model.weights @ moved

    keypoints = _keypoints(places, posed, model.tips) * shape.scale
    faces = model.faces if model.side == "right" else model.faces[:, ::-1]
    vertices, faces = _with_forearm(
        posed * shape.scale, faces, FOREARM_LENGTH * shape.scale if forearm else 0.0
    )
    if shape.side == "left":
        vertices, keypoints = vertices * [-1, 1, 1], keypoints * [-1, 1, 1]
        faces = faces[:, ::-1]
    surface = Surface(vertices, faces, vertex_normals(vertices, faces))
    albedo = np.tile(np.asarray(tone, dtype=float), (len(vertices), 1))
    return HandMesh(surface, albedo, np.full(len(vertices), 0.25)), keypoints
