"""Recorded states: there and back, and files that are none."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hadr.handover.ur5 import check_pose
from hadr.simulation.world.state import WorldState
from hadr.simulation.world.state_record import load_states, save_states


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
        )
        for k in range(400)
    ]


def test_states_come_back_in_single_precision(tmp_path: Path, states: list[WorldState]) -> None:
    path = save_states(tmp_path / "runs" / "a.npz", states)
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
    # 45 numbers of four bytes: random ones do not compress
    assert path.stat().st_size < 400 * 45 * 4 + 5000


def test_writing_refuses_what_is_no_run(tmp_path: Path, states: list[WorldState]) -> None:
    with pytest.raises(ValueError, match="no state to write"):
        save_states(tmp_path / "a.npz", [])
    with pytest.raises(ValueError, match=r"a \.npz file, got 'a\.json'"):
        save_states(tmp_path / "a.json", states)
    with pytest.raises(ValueError, match=r"must not fall, got 0\.02 s and then 0\.0 s"):
        save_states(tmp_path / "a.npz", [states[1], states[0]])
    assert not list(tmp_path.iterdir())


def test_a_broken_file_is_refused(tmp_path: Path, states: list[WorldState]) -> None:
    path = save_states(tmp_path / "a.npz", states)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=r"a\.npz is no readable record"):
        load_states(path)
    spoilt = bytearray(whole)
    spoilt[len(whole) // 2] ^= 0xFF
    path.write_bytes(spoilt)
    with pytest.raises(ValueError, match=r"a\.npz"):
        load_states(path)
    path.write_text("not a record")
    with pytest.raises(ValueError, match=r"a\.npz is no readable record"):
        load_states(path)
    path.write_bytes(b"")
    with pytest.raises(ValueError, match=r"a\.npz is no readable record"):
        load_states(path)
    with pytest.raises(FileNotFoundError):
        load_states(tmp_path / "b.npz")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("joints", np.zeros((400, 7)), r"joints must have shape \(400, 6\), got \(400, 7\)"),
        ("hand_force", np.full(400, np.nan), "hand_force must be finite"),
        ("holder", np.full(400, 9), "holder must be 400 numbers from 0 to 3"),
        ("base_from_object", np.zeros((400, 4, 4)), "base_from_object holds what is no rotation"),
        ("version", np.array(7), "version 7, expected 1"),
        ("time", np.zeros(0), "holds no states"),
        ("joints", None, "lacks joints"),
    ],
)
def test_a_wrong_column_is_named(
    name: str, value: np.ndarray | None, message: str, tmp_path: Path, states: list[WorldState]
) -> None:
    path = save_states(tmp_path / "a.npz", states)
    with np.load(path) as file:
        columns = dict(file)
    columns.pop(name)
    if value is not None:
        columns[name] = value
    np.savez(path, **columns)
    with pytest.raises(ValueError, match=message):
        load_states(path)
