"""The valid files that cases start from, and a copy of the checkout that they work on."""

import json
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from break_it.cases import CHECKOUT, GENERATE, NEAREST
from break_it.worker import snapshot
from hadr.models.hand.hand_model_command import PARTS
from hadr.records.result_file import write_sealed

COPIED = ("hadr", "notebooks", "book", "results", "data_samples", "README.md", "pyproject.toml",
          "LICENSE", "CITATION.cff", "Makefile")  # fmt: skip
FRAMES = (("train", "0000", 10), ("val", "0000", 10), ("test", "0000", 1))
WHEEL = "wheels/mediapipe-0.10.21-cp311-cp311-manylinux_2_17_x86_64.whl"


def hadr(words: Sequence[str], folder: Path, environment: dict[str, str]) -> None:
    """Run a command that must do its work."""
    line = [sys.executable, "-P", "-m", "hadr.cli", *words]
    done = subprocess.run(line, cwd=folder, env=environment, capture_output=True, text=True)
    if done.returncode and not (folder / "reproduced/tables/known.json").exists():
        raise SystemExit(f"hadr {' '.join(words)} failed:\n{done.stderr[-2000:]}")


def make_fixtures(work: Path, environment: dict[str, str]) -> dict[str, str]:
    """Make `work/fixtures` and `work/checkout`; what lies in the latter."""
    root = work / "fixtures"
    if (root / "build").exists():  # they are there from another time
        return snapshot(work / "checkout")
    for name in ("fixtures", "cache", "tmp", "checkout"):
        (work / name).mkdir(parents=True)
    for name in COPIED:
        source, target = CHECKOUT / name, work / "checkout" / name
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, target)
    make_frame(root)
    make_data(root)
    make_wheel(root / WHEEL)
    commands = [
        *(["train", "--preset", "tiny", "--network", network, "--epochs", "1", "--data", "data",
           "--out", f"train-{name}"]
          for name, network in (("net", "hadr"), ("plus", "hadr-plus"), ("seg", "segmentation"),
                                ("kpt", "hand-keypoints"))),
        ["handover", "--conditions", "perfect", "--objects", "0004", "--holds", "902", "--jobs",
         "1", "--out", "attempt"],
        ["reproduce", "--only", "known/nearest", "--out", "reproduced"],
        ["generate", *GENERATE.words(out="made")],
        ["restore", *NEAREST.words(out="restored")],
    ]  # fmt: skip
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda words: hadr(words, root, environment), commands))
    for name in ("net", "plus", "seg", "kpt"):
        for kind in ("safetensors", "json"):
            shutil.copy(root / f"train-{name}/best.{kind}", root / f"{name}.{kind}")
    hadr(["calibrate", "plus.safetensors", "data"], root, environment)
    shutil.move(root / "train-net", root / "run")
    shutil.copy(root / "run/last.safetensors", root / "last.safetensors")
    shutil.copy(root / "attempt/perfect/0004-902-log.npz", root / "log.npz")
    shutil.copy(root / "attempt/perfect/0004-902.npz", root / "states.npz")
    shutil.copy(root / "reproduced/tables/known.json", root / "result.json")
    make_build(root / "build")
    return snapshot(work / "checkout")


def make_frame(root: Path) -> None:
    """The files of a small frame in all forms: a hole in a plane at 0.8 m."""
    import cv2
    import OpenEXR

    depth = np.full((48, 64), 800, np.uint16)
    depth[10:30, 20:40] = 0
    mask = np.zeros((48, 64), np.uint8)
    mask[10:30, 20:40] = 255
    noise = np.random.default_rng(0).integers(-15, 15, (48, 64, 1))
    color = (noise + np.array([90, 115, 150])).astype(np.uint8)  # skin, in OpenCV's order
    hand = np.linspace(0, 1, 21)[:, None] * (0.15, 0.15, 0.01) + (-0.1, -0.05, 0.805)
    for name, image in (("rgb.png", color), ("rgb.jpg", color), ("depth.png", depth),
                        ("mask.png", mask), ("arm.png", 255 - mask)):  # fmt: skip
        cv2.imwrite(str(root / name), image)
    for name in ("rgb", "depth", "mask"):
        (root / "frames" / name).mkdir(parents=True)
        for number in "012":
            shutil.copy(root / f"{name}.png", root / "frames" / name / f"{number}.png")
    metres = np.where(mask > 0, 0.75, 0.8).astype(np.float32)
    np.save(root / "truth.npy", metres)
    np.save(root / "mask.npy", mask > 0)
    np.save(root / "hand.npy", hand)
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"Z": metres}).write(str(root / "depth.exr"))
    (root / "hand.json").write_text(json.dumps(hand.tolist()))
    (root / "hand.txt").write_text("\n".join(" ".join(map(str, p)) for p in hand) + "\n")
    camera = {"fx": 80, "fy": 80, "cx": 31.5, "cy": 23.5, "width": 64, "height": 48}
    (root / "camera.json").write_text(json.dumps(camera))
    (root / "camera.yaml").write_text("".join(f"{k}: {v}\n" for k, v in camera.items()))


def make_data(root: Path) -> None:
    """Some of the bundled frames, a recording, and a photograph for backgrounds."""
    samples = CHECKOUT / "data_samples"
    wanted = [("data", *one) for one in FRAMES] + [("few", *one[:2], 1) for one in FRAMES]
    for folder, split, thing, count in wanted:
        source = samples / "frames" / split / thing / "depth"
        stems = sorted(p.stem for p in (source / "rgb").iterdir())[:count]
        for file in source.glob("*/*"):
            if file.stem in stems:
                target = root / folder / split / thing / "depth" / file.parent.name / file.name
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(file, target)
    shutil.copy(samples / "frames/generation.json", root / "data/generation.json")
    (root / "recordings").mkdir()
    shutil.copy(samples / "recordings/0000/0000-above-0001.csv", root / "recordings/0000.csv")
    shutil.copy(root / "recordings/0000.csv", root / "recording.csv")
    (root / "photos").mkdir()
    shutil.copy(root / "rgb.jpg", root / "photos/wall.jpg")


def make_wheel(path: Path) -> None:
    """A wheel as pip takes it, with other networks than MediaPipe's."""
    path.parent.mkdir()
    with zipfile.ZipFile(path, "w") as wheel:
        about = "mediapipe-0.10.21.dist-info"
        wheel.writestr(
            f"{about}/METADATA", "Metadata-Version: 2.1\nName: mediapipe\nVersion: 0.10.21\n"
        )
        wheel.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: false\n")
        wheel.writestr(f"{about}/RECORD", "")
        for place, _ in PARTS.values():
            wheel.writestr(place, "another network")


def make_build(build: Path) -> None:
    """A build folder as `hadr book` leaves it, whose chapters were never executed."""
    (build / "executed").mkdir(parents=True)
    words = "hadr made this folder: `make clean` may remove it with all that is in it.\n"
    (build / ".made-by-hadr").write_text(words)
    chapters = sorted((CHECKOUT / "notebooks").glob("*.ipynb"))
    shutil.copy(CHECKOUT / "notebooks/03_ray_voxels.ipynb", build / "executed")
    times = {chapter.stem: {"duration_s": 1.5, "machine": "m"} for chapter in chapters}
    content = {"parameters": {"preset": "tiny", "seed": 0}, "chapters": times, "provenance": {}}
    write_sealed(build / "results.json", content)
