"""What is left of the accuracy when masks, keypoints and depth are no longer the true ones.

    python benchmarks/whole_chain.py --data DIR data_samples/frames --json results/mini/chain.json

DIR is what `hadr generate --preset mini` has made. The bundled networks restore the test frames of
the known objects, given: everything true; a predicted mask; predicted keypoints; both; and both
with the depth of the simulated sensor, as a robot would have it. All is scored on the true mask's
pixels as in the tables. Nothing is trained, chosen or tuned here.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from hadr.data.samples import samples_dir
from hadr.experiments.averages import standard_error
from hadr.experiments.conditions import hand_median
from hadr.experiments.scoring import EVALUATION_SIZE, score_network
from hadr.experiments.splits import data_digest, open_part
from hadr.provenance import machine_text, provenance
from hadr.result_file import digest, write_result_file
from hadr.training.batches import FrameTensors, load_frames
from hadr.training.checkpoints import load_checkpoint
from hadr.training.predicted import Given, with_predicted

CHECKPOINTS = {"hadr": "hadr-mini", "hadr-plus": "hadr-plus-mini"}
FOLDER = samples_dir() / "checkpoints"
MASKS, HANDS = FOLDER / "segmentation-mini.safetensors", FOLDER / "hand-keypoints-mini.safetensors"
GIVEN = {
    "all true": Given(),
    "predicted mask": Given(masks=MASKS),
    "predicted keypoints": Given(keypoints=HANDS),
    "both predicted": Given(masks=MASKS, keypoints=HANDS),
    "both predicted, sensor's depth": Given("sensor", MASKS, HANDS),
}


def read(source: Any, size: tuple[int, int], given: Given) -> FrameTensors:
    """Read the frames; depth within the mask is erased, as `hadr restore` does."""
    frames = load_frames(source, size, given.corruption, keep_all=True)
    frames = with_predicted(frames, source, given)
    depth = torch.where(frames.inputs.mask, 0.0, frames.inputs.depth)
    return replace(frames, inputs=replace(frames.inputs, depth=depth))


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, nargs="+", required=True)
    parser.add_argument("--json", type=Path, required=True)
    args = parser.parse_args()
    source = open_part(args.data, "known", "test")
    networks = {
        method: load_checkpoint(FOLDER / f"{name}.safetensors")
        for method, name in CHECKPOINTS.items()
    }
    rows = []
    for name, given in GIVEN.items():
        truth = read(source, EVALUATION_SIZE, given)
        scores = {"hand-median": hand_median(truth)}
        for method, (model, meta) in networks.items():
            frames = read(source, (int(meta["width"]), int(meta["height"])), given)
            scores[method] = score_network(model.eval(), frames, truth)
        found, true = truth.inputs.mask, truth.object_mask
        overlap = (found & true).sum((1, 2)) / (found | true).sum((1, 2)).clamp(min=1)
        seen = (truth.inputs.keypoints != 0).flatten(1).any(dim=1)
        apart = (truth.inputs.keypoints - truth.true_keypoints).norm(dim=-1)[seen]
        for method, one in scores.items():
            errors = [m.rmse_m for m in one.frames]
            rows.append({
                "method": method,
                "given": name,
                **given.record(),
                **one.columns(),
                "rmse_standard_error_m": standard_error(errors, range(len(errors))),
                "mask_iou": float(overlap.mean()),
                "keypoints_m": float(apart.mean()),
                "hands_found": int(seen.sum()),
            })  # fmt: skip
            print(f"{name:32s} {method:12s} {rows[-1]['rmse_m']:.4f} m", flush=True)
    write_result_file(
        args.json,
        "Depth restored by the bundled networks on the known objects' test frames, given true or "
        "predicted masks and keypoints; scored on the true mask's pixels at "
        f"{EVALUATION_SIZE[0]}x{EVALUATION_SIZE[1]}, means over the frames; a pixel that is not "
        "restored takes the depth of the restored ones around it",
        rows,
        {
            **provenance(),
            "machine": machine_text(),
            "data": {"sha256": digest([data_digest(root) for root in args.data])},
        },
    )


if __name__ == "__main__":
    main()
