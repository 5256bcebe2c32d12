"""Recorded states: there and back."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from hadr.handover.poses import check_pose
from hadr.simulation.world.state import WorldState, load_states, save_states


def pose(rng: np.random.Generator) -> np.ndarray:
    result = np.eye(4)
    result[:3, :3] = Rotation.random(random_state=int(rng.integers(1000))).as_matrix()
    result[:3, 3] = rng.normal(size=3)
    return result


@pytest.fixture
def states() -> list[WorldState]:
    rng = np.random.default_rng(4)
    holders = ("hand", "both", "gripper", "nobody")
    return [
        WorldState(
            0.02 * k,
            rng.uniform(-3, 3, 6),
            rng.uniform(0, 0.085),
            pose(rng),
            pose(rng),
            holders[k % 4],
            rng.uniform(0, 20),
            rng.uniform(0, 0.3),
            through_force=rng.uniform(0, 10),
            opened=rng.uniform(0, 1, 5),
        )
        for k in range(400)
    ]


def test_states_come_back_in_single_precision(tmp_path: Path, states: list[WorldState]) -> None:
    path = tmp_path / "a.npz"
    save_states(path, states)
    read = load_states(path)
    assert len(read) == len(states)
    for before, after in zip(states, read, strict=True):
        assert after.holder == before.holder
        for name in WorldState.__dataclass_fields__:
            if name != "holder":
                np.testing.assert_allclose(
                    getattr(after, name), getattr(before, name), rtol=2e-7, atol=4e-7
                )
        check_pose(after.base_from_object)
        check_pose(after.base_from_wrist)
    # 48 numbers of four bytes: random ones do not compress
    assert path.stat().st_size < 400 * 48 * 4 + 5000
    with np.load(path) as file:
        np.savez(path, **{**file, "version": np.array(7)})
    with pytest.raises(ValueError, match="has version 7, expected 2"):
        load_states(path)


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("time", np.zeros(3, np.float32), r"joints must be f4 states 6, got f4 \(400, 6\)"),
        ("joints", np.full((400, 6), "x"), "joints must be f4 states 6, got U1"),
        ("holder", np.full(400, 9, np.uint8), "holder must be below 4"),
        ("luck", np.zeros(1), "has an unknown array, 'luck'"),
    ],
)
def test_what_is_no_file_of_states_is_named(
    tmp_path: Path, states: list[WorldState], name: str, value: npt.NDArray[Any], says: str
) -> None:
    path = tmp_path / "a.npz"
    save_states(path, states)
    with np.load(path) as file:
        np.savez(path, **{**file, name: value})
    with pytest.raises(ValueError, match=rf"a\.npz.*{says}"):
        load_states(path)


def test_what_is_cut_off_or_damaged_is_named(tmp_path: Path, states: list[WorldState]) -> None:
    path = tmp_path / "a.npz"
    save_states(path, states)
    whole = path.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 0xFF
    np.save(tmp_path / "one.npy", np.zeros(3))
    for content in (whole[:99], whole[:-99], flipped, (tmp_path / "one.npy").read_bytes()):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"a\.npz is no \.npz of arrays, or is cut off"):
            load_states(path)
    with pytest.raises(FileNotFoundError):
        load_states(tmp_path / "none.npz")
