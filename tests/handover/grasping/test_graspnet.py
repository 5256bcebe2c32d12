"""Arrays of graspnetAPI: read from file and memory, brought into the base frame, filtered."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hadr.handover.grasping.candidates import NoCandidateError
from hadr.handover.grasping.graspnet import DetectedGrasps, from_graspnet
from hadr.handover.grasping.selection import GraspSelection
from hadr.handover.poses import check_pose
from hadr.handover.simulated_ur5 import SimulatedUR5
from hadr.simulation.trials.rehearsal import REHEARSAL_CAMERA, rehearsed_scene, visible_points

TOO_WIDE = pytest.mark.filterwarnings("ignore:.* need more than 0.085 m")
# the camera stands 1 m before the base and 0.5 m above it, level, and looks back at it
BASE_FROM_CAMERA = np.array([[0, 0, -1, 1.0], [1, 0, 0, 0], [0, -1, 0, 0.5], [0, 0, 0, 1]])


def rows() -> np.ndarray:
    """Three grasps as `GraspGroup.save_npy` writes them: float64, object id -1."""
    identity = [1, 0, 0, 0, 1, 0, 0, 0, 1]
    turned = [0, -1, 0, 1, 0, 0, 0, 0, 1]  # approach along camera y, closing along -x
    return np.array(
        [
            [0.30, 0.060, 0.02, 0.02, *identity, 0.0, 0.0, 0.5, -1],
            [0.90, 0.040, 0.02, 0.04, *turned, 0.1, -0.2, 0.6, -1],
            [0.95, 0.098, 0.02, 0.01, *identity, 0.0, 0.0, 0.5, -1],
        ]
    )


def test_array_is_read_sorted_and_without_what_is_too_wide() -> None:
    with pytest.warns(UserWarning, match="1 of 3 grasps are left out: they need more than 0.085 m"):
        grasps = from_graspnet(rows())
    np.testing.assert_array_equal(grasps.scores, [0.90, 0.30])
    np.testing.assert_array_equal(grasps.object_ids, [-1, -1])
    assert grasps.frame == "camera"


@TOO_WIDE
def test_camera_frame_becomes_base_frame_by_hand() -> None:
    best = from_graspnet(rows(), BASE_FROM_CAMERA)
    assert best.frame == "base"
    # camera (0.1, -0.2, 0.6): base x = 1 - 0.6, y = 0.1, z = 0.5 + 0.2
    np.testing.assert_allclose(best.translations[0], [0.4, 0.1, 0.7], atol=1e-12)
    np.testing.assert_allclose(best.axis("approach")[0], [0, 0, -1], atol=1e-12)  # camera y
    np.testing.assert_allclose(best.axis("closing")[0], [0, -1, 0], atol=1e-12)  # camera -x
    np.testing.assert_allclose(best.poses[0, :3, 2], [0, 0, -1], atol=1e-12)


@TOO_WIDE
@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_file_of_graspnet_api(tmp_path: Path, kind: type) -> None:
    np.save(tmp_path / "grasps.npy", rows().astype(kind))
    np.testing.assert_allclose(
        from_graspnet(tmp_path / "grasps.npy").to_rows(), from_graspnet(rows()).to_rows(), atol=1e-7
    )
    assert len(from_graspnet(str(tmp_path / "grasps.npy"))) == 2


def test_rotations_of_few_digits_become_proper_ones() -> None:
    found = rows()[:1]
    turn = Rotation.from_rotvec([0.3, -1.1, 0.5]).as_matrix()
    found[0, 4:13] = turn.round(5).ravel()
    (pose,) = from_graspnet(found).poses
    check_pose(pose)
    np.testing.assert_allclose(pose[:3, 2], turn[:, 0], atol=1e-5)


@TOO_WIDE
def test_rows_without_object_id() -> None:
    np.testing.assert_array_equal(
        from_graspnet(rows()[:, :16]).to_rows(), from_graspnet(rows()).to_rows()
    )


def test_bad_sources_are_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        from_graspnet(tmp_path / "none.npy")
    (tmp_path / "text.npy").write_text("score, width")
    with pytest.raises(ValueError, match=r"text\.npy is not an array"):
        from_graspnet(tmp_path / "text.npy")
    np.savez(tmp_path / "some.npz", grasps=rows())
    with pytest.raises(ValueError, match=r"some\.npz is not an array .* an archive"):
        from_graspnet(tmp_path / "some.npz")
    (tmp_path / "broken.npy").write_bytes((tmp_path / "some.npz").read_bytes()[:200])
    with pytest.raises(ValueError, match=r"broken\.npy is not an array"):
        from_graspnet(tmp_path / "broken.npy")
    with pytest.raises(ValueError, match="is not an array"):
        from_graspnet(tmp_path)


@pytest.mark.parametrize("shape", [(0,), (0, 16), (0, 17)])
def test_no_grasps_are_no_error(shape: tuple[int, ...], tmp_path: Path) -> None:
    assert len(from_graspnet(np.zeros(shape), BASE_FROM_CAMERA)) == 0
    np.save(tmp_path / "none.npy", np.zeros(shape))
    assert len(from_graspnet(tmp_path / "none.npy")) == 0


def test_an_opening_in_single_precision_still_fits() -> None:
    """float32(0.085) is more than 0.085: all of a gripper's widest grasps would go."""
    widest = rows()
    widest[:, 1] = np.float32(0.085)
    assert (widest[:, 1] > 0.085).all()
    grasps = from_graspnet(widest.astype(np.float32))
    assert len(grasps) == 3
    assert grasps.widths.max() <= 0.085  # what `set_gripper` takes


@pytest.mark.filterwarnings("ignore:.* left out")
@pytest.mark.parametrize(("found", "fit"), [(np.zeros((0, 17)), 0), (rows(), 2)])
def test_a_detector_whose_grasps_all_go_says_why(found: np.ndarray, fit: int) -> None:
    source = DetectedGrasps(lambda points: found, BASE_FROM_CAMERA)
    says = rf"detector's {len(found)} grasps {fit} fit the gripper, .* within 0\.03 m"
    with pytest.raises(NoCandidateError, match=says):
        source(np.eye(3) + 5.0)


def test_a_bad_calibration_is_named() -> None:
    mirror, says = np.diag([1.0, 1, -1, 1]), "base_from_camera must hold a proper rotation"
    with pytest.raises(ValueError, match=says):
        from_graspnet(rows(), mirror)
    with pytest.raises(ValueError, match=says):
        DetectedGrasps(lambda points: rows(), mirror)


@TOO_WIDE
def test_millimetres_are_told_from_metres() -> None:
    wide = rows()
    wide[1, 1] = 40.0
    with pytest.raises(ValueError, match=r"grasp 1: width must be in metres.* 40 looks like mill"):
        from_graspnet(wide)
    wide[1, 1] = 0.4  # wider than the gripper, but a width
    assert len(from_graspnet(wide)) == 1


@TOO_WIDE
@pytest.mark.parametrize(
    ("score", "fits"), [(90.0, False), (-2.0, False), (2.4, True), (-0.1, True)]
)
def test_scores_of_another_scale_are_refused(score: float, fits: bool) -> None:
    """A network trained on ln(u_max / u) gives up to 2.5; percent would outweigh all else."""
    scored = rows()
    scored[1, 0] = score
    if fits:
        assert score in from_graspnet(scored).scores
        return
    with pytest.raises(ValueError, match=rf"grasp 1: score must lie in -1\.\.3, got {score:g}"):
        from_graspnet(scored)


@pytest.mark.parametrize("source", [rows().astype(complex), rows().astype(str), None, object()])
def test_what_is_no_real_number_is_refused(source: object) -> None:
    with pytest.raises(ValueError, match=r"rows must be real numbers, got .*(128|U32|None|obj)"):
        from_graspnet(source)  # type: ignore[arg-type]


def test_detector_in_the_sampler_s_place() -> None:
    scene = rehearsed_scene()
    base_from_camera = REHEARSAL_CAMERA
    points = visible_points(scene, base_from_camera[:3, 3])
    sampled = GraspSelection(np.random.default_rng(0), base_from_camera[:3, 3]).candidates(points)
    asked = []

    def detect(camera_points: np.ndarray) -> np.ndarray:
        """A detector that finds good grasps, and better ones on another thing half a metre away."""
        asked.append(camera_points)
        own = sampled.in_frame(np.linalg.inv(base_from_camera), "camera").to_rows()
        other = own.copy()
        other[:, 0] += 1.5
        other[:, 13] += 0.5
        return np.concatenate([other, own])

    source = DetectedGrasps(detect, base_from_camera)
    n = len(sampled)
    with pytest.warns(UserWarning, match=rf"^{n} of {2 * n} grasps are left out: .* the object"):
        found = source(points)
    assert len(found) == n
    np.testing.assert_allclose(found.translations, sampled.translations, atol=1e-9)
    assert found.frame == "base"
    # the detector was asked in the camera frame, where the glass is in front of the camera
    assert asked[0][:, 2].min() > 0.3
    choose = GraspSelection(np.random.default_rng(1), base_from_camera[:3, 3], source=source)
    with pytest.warns(UserWarning, match="left out"):
        chosen = choose(points, scene.keypoints, SimulatedUR5())
    assert chosen is not None
    nearest = np.abs(found.poses[:, :3, 3] - chosen.pose[:3, 3]).max(axis=1).min()
    assert nearest < 1e-9
