"""Measure the sample frames, draw the data card's plots, and write its numbers.

    python benchmarks/samples/data_card.py

Reads data_samples/, writes data_samples/card/*.png, and what stands between the markers
``<!-- NAME -->`` and ``<!-- end NAME -->`` of data_samples/README.md.
"""

import argparse
import json
import re
from collections import Counter
from pathlib import Path

import cv2
import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg

from hadr.data.samples import open_known_unknown, samples_dir
from hadr.data.splits import UNKNOWN_OBJECTS
from hadr.data.transhand import SPLITS, TransHand
from hadr.figures.panels import COLORS, use_style
from hadr.synthesis.generation.statistics import FrameStatistics, frame_statistics
from hadr.synthesis.glass.objects import OBJECTS
from hadr.synthesis.scene.scene import SKIN_TONE_WEIGHTS

SPLIT_COLORS = {"train": COLORS["hadr"], "val": COLORS["baseline"], "test": COLORS["hand"]}


def save(figure: plt.Figure, folder: Path, name: str) -> None:
    """Write a plot small: few colours are enough for it."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = np.asarray(canvas.buffer_rgba())[..., :3]
    plt.close(figure)
    few = (picture.astype(np.uint16) * 31 // 255 * 255 // 31).astype(np.uint8)
    path = folder / f"{name}.png"
    cv2.imwrite(str(path), few[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])
    print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")


def by_split(axis: plt.Axes, values: np.ndarray, split: np.ndarray, bins: np.ndarray) -> None:
    groups = [values[(split == name) & np.isfinite(values)] for name in SPLITS]
    axis.hist(groups, bins, stacked=True, color=[SPLIT_COLORS[s] for s in SPLITS], label=SPLITS)
    axis.set_ylabel("frames")


def plot_views(found: FrameStatistics, folder: Path) -> None:
    split = np.asarray(found.split)
    figure, axes = plt.subplots(1, 3, figsize=(9, 2.7))
    by_split(axes[0], found.distance_m, split, np.linspace(0.2, 0.7, 26))
    axes[0].set_xlabel("camera to hand, m")
    by_split(axes[1], 100 * found.glass_share, split, np.linspace(0, 20, 41))
    axes[1].set_xlabel("pixels of glass, % of the picture")
    by_split(axes[2], 100 * found.visible_share, split, np.linspace(0, 100, 26))
    axes[2].set_xlabel("glass that the hand leaves free, %")
    axes[0].legend()
    save(figure, folder, "views")


def plot_keypoints(frames: TransHand, folder: Path) -> None:
    counts = np.zeros((36, 64))
    inside = []
    for frame in frames:
        scale = 64 / frame.camera.width
        u, v = ((frame.keypoints_uv + 0.5) * scale).T
        seen = (u >= 0) & (u < 64) & (v >= 0) & (v < 36)
        inside.append(seen.mean())
        np.add.at(counts, (v[seen].astype(int), u[seen].astype(int)), 1)
    figure, axes = plt.subplots(1, 2, figsize=(9, 2.9), width_ratios=[1.6, 1])
    shown = axes[0].imshow(counts, cmap="magma", extent=(0, 1280, 720, 0))
    axes[0].set(xlabel="u, pixels at 1280x720", ylabel="v")
    figure.colorbar(shown, ax=axes[0], label="keypoints")
    axes[1].hist(21 * np.array(inside), np.arange(-0.5, 22.5), color=COLORS["hadr"])
    axes[1].set(xlabel="keypoints inside the picture, of 21", ylabel="frames")
    save(figure, folder, "keypoints")


def plot_holds(logs: list[dict], split: np.ndarray, folder: Path) -> None:
    kinds = sorted({log["hold_kind"] for log in logs})
    figure, axes = plt.subplots(1, 3, figsize=(9, 3.0), width_ratios=[1.7, 1, 1])
    bottom = np.zeros(len(kinds))
    for name in SPLITS:
        count = Counter(g["hold_kind"] for g, s in zip(logs, split, strict=True) if s == name)
        height = np.array([count[k] for k in kinds])
        axes[0].bar(kinds, height, bottom=bottom, color=SPLIT_COLORS[name], label=name)
        bottom += height
    axes[0].tick_params(axis="x", rotation=90)
    axes[0].set_ylabel("frames")
    axes[0].legend(loc="upper left", fontsize=8)
    axes[0].set_ylim(0, 1.6 * bottom.max())
    sides = ("right", "left")
    scales = [[100 * g["hand_scale"] for g in logs if g["hand_side"] == side] for side in sides]
    axes[1].hist(
        scales,
        14,
        stacked=True,
        color=[COLORS["hadr"], COLORS["baseline"]],
        label=[f"{side} ({len(scale)})" for side, scale in zip(sides, scales, strict=True)],
    )
    axes[1].set_xlabel("hand size, %")
    axes[1].legend(fontsize=8)
    axes[1].set_ylim(0, 1.3 * axes[1].get_ylim()[1])
    tones = np.array([g["skin_albedo"] for g in logs])
    light = tones @ [0.2126, 0.7152, 0.0722]
    srgb = np.where(tones > 0.0031308, 1.055 * tones ** (1 / 2.4) - 0.055, 12.92 * tones)
    order = np.argsort(light)
    axes[2].scatter(np.arange(len(light)), light[order], c=srgb[order].clip(0, 1), s=14)
    axes[2].set(xlabel="frames, by skin", ylabel="reflectance of the skin")
    save(figure, folder, "holds")


def plot_depth(frames: TransHand, folder: Path) -> None:
    bins = np.linspace(0.15, 3.0, 115)
    counts = {name: np.zeros(len(bins) - 1) for name in ("glass", "hand", "rest")}
    for frame in frames:
        rest = ~(frame.object_mask | frame.hand_mask)
        masks = {"glass": frame.object_mask, "hand": frame.hand_mask, "rest": rest}
        for name, mask in masks.items():
            counts[name] += np.histogram(frame.depth[mask], bins)[0]
    figure, axis = plt.subplots(figsize=(6, 2.7))
    colors = {"glass": COLORS["glass"], "hand": COLORS["hand"], "rest": COLORS["background"]}
    for name, count in counts.items():
        axis.stairs(
            100 * count / count.sum(), bins, fill=True, alpha=0.65, label=name, color=colors[name]
        )
    axis.set(xlabel="true depth, m", ylabel="% of the pixels of each")
    axis.legend()
    save(figure, folder, "depth")


def plot_raw(found: FrameStatistics, folder: Path) -> None:
    split = np.asarray(found.split)
    figure, axes = plt.subplots(1, 3, figsize=(9, 2.7))
    by_split(axes[0], 100 * found.missing_share, split, np.linspace(0, 100, 26))
    axes[0].set_xlabel("glass without raw depth, %")
    axes[0].legend()
    by_split(axes[1], np.clip(1000 * found.bias_m, -60, 300), split, np.linspace(-60, 300, 37))
    axes[1].set_xlabel("raw minus true depth on the glass, mm\n(the last bar: 290 and more)")
    by_split(axes[2], 1000 * found.hand_error_m, split, np.linspace(0, 3, 25))
    axes[2].set_xlabel("error on the hand, mm")
    save(figure, folder, "raw_depth")


def table(head: list[str], rows: list[list[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "| " + " | ".join(["---"] * len(head)) + " |"]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def contents_table(frames: TransHand) -> str:
    rows = []
    for object_id, item in OBJECTS.items():
        row = [f"`{object_id}`", item.name + (" (unknown)" if object_id in UNKNOWN_OBJECTS else "")]
        for split in SPLITS:
            own = [f for f in frames.files if (f.object_id, f.split) == (object_id, split)]
            row.append(str(len(own)))
        rows.append(row)
    total = [str(sum(f.split == split for f in frames.files)) for split in SPLITS]
    rows.append(["all", "", *total])
    return table(["id", "object", *SPLITS], rows)


def holds_table(frames: TransHand, logs: list[dict]) -> str:
    found: dict[str, set[tuple[str, str]]] = {split: set() for split in SPLITS}
    for files, log in zip(frames.files, logs, strict=True):
        found[files.split].add((log["hold_id"], log["hold_kind"]))
    kinds = sorted({kind for holds in found.values() for _, kind in holds})
    rows = [
        [kind, *(str(sum(k == kind for _, k in found[split])) for split in SPLITS)]
        for kind in kinds
    ]
    rows.append(["all", *(str(len(found[split])) for split in SPLITS)])
    return table(["holding poses", *SPLITS], rows)


def sizes_table(root: Path) -> str:
    rows, whole = [], 0
    for name in ("frames", "gallery", "near", "recordings", "checkpoints", "card", "handover"):
        files = [p for p in (root / name).rglob("*") if p.is_file()]
        size = sum(p.stat().st_size for p in files)
        whole += size
        rows.append([f"`{name}`", str(len(files)), f"{size / 1e6:.1f}"])
    rows.append(["all", "", f"{whole / 1e6:.1f}"])
    folders: Counter[str] = Counter()
    number = len(list((root / "frames").glob("*/*/depth/log_json/*.json")))
    for path in (root / "frames").glob("*/*/depth/*/*"):
        folders[path.parent.name] += path.stat().st_size
    kinds = [[f"`{k}`", f"{n / 1000 / number:.1f}"] for k, n in folders.most_common()]
    kinds.append(["all", f"{sum(folders.values()) / 1000 / number:.1f}"])
    return table(["folder", "files", "MB"], rows) + "\n\n" + table(["of a frame", "kB"], kinds)


def row(name: str, values: np.ndarray, unit: str) -> list[str]:
    known = values[np.isfinite(values)]
    if not len(known):
        return [name, unit, *["-"] * 5]
    return [name, unit, *(f"{q:.3g}" for q in np.percentile(known, (0, 10, 50, 90, 100)))]


def statistics_table(found: FrameStatistics) -> str:
    rows = [
        row("camera to hand", found.distance_m, "m"),
        row("glass (median depth)", found.glass_depth_m, "m"),
        row("pixels of glass, of all", 100 * found.glass_share, "%"),
        row("pixels of hand and forearm, of all", 100 * found.hand_share, "%"),
        row("glass that the hand leaves free", 100 * found.visible_share, "%"),
        row("glass without raw depth", 100 * found.missing_share, "%"),
        row("raw minus true depth on glass (median)", 1000 * found.bias_m, "mm"),
        row("raw depth's error on the hand (median)", 1000 * found.hand_error_m, "mm"),
        row("raw depth's error elsewhere (median)", 1000 * found.world_error_m, "mm"),
    ]
    return table(["over all frames", "unit", "least", "10 %", "median", "90 %", "most"], rows)


def outside_table(frames: TransHand) -> str:
    """Raw depth's error on what is not glass, by true distance."""
    edges = (0.15, 0.3, 0.45, 0.6, 0.75, 1.0)
    found: list[list[np.ndarray]] = [[] for _ in edges[1:]]
    for frame in frames:
        for k, errors in enumerate(found):
            near = (frame.depth >= edges[k]) & (frame.depth < edges[k + 1]) & ~frame.object_mask
            raw = frame.raw_depth[near]
            errors.append(np.where(raw > 0, np.abs(raw - frame.depth[near]), np.nan))
    rows = []
    for k, errors in enumerate(found):
        every = np.concatenate(errors)
        seen = 1000 * every[np.isfinite(every)]
        middle, most = np.percentile(seen, (50, 90))
        cells = f"{middle:.2g}", f"{most:.2g}", f"{100 * (seen > 10).mean():.1f}"
        missing = f"{100 * np.isnan(every).mean():.1f}"
        rows.append([f"{edges[k]:.2f} to {edges[k + 1]:.2f}", f"{len(every):,}", *cells, missing])
    head = ["true distance, m", "pixels", "median error, mm", "90 %, mm", "off by over 1 cm, %"]
    return table([*head, "missing, %"], rows)


def flat_share(path: Path, held: np.ndarray) -> float:
    """Share of the surroundings that is nearly of one brightness, in tiles of 14 pixels.

    A tile counts where grey values deviate by less than 3 of 255.
    """
    gray = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE).astype(float)
    height, width = (size // 14 for size in gray.shape)

    def tiles(image: np.ndarray) -> np.ndarray:
        cut = image[: 14 * height, : 14 * width].reshape(height, 14, width, 14)
        return cut.swapaxes(1, 2).reshape(height * width, -1)

    around = ~tiles(held).any(axis=1)
    return float((tiles(gray).std(axis=1)[around] < 3).mean())


def limits_list(frames: TransHand, found: FrameStatistics, logs: list[dict]) -> str:
    """The limits that are numbers."""
    light = np.array([log["skin_albedo"] for log in logs]) @ [0.2126, 0.7152, 0.0722]
    low, middle, high = np.percentile(light, (10, 50, 90))
    free = 100 * found.visible_share[np.isfinite(found.visible_share)]
    held = (frame.hand_mask | frame.object_mask for frame in frames)
    flat = np.array([flat_share(f.color, m) for f, m in zip(frames.files, held, strict=True)])
    shares = ", ".join(f"{100 * share:.0f}" for share in SKIN_TONE_WEIGHTS)
    return "\n".join(
        [
            f"- Skin tones are six base colours with small variation, not a survey of people, and "
            f"they are drawn unevenly: {shares} % from light to dark. Light skin is "
            f"over-represented: {100 * (light > 0.3).mean():.0f} % of the frames show skin that "
            f"reflects more than 0.3 of the light (luminance of `skin_albedo`), "
            f"{100 * (light < 0.2).mean():.0f} % less than 0.2; median {middle:.2f}, 10 % "
            f"{low:.2f}, 90 % {high:.2f}. Results on dark skin rest on few frames.",
            f"- Views favour glass that is little covered: hand and arm leave a median of "
            f"{np.median(free):.1f} % of its silhouette free, and more than 90 % in "
            f"{100 * (free > 90).mean():.0f} % of the frames, unlike in TransHand-14K's published "
            f"pictures, where hands cover more of it.",
            f"- Large flat fields: in {100 * (flat > 0.25).mean():.0f} % of the pictures more than "
            f"a quarter of the surroundings is nearly of one brightness (tiles of 14 pixels whose "
            f"grey values deviate by less than 3 of 255).",
        ]
    )


def experiment_table(root: Path) -> str:
    rows = []
    for name, frames in open_known_unknown(root).items():
        holds = {h for h in frames.hold_ids if h is not None}
        rows.append([name, str(len(frames)), str(len(set(frames.object_ids))), str(len(holds))])
    return table(["part", "frames", "objects", "holding poses"], rows)


def made_table(root: Path) -> str:
    rows = []
    for name in ("frames", "gallery"):
        path = root / name / "generation.json"
        if path.is_file():
            record = json.loads(path.read_text(encoding="utf-8"))
            words = (f"{k} {v}" for k, v in record.items() if v is not None)
            rows.append([f"`{name}`", ", ".join(words)])
    return table(["folder", "settings (`generation.json`)"], rows)


def fill(text: str, name: str, content: str) -> str:
    """Put a table between its markers."""
    pattern = rf"(<!-- {name} -->\n).*?(<!-- end {name} -->)"
    filled, count = re.subn(pattern, lambda m: f"{m[1]}{content}\n{m[2]}", text, flags=re.DOTALL)
    if count != 1:
        raise SystemExit(f"the data card has {count} pairs of markers {name!r}, not one")
    return filled


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=Path, default=samples_dir())
    args = parser.parse_args()
    root, folder = args.samples, args.samples / "card"
    folder.mkdir(exist_ok=True)
    use_style()
    mpl.rcParams["savefig.dpi"] = mpl.rcParams["figure.dpi"] = 90
    frames = TransHand(root / "frames", SPLITS)
    logs = [json.loads(f.log.read_text(encoding="utf-8")) for f in frames.files]
    split = np.array([f.split for f in frames.files])
    found = frame_statistics(frames)
    plot_views(found, folder)
    plot_keypoints(frames, folder)
    plot_holds(logs, split, folder)
    plot_depth(frames, folder)
    plot_raw(found, folder)
    path = root / "README.md"
    text = path.read_text(encoding="utf-8")
    for name, content in {
        "contents": contents_table(frames),
        "holds": holds_table(frames, logs),
        "experiment": experiment_table(root / "frames"),
        "statistics": statistics_table(found),
        "outside": outside_table(frames),
        "limits": limits_list(frames, found, logs),
        "made": made_table(root),
    }.items():
        text = fill(text, name, content)
    # The card's own plots count too.
    path.write_text(fill(text, "sizes", sizes_table(root)), encoding="utf-8")
    print(f"{path} written: {len(frames)} frames")


if __name__ == "__main__":
    main()
