from types import SimpleNamespace

import numpy as np
import pytest
import torch

from hadr.models.signals import (
    FLOOR_M,
    candidate_spread,
    neighbour_spread,
    signals_of,
    within_learned,
)
from hadr.ray_voxels import RayVoxelPairs


def two_rays() -> SimpleNamespace:
    """Ray 0 has two candidates, ray 1 one; the image is 2x3, the rays at (0, 1) and (1, 2)."""
    pairs = RayVoxelPairs(
        ray=torch.tensor([0, 0, 1]),
        voxel=torch.tensor([0, 1, 1]),
        t_in=torch.tensor([0.4, 0.8, 0.8]),
        t_out=torch.tensor([0.6, 1.0, 1.0]),
        n_rays=2,
    )
    depth = torch.zeros(1, 2, 3)
    depth[0, 0, 1], depth[0, 1, 2] = 0.5, 0.85
    confidence = torch.zeros(1, 2, 3)
    confidence[0, 0, 1], confidence[0, 1, 2] = 0.75, 1.0
    return SimpleNamespace(
        depth=depth,
        confidence=confidence,
        restored=depth > 0,
        rays=torch.tensor([[0, 0, 1], [0, 1, 2]]),
        points=torch.tensor([[0.0, 0.0, 0.5], [0.0, 0.0, 0.85]]),
        chosen=torch.tensor([0, 2]),
        pairs=pairs,
        probability=torch.tensor([0.75, 0.25, 1.0]),
        offset=torch.tensor([0.3, -0.001]),
    )


def test_candidate_spread_by_hand() -> None:
    """Answers 0.5 (chosen, p 3/4) and 0.9 (middle, p 1/4): sqrt(3/16) * 0.4 m apart."""
    spread = candidate_spread(two_rays())
    assert spread[0, 0, 1] == pytest.approx(0.4 * np.sqrt(3 / 16), rel=1e-5)
    assert spread[0, 1, 2] == pytest.approx(0, abs=1e-4)


def test_signals_of_hadr() -> None:
    signals = signals_of(two_rays())
    assert set(signals) == {"network", "candidates", "neighbours"}
    assert signals["network"][0, 0, 1] == pytest.approx(np.log(3), rel=1e-5)
    assert signals["network"][0, 1, 2].isfinite(), "a probability of 1 has finite log odds"
    assert signals["candidates"][0, 1, 2] > signals["candidates"][0, 0, 1]
    for values in signals.values():
        assert values.shape == (1, 2, 3)
        assert (values[~two_rays().restored] == 0).all()


def test_a_network_that_says_its_spread_is_taken_at_its_word() -> None:
    output = two_rays()
    other = SimpleNamespace(
        depth=output.depth,
        confidence=output.confidence,
        restored=output.restored,
        spread=torch.full((1, 2, 3), 0.019),
    )
    found = signals_of(other)["candidates"][0, 0, 1]
    assert found == pytest.approx(-np.log(0.019 + FLOOR_M), rel=1e-5)
    del other.spread
    assert set(signals_of(other)) == {"network", "neighbours"}


def test_neighbour_spread_against_numpy() -> None:
    rng = torch.Generator().manual_seed(0)
    depth = 0.6 + 0.05 * torch.rand(2, 20, 40, generator=rng)
    known = torch.rand(2, 20, 40, generator=rng) > 0.4
    found = neighbour_spread(torch.where(known, depth, 0.0), known)
    half = 1  # 40 * 0.055 / 2, rounded
    for frame, row, column in known.nonzero().tolist()[::37]:
        window = (
            frame,
            slice(max(row - half, 0), row + half + 1),
            slice(max(column - half, 0), column + half + 1),
        )
        expected = depth[window][known[window]].std(unbiased=False)
        assert found[frame, row, column] == pytest.approx(float(expected), abs=2e-5)
    assert (found[~known] == 0).all()


def test_a_plane_has_less_spread_than_a_step_and_the_frame_beside_does_not_matter() -> None:
    depth = torch.full((2, 16, 64), 0.6)
    depth[1, :, 32:] = 0.7
    spread = neighbour_spread(depth, torch.ones(2, 16, 64, dtype=torch.bool))
    assert spread[0].max() < 1e-4
    assert spread[1, 8, 32] == pytest.approx(0.05, rel=0.03)  # half of the step, nearly
    assert spread[1, 8, 5] < 1e-4


def test_answers_that_were_never_learned_are_not_restored() -> None:
    output = two_rays()
    assert within_learned(output, None)[output.restored].tolist() == [True, False], "offset < 0"
    output.offset = torch.tensor([0.3, 0.7])
    assert within_learned(output, None)[output.restored].tolist() == [True, True]
    assert within_learned(output, (0.45, 0.8))[output.restored].tolist() == [True, False]
    assert within_learned(output, (0.55, 0.9))[output.restored].tolist() == [False, True]
    assert not within_learned(output, (0.45, 0.9))[~output.restored].any()
