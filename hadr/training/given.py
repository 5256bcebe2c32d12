"""What a network is given besides colour: the options of the commands that read frames."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from hadr.corruption import Corruption
from hadr.records.option_words import FILE, LARGEST_SEED, check_range

TRUE = "true"


@dataclass(frozen=True)
class Given:
    """What a network is given besides colour: depth, masks and keypoints."""

    corruption: Corruption = "oracle"
    """Of the depth. oracle: none in the object's mask; analytic: a stereo camera imitated by
    formulas; sensor: the frames' raw depth; erased: the same but none in the mask."""
    masks: Annotated[str, FILE] = TRUE
    """'true', or a segmentation checkpoint whose predictions are given."""
    keypoints: Annotated[str, FILE] = TRUE
    """'true', or a hand-keypoints checkpoint whose predictions are given."""
    seed: int = 0
    """Seed of everything that is drawn by chance."""

    def check(self) -> None:
        """Check the seed, and load the checkpoints that are named, before frames are read.

        Raises:
            FileNotFoundError: A checkpoint does not exist.
            ValueError: A checkpoint is damaged or one of another network; or the seed is negative.
        """
        check_range("seed", self.seed, 0, LARGEST_SEED)
        for path, kind in ((self.masks, "segmentation"), (self.keypoints, "hand-keypoints")):
            if path != TRUE:
                load_given(path, kind)

    def check_network(self, network: str) -> None:
        """Refuse predictions for a network to which they would not be given.

        Raises:
            ValueError: The network restores no depth, and something is predicted.
        """
        predicted = self.masks != TRUE or self.keypoints != TRUE
        if predicted and network in ("segmentation", "hand-keypoints"):
            raise ValueError(
                f"--masks and --keypoints are for networks that restore depth, got {network}"
            )

    def record(self) -> dict[str, str]:
        """The same for a training's record: files by their names."""
        return {
            "corruption": self.corruption,
            "masks": Path(self.masks).name,
            "keypoints": Path(self.keypoints).name,
        }


def load_given(path: str | Path, kind: str) -> tuple[Any, tuple[int, int]]:
    """Load a network, and give the (width, height) at which it was trained."""
    from hadr.training.checkpoints import load_checkpoint

    model, meta = load_checkpoint(path)
    if meta["network"] != kind:
        raise ValueError(f"{path} holds a network of kind {meta['network']!r}, expected {kind!r}")
    return model.eval(), (int(meta["width"]), int(meta["height"]))
