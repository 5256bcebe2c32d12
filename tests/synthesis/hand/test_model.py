import pickle
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from hadr.hand import (
    FINGERS,
    HandShape,
    forward_kinematics,
    keypoints_from_skeleton,
    wrist_frame,
)
from hadr.synthesis.hand.model import MANO_FINGERS, load_hand_model, pose_hand_model


def tiny_model(motion: np.ndarray | None = None, side: str = "right") -> tuple[dict, dict]:
    """A hand of MANO's form: an octahedron about each joint, a smaller one at each tip, and an
    open prism at the wrist. Joints are the octahedra's middles; blend shape 0 is a growth."""
    shape = HandShape(
        side=side, lengths={f: (0.04, 0.03, 0.02 + 0.001 * i) for i, f in enumerate(FINGERS)}
    )
    angles = np.zeros(20)
    angles[6::4] = 0.2
    joints = forward_kinematics(angles, shape).joints
    ball = trimesh.creation.icosphere(0, 0.004)
    order = {f: MANO_FINGERS[f] for f in FINGERS}
    vertices, faces, bones, tips = [], [], [], {}
    regressor = np.zeros((16, 0))

    def add(points, triangles, bone, joint=None):
        nonlocal regressor
        start = sum(len(v) for v in vertices)
        vertices.append(points)
        faces.append(np.asarray(triangles) + start)
        bones.extend([bone] * len(points))
        columns = np.zeros((16, len(points)))
        if joint is not None:
            columns[joint] = 1 / len(points)
        regressor = np.concatenate([regressor, columns], axis=1)
        return start

    around = np.arange(8) * np.pi / 4
    ring = np.stack([0.03 * np.cos(around), 0 * around, 0.02 * np.sin(around)], axis=1)
    prism = np.concatenate([ring, ring + np.array([0, 0.05, 0]), [[0, 0.05, 0]]])
    i, j = np.arange(8), (np.arange(8) + 1) % 8
    sides = [np.stack([i, i + 8, j], 1), np.stack([j, i + 8, j + 8], 1)]
    add(prism, np.concatenate([*sides, np.stack([i + 8, np.full(8, 16), j + 8], 1)]), 0)
    regressor[0, :8] = 1 / 8
    for finger, indices in FINGERS.items():
        for k in range(3):
            bone = order[finger] + k
            add(joints[1 + indices[k]] + ball.vertices, ball.faces, bone, bone)
        tips[finger] = add(
            joints[1 + indices[3]] + 0.0 * ball.vertices, ball.faces, order[finger] + 2
        )
    vertices = np.concatenate(vertices)
    faces = np.concatenate(faces)
    motion = np.eye(4) if motion is None else motion
    table = np.zeros((2, 16), dtype=np.uint32)
    table[1] = np.arange(16)
    for first in order.values():
        table[0, first : first + 3] = (0, first, first + 1)
    table[0, 0] = np.iinfo(np.uint32).max
    weights = np.zeros((len(vertices), 16))
    weights[np.arange(len(vertices)), bones] = 1
    return {
        "v_template": vertices @ motion[:3, :3].T + motion[:3, 3],
        "f": faces.astype(np.uint32),
        "weights": weights,
        "J_regressor": regressor,
        "kintree_table": table,
    }, tips


def loaded(tmp_path, side="right", motion=None, **more):
    arrays, tips = tiny_model(motion, side)
    np.savez(tmp_path / "model.npz", **{**arrays, **more})
    return load_hand_model(tmp_path / "model.npz", side=side, tips=tips)


def grip() -> np.ndarray:
    angles = np.zeros(20)
    angles[:4] = 0.2, 0.4, 0.3, 0.5
    angles[4::4], angles[5::4], angles[6::4], angles[7::4] = 0.1, 0.9, 1.2, 0.4
    return angles


def directions(keypoints: np.ndarray) -> np.ndarray:
    bones = np.array(
        [keypoints[b] - keypoints[a] for f in FINGERS.values() for a, b in pairwise(f)]
    )
    return bones / np.linalg.norm(bones, axis=1, keepdims=True)


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("model_side", ["right", "left"])
def test_bones_point_as_ours_and_keep_the_models_lengths(tmp_path, side, model_side):
    model = loaded(tmp_path, model_side)
    mesh, keypoints = pose_hand_model(model, grip(), HandShape(side=side, scale=0.9))
    ours = forward_kinematics(grip(), HandShape(side=side))
    np.testing.assert_allclose(
        directions(keypoints), directions(keypoints_from_skeleton(ours.joints)), atol=1e-9
    )
    for i, (_, a, b, tip) in enumerate(FINGERS.values()):
        assert np.linalg.norm(keypoints[b] - keypoints[a]) == pytest.approx(0.9 * 0.03)
        assert np.linalg.norm(keypoints[tip] - keypoints[b]) == pytest.approx(
            0.9 * (0.02 + 0.001 * i)
        )
    np.testing.assert_allclose(keypoints[0], 0, atol=1e-12)
    np.testing.assert_allclose(wrist_frame(keypoints, side), np.eye(4), atol=1e-9)
    assert mesh.surface.vertices.shape == mesh.albedo.shape == mesh.surface.normals.shape


def test_the_models_own_frame_does_not_matter(tmp_path):
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    motion[:3, 3] = 0.3, -0.2, 0.1
    first, second = (loaded(tmp_path, motion=m) for m in (None, motion))
    (a, b), (c, d) = (pose_hand_model(m, grip()) for m in (first, second))
    np.testing.assert_allclose(b, d, atol=1e-12)
    np.testing.assert_allclose(a.surface.vertices, c.surface.vertices, atol=1e-12)


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("model_side", ["right", "left"])
def test_the_open_wrist_goes_on_as_a_forearm_or_is_closed_flat(tmp_path, side, model_side):
    model = loaded(tmp_path, model_side)
    for forearm, end in ((True, -0.75), (False, 0.0)):
        mesh, _ = pose_hand_model(model, np.zeros(20), HandShape(side), forearm=forearm)
        solid = trimesh.Trimesh(mesh.surface.vertices, mesh.surface.faces, process=False)
        assert solid.is_watertight
        assert solid.volume > 0
        assert solid.vertices[:, 1].min() == pytest.approx(end, abs=1e-9)


def test_blend_shapes_of_person_and_pose_are_added(tmp_path):
    arrays, _ = tiny_model()
    growth = arrays["v_template"][:, :, None] * [1.0, 0.0]
    lift = np.zeros((len(growth), 3, 135))
    # The angles' cosine minus 1 of the index's first joint about x: entry (1, 1) of its turn.
    lift[arrays["weights"][:, 0] > 0, 2, 4] = 0.01
    model = loaded(tmp_path, shapedirs=growth, posedirs=lift)
    plain, big = (pose_hand_model(model, np.zeros(20), betas=b)[1] for b in ((), (0.1,)))
    np.testing.assert_allclose(big, 1.1 * plain, atol=1e-12)
    angles = np.zeros(20)
    flat = pose_hand_model(model, angles, forearm=False)[0].surface.vertices[:17, 2]
    angles[5] = np.pi / 3
    bent = pose_hand_model(model, angles, forearm=False)[0].surface.vertices[:17, 2]
    np.testing.assert_allclose(bent - flat, 0.01 * (np.cos(np.pi / 3) - 1), atol=1e-4)
    with pytest.raises(ValueError, match="has 2 blend shapes, got 3 betas"):
        pose_hand_model(model, angles, betas=(1, 2, 3))


def test_pickles_and_broken_files_are_refused(tmp_path):
    arrays, tips = tiny_model()
    with (tmp_path / "hand.pkl").open("wb") as file:
        pickle.dump(arrays, file)
    with pytest.raises(
        ValueError, match=r"hand.pkl is no .npz file. A pickle runs code .*np.savez"
    ):
        load_hand_model(tmp_path / "hand.pkl")
    np.savez(tmp_path / "few.npz", v_template=arrays["v_template"], f=arrays["f"])
    with pytest.raises(ValueError, match=r"few.npz lacks weights, J_regressor, kintree_table"):
        load_hand_model(tmp_path / "few.npz")
    np.savez(tmp_path / "odd.npz", **{**arrays, "weights": arrays["weights"][:, :12]})
    with pytest.raises(ValueError, match=r"weights of odd.npz must be \(\d+, 16\), got \(\d+, 12"):
        load_hand_model(tmp_path / "odd.npz", tips=tips)
    np.savez(tmp_path / "objects.npz", **{**arrays, "weights": np.array([{}, None])})
    with pytest.raises(ValueError, match=r"objects\.npz holds pickled objects"):
        load_hand_model(tmp_path / "objects.npz")
    np.savez(tmp_path / "good.npz", **arrays)
    with pytest.raises(ValueError, match=r"tips must name a vertex below \d+"):
        load_hand_model(tmp_path / "good.npz", tips={**tips, "ring": 10_000})
    with pytest.raises(ValueError, match="side must be 'right' or 'left', got 'both'"):
        load_hand_model(tmp_path / "good.npz", side="both")
