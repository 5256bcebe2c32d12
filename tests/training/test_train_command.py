from __future__ import annotations

from argparse import ArgumentParser, Namespace

import pytest

from hadr.models.hadr import HADRConfig
from hadr.training.losses import CODED
from hadr.training.train_command import add_arguments, recipe_from


def parsed(*words: str) -> Namespace:
    parser = ArgumentParser()
    add_arguments(parser)
    return parser.parse_args(["--out", "out", *words])


def test_arguments_become_a_recipe() -> None:
    ablation = "--hand none --no-aggregation --no-point-fusion --coded-weights"
    recipe = recipe_from(parsed(*f"--preset paper --epochs 50 {ablation}".split()))
    assert (recipe.epochs, recipe.drop_epoch) == (50, 40)
    assert recipe.weights == CODED
    model = recipe.model
    assert isinstance(model, HADRConfig)
    assert (model.hand, model.aggregation, model.point_fusion) == ("none", False, False)


def test_published_weights_are_named_in_the_backbone() -> None:
    model = recipe_from(parsed("--preset", "paper", "--pretrained", "some/swin")).model
    assert isinstance(model, HADRConfig)
    assert model.backbone.pretrained == "some/swin"


def test_epochs_must_be_positive() -> None:
    with pytest.raises(ValueError, match="--epochs must be at least 1, got 0"):
        recipe_from(parsed("--epochs", "0"))
