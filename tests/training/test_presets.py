from __future__ import annotations

import json

import pytest

from hadr.provenance import plain
from hadr.training.presets import preset


def test_paper_preset_has_the_papers_figures() -> None:
    paper = preset("paper")
    assert paper.size == (224, 224)
    assert (paper.epochs, paper.batch_size) == (100, 40)
    assert [paper.rate(epoch) for epoch in (0, 79, 80, 99)] == pytest.approx(
        [1e-3, 1e-3, 1e-4, 1e-4]
    )
    weights = paper.weights
    assert (weights.depth, weights.probability, weights.normals) == (200, 10, 0.5)
    swin = paper.model.backbone
    assert (swin.embed_dim, swin.depths, swin.heads) == (96, (2, 2, 6, 2), (3, 6, 12, 24))
    assert (swin.window, swin.drop_path) == (7, 0.2)
    assert sum(paper.model.parts) == 511
    assert paper.model.grid.cells == 8
    assert paper.model.max_points == 10_000
    assert paper.true_voxel_epochs == 6


@pytest.mark.parametrize("name", ["tiny", "mini", "paper"])
def test_presets_are_known_by_their_names_and_fit_into_json(name: str) -> None:
    recipe = preset(name)
    assert recipe.name == name
    assert recipe.drop_epoch < recipe.epochs
    assert json.loads(json.dumps(plain(recipe.to_dict())))["model"]["hand"] == "3d"


def test_an_unknown_preset_names_the_known_ones() -> None:
    with pytest.raises(ValueError, match="one of tiny, mini, paper, got 'huge'"):
        preset("huge")
