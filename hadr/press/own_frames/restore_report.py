"""What `hadr restore` tells about a result: the comparison picture, counts, errors, provenance."""

import platform
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import scipy
from matplotlib import rc_context, rcdefaults
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from hadr import __version__
from hadr.camera import BoolArray, Intrinsics, project, valid_depth
from hadr.figures import panels
from hadr.hand import BONES
from hadr.metrics import METRICS, frame_metrics
from hadr.models.networks import DEPTH_NETWORKS, NETWORKS
from hadr.press.own_frames.restore_command import Made
from hadr.records.caches import file_sha256
from hadr.restoration import Restoration
from hadr.trained_finders import GIVEN, Hand

OTHER_TRUTH_M = 0.05
"""From here on a truth is not of this frame: outside of the glass a camera measures far better."""
METHOD_TITLES = {
    **{kind: f"{NETWORKS[kind].title} (not HADR)" for kind in DEPTH_NETWORKS},
    "hadr": "HADR",
    "hadr-plus": "HADR-plus",
    "nearest": "nearest valid depth (not HADR)",
    "inpaint": "OpenCV inpainting (not HADR)",
    "hand-median": "the hand's median depth (not HADR)",
    "none": "nothing to restore",
}


def report(made: Made) -> dict[str, Any]:
    """What `report.json` says of what was made."""
    depth, result, truth = made.depth, made.result, made.truth
    given = {name: path for name, path in made.files.items() if path is not None}
    scores = {} if truth is None else errors(depth, result.depth, truth, result.mask)
    notes = list(result.notes)
    if truth is not None and not scores:
        known = int((result.mask & valid_depth(truth)).sum())
        notes.append(
            f"no errors can be stated: the truth is known in {known} of the mask's "
            f"{int(result.mask.sum())} pixels, and no depth was measured or restored in these"
        )
    if truth is not None:
        both = ~result.mask & valid_depth(truth) & valid_depth(depth)
        off = float(np.median(np.abs(truth - depth)[both])) if both.any() else 0.0
        if off > OTHER_TRUTH_M:
            notes.append(
                f"the truth differs from what was measured outside of the mask by {100 * off:.3g} "
                "cm in the median: is it of this frame, in the same unit?"
            )
        both = result.mask & valid_depth(truth) & valid_depth(depth)
        if both.any() and (truth == depth)[both].all():
            notes.append(
                f"the truth is the input depth itself, in all {int(both.sum())} pixels of the mask "
                "in which both are known: where a camera measured it, the errors mean nothing"
            )
        both = result.mask & valid_depth(truth) & valid_depth(result.depth)
        alike = np.abs(truth - result.depth)[both] < 0.001
        if both.any() and alike.mean() > 0.99:
            notes.append(
                f"the truth is what was restored, to 1 mm in {100 * alike.mean():.3g} % of the "
                "pixels: is it the result of an earlier call?"
            )
    return {
        "command": "hadr restore",
        "method": result.method,
        "method_title": METHOD_TITLES[result.method],
        "notes": notes,
        "confidence_means": confidence_means(result),
        "ground": None if result.ground is None else result.ground.to_dict(),
        "image": {"width": made.camera.width, "height": made.camera.height},
        "intrinsics": made.camera.to_dict(),
        "counts": counts(depth, result, truth),
        "hand": None if result.hand is None else told_hand(result.hand),
        "errors_in_mask": scores,
        "inputs": {
            name: {"file": path, "sha256": file_sha256(Path(path))} for name, path in given.items()
        },
        "versions": versions(),
    }


def write_comparison(path: Path, made: Made) -> None:
    """Write what `comparison_figure` draws, whatever a `matplotlibrc` says."""
    with rc_context():
        rcdefaults()
        comparison_figure(made).savefig(path, dpi=130)


def comparison_figure(made: Made) -> Figure:
    """Draw colour, depth before and after, and the error (or, without truth, the confidence).

    On the colour lies the hand that was given or found, dashed and grey if it was not accepted.
    """
    result, truth, target = made.result, made.truth, made.result.mask
    with rc_context():
        panels.use_style()
        height = 0.9 + 9.8 * made.camera.height / made.camera.width
        figure: Figure = Figure(figsize=(11, height), dpi=130)
        (top_left, top_right), (left, right) = figure.subplots(2, 2)
        panels.show_color(top_left, made.color, "colour, and the pixels to restore")
        _show_hand(top_left, made.camera, result)
        there = valid_depth(result.depth)
        inside = there & target
        shown = result.depth[inside if inside.any() else there]
        low, high = (float(x) for x in np.percentile(shown, (1, 99)))
        if inside.any():  # the object's depths shall be told apart, not those of a wall far behind
            low, high = low - 0.1, high + 0.3
        for ax, image, title in (
            (left, made.depth, "depth as measured"),
            (right, result.depth, "depth restored"),
        ):
            panels.show_depth(ax, image, title, vmin=low, vmax=high, colorbar=ax is right)
        if truth is not None and (inside & valid_depth(truth)).any():
            _show_error(top_right, result, truth)
        else:
            _show_confidence(top_right, result)
            figure.supxlabel(f"in the outline: {confidence_means(result)}", fontsize=11)
        if target.any():
            for ax in (top_left, top_right, left, right):
                ax.contour(target, [0.5], colors=[panels.COLORS["hand"]], linewidths=0.9, zorder=3)
        title = f"hadr restore: {METHOD_TITLES[result.method]}"
        if result.ground is not None and result.ground.inside is False:
            title += "; the frame is unlike those it learned from"
        figure.suptitle(title, fontsize=14, fontweight="bold")
    return figure


def _show_error(ax: Axes, result: Restoration, truth: NDArray[np.floating]) -> None:
    """Draw restored minus true depth in the mask."""
    known = result.mask & valid_depth(result.depth)
    error = np.where(known & valid_depth(truth), result.depth - truth, np.nan)
    largest = float(np.nanpercentile(np.abs(error), 75))
    limit = next((x for x in (0.02, 0.05, 0.1, 0.2) if largest <= x), 0.5)
    image = panels.show_error(ax, error, "restored minus true depth", limit=limit)
    image.set(cmap=panels.ERROR_MAP, zorder=2)  # clear where there is no error to show
    _mark(ax, "outside the mask", ~result.mask, "white")
    _mark(ax, "the truth is not known", known & ~valid_depth(truth), "white", "////")
    _mark(ax, "no depth", result.mask & ~known, panels.MISSING)


def _show_confidence(ax: Axes, result: Restoration) -> None:
    """Draw the confidence, and where there is none."""
    there = valid_depth(result.depth)
    said = bool(result.confidence[result.restored].any())
    unsaid = result.restored & (not said)
    shades = np.ma.masked_where(~there | unsaid, result.confidence)
    image = ax.imshow(shades, cmap="plasma", vmin=0, vmax=1, zorder=2)
    panels.bare_axes(ax, "confidence" if said else "confidence: none where restored")
    ax.figure.colorbar(image, ax=ax, shrink=0.75, pad=0.02, label="confidence (1 = measured)")
    _mark(ax, "no depth", ~there, panels.MISSING)
    _mark(ax, "restored, without probability", unsaid, "white", "////")


def _mark(ax: Axes, label: str, region: BoolArray, color: str, hatch: str | None = None) -> None:
    """Fill a region under the picture, and say below what it is; nothing of an empty one."""
    if not region.any():
        return
    ax.contourf(1.0 * region, [0.5, 1.5], colors=[color], hatches=[hatch], zorder=1)
    handles = [*(old.legend_handles if (old := ax.get_legend()) else ())]
    handles.append(Patch(facecolor=color, edgecolor="black", hatch=hatch, label=label))
    ax.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0), ncols=3, frameon=False)


def _show_hand(ax: Axes, camera: Intrinsics, result: Restoration) -> None:
    """Draw the hand's pixels and keypoints, and write whether they were used."""
    if result.hand_mask is not None and result.hand_mask.any():
        ax.contour(result.hand_mask, [0.5], colors=["white"], linewidths=0.7, linestyles="dotted")
    hand = result.hand
    if hand is None:
        return
    said = "hand given" if hand.source == GIVEN else f"hand found by {hand.source}"
    if hand.check.problems:
        said += ": does not fit" if hand.accepted else ": not accepted"
    uv = project(hand.keypoints, camera)
    if hand.accepted:
        panels.show_keypoints(ax, uv, size=5)
    else:
        for bone in BONES:
            ax.plot(*uv[list(bone)].T, color=panels.MISSING, linewidth=1, linestyle="dashed")
    height, width = camera.shape
    ax.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    ax.set_xlabel(said, fontsize=9)


def told_hand(hand: Hand) -> dict[str, Any]:
    """Where a hand is from, whether it was accepted, and how it fits to the frame."""
    check = asdict(hand.check)
    problems = list(check.pop("problems"))
    told = {"source": hand.source, "accepted": hand.accepted}
    return {**told, "problems": problems, "measured": check}


def confidence_means(result: Restoration) -> str:
    """Say what the confidence of restored pixels is, in a few words."""
    if not result.restored.any():
        return "nothing was restored"
    if result.tolerance_m is not None:
        return f"probability of being right to {100 * result.tolerance_m:g} cm"
    if result.confidence[result.restored].any():
        return "the network's own score, not calibrated"
    network = NETWORKS.get(result.method)
    if network is None or not network.can_say:
        return "0, the method cannot say how sure it is"
    if result.hand is not None and result.hand.doubtful:
        return "no probability: the given hand does not fit this frame"
    if result.ground is not None and result.ground.inside is False:
        return "no probability: outside of what the network learned"
    return "no probability: it is not known what the network learned from"


def counts(
    depth: NDArray[np.float32], result: Restoration, truth: NDArray[np.float32] | None
) -> dict[str, int]:
    """Count the frame's pixels: measured, to restore, with a known truth, restored, missing."""
    measured, target = valid_depth(depth), result.mask
    known = {} if truth is None else {"truth_in_mask": int((valid_depth(truth) & target).sum())}
    return known | {
        "pixels": int(depth.size),
        "measured": int(measured.sum()),
        "mask": int(target.sum()),
        "measured_in_mask": int((measured & target).sum()),
        "restored": int(result.restored.sum()),
        "still_missing_in_mask": int((target & ~result.restored).sum()),
        "still_missing": int((~valid_depth(result.depth)).sum()),
    }


def errors(
    before: NDArray[np.float32],
    after: NDArray[np.float32],
    truth: NDArray[np.float32],
    target: BoolArray,
) -> dict[str, dict[str, float]]:
    """Metrics inside the mask where the truth and the depth in question are valid.

    Their ``coverage`` is the share of the pixels with a known truth (``scorable``) that have this
    depth: a method that answers only where it is easy has a small error and a small coverage.
    """
    rows = {}
    known = target & valid_depth(truth)
    for name, depth, counted in (
        ("measured", before, known & valid_depth(before)),
        ("restored", after, known & valid_depth(after)),
        ("restored_where_measured", after, known & valid_depth(after) & valid_depth(before)),
    ):
        if counted.any():
            scored = asdict(frame_metrics(depth, truth, counted))
            # Of all pixels with a known truth: what RMSE and coverage have to be read together.
            scored["coverage"] = scored["pixels"] / int(known.sum())
            rows[name] = scored | {"scorable": int(known.sum())}
    return rows


def versions() -> dict[str, str]:
    """Versions of what computed the result."""
    found = {
        "hadr": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "opencv": cv2.__version__,
    }
    if "torch" in sys.modules:
        found["torch"] = str(sys.modules["torch"].__version__)
    return found


def summary(report: Mapping[str, Any], out: str) -> str:
    """Sum a report up in some lines, for a terminal."""
    numbers = report["counts"]
    lines = [
        f"method    {report['method_title']}",
        f"restored  {numbers['restored']} of {numbers['mask']} pixels",
        *(f"note      {note}" for note in report["notes"]),
    ]
    if report["errors_in_mask"]:
        lines.append(
            f"errors inside the mask; the truth is known in {numbers['truth_in_mask']} of its "
            f"{numbers['mask']} pixels"
        )
    for name, row in report["errors_in_mask"].items():
        if name == "restored_where_measured":
            name = "the same, where measured"
        found = "  ".join(f"{m.heading} {m.text(row[key])}" for key, m in METRICS.items())
        lines.append(f"  {name:<24} {found}  over {row['pixels']} of {row['scorable']} pixels")
    lines.append(f"written   {out}  ({sum(report['seconds'].values()):.1f} s)")
    return "\n".join(lines)
