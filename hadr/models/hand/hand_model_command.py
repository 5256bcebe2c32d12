"""`hadr hand-model`: make the model that MediaPipe finds hands with, from the package index.

MediaPipe's package comes without its models, and its models' page is no package index. But older
wheels carry the two networks, under the licence of the package, Apache-2.0: one finds palms, one
the 21 landmarks of a hand. Zipped without compression, under the names that today's package looks
for, they are its `hand_landmarker.task`. Of the wheel only these two files are taken, and only
with the checksums that stand here; nothing of it is installed or run.

Source: wheels of mediapipe 0.10.14 and 0.10.21, in which both files are the same; tried with
mediapipe 1.2.2.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from hadr.records.option_words import FILE
from hadr.records.output_folder import check_file
from hadr.records.writing import whole_file

PARTS: dict[str, tuple[str, str]] = {
    "hand_detector.tflite": (
        "mediapipe/modules/palm_detection/palm_detection_full.tflite",
        "1b14e9422c6ad006cde6581a46c8b90dd573c07ab7f3934b5589e7cea3f89a54",
    ),
    "hand_landmarks_detector.tflite": (
        "mediapipe/modules/hand_landmark/hand_landmark_full.tflite",
        "11c272b891e1a99ab034208e23937a8008388cf11ed2a9d776ed3d01d0ba00e3",
    ),
}
"""The model's files: where each lies in the wheel, and its SHA-256."""
PLATFORMS = ("manylinux_2_28_x86_64", "manylinux_2_17_x86_64")
"""The wheels to ask for, whatever machine this is: the networks are the same in all."""

EPILOG = """\
what is written
  One file of 7.8 MB, for 'hadr restore --hand mediapipe --hand-model FILE':
  MediaPipe's networks palm_detection_full and hand_landmark_full, Apache-2.0.
  The wheel they lie in (36 MB) is fetched by pip from the package index that
  pip is set up for, into a temporary folder. Both are checked against SHA-256
  checksums that are part of hadr.

examples
    hadr hand-model --out hand_landmarker.task
  Then, with the package MediaPipe (pip install 'hadr[mediapipe]'):
    hadr restore --hand mediapipe --hand-model hand_landmarker.task ...

exit status
  0 done   2 the model could not be made; it says why"""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Make the model that MediaPipe finds hands with.

    It is taken out of an older wheel of mediapipe, which pip fetches from the
    package index.
    """

    out: Annotated[str, FILE]
    """file to write, such as hand_landmarker.task; a file that is there is never replaced, unless
    it is this model"""
    version: Literal["0.10.21", "0.10.14"] = "0.10.21"
    """release of mediapipe whose wheel holds the networks; they are the same in both"""


def run(options: Options) -> int:
    """Run the command.

    Raises:
        ValueError: The wheel can't be had, or does not hold what it should, in one sentence.
        OSError: The file can't be written, or is another one.
    """
    out = Path(options.out)
    check_file(out)
    if out.exists():
        if not is_hand_model(out):
            raise FileExistsError(
                f"{out} is there and is not this model; it is not replaced, name another file"
            )
        print(f"{out} is this model already")
        return 0
    with tempfile.TemporaryDirectory(prefix="hadr-hand-model-") as folder:
        print(f"fetching the wheel of mediapipe {options.version} from the package index")
        write_hand_model(_fetch_wheel(options.version, Path(folder)), out)
    print(f"written   {out}  (MediaPipe's hand networks, Apache-2.0)")
    return 0


def write_hand_model(wheel: Path, out: Path) -> None:
    """Take the two networks out of a wheel and write them as one model, whole or not at all."""
    with whole_file(out) as part, zipfile.ZipFile(part, "w") as model:
        for name, content in _networks(wheel).items():
            model.writestr(zipfile.ZipInfo(name), content)  # stored, and of no date


def is_hand_model(path: Path) -> bool:
    """Whether a file is what `hadr hand-model` writes, by the checksums of its parts."""
    try:
        with zipfile.ZipFile(path) as model:
            return model.namelist() == list(PARTS) and all(
                hashlib.sha256(model.read(part)).hexdigest() == checksum
                for part, (_, checksum) in PARTS.items()
            )
    except (OSError, zipfile.BadZipFile):
        return False


def _networks(wheel: Path) -> dict[str, bytes]:
    """The model's files out of a wheel, checked."""
    found = {}
    try:
        with zipfile.ZipFile(wheel) as archive:
            for part, (place, expected) in PARTS.items():
                found[part] = archive.read(place)
                checksum = hashlib.sha256(found[part]).hexdigest()
                if checksum != expected:
                    raise ValueError(
                        f"{place} in {wheel.name} has the SHA-256 {checksum}, expected {expected}; "
                        "nothing was written"
                    )
    except KeyError as error:
        raise ValueError(f"{wheel.name} holds no {place}; nothing was written") from error
    except zipfile.BadZipFile as error:
        raise ValueError(f"{wheel.name} is damaged: {error}; nothing was written") from error
    return found


def _fetch_wheel(version: str, folder: Path) -> Path:
    """Have pip fetch mediapipe's wheel into a folder; nothing is installed, nothing of it run."""
    words = ["download", "--quiet", "--no-deps", "--only-binary=:all:", "--python-version=3.11"]
    words += [f"--platform={name}" for name in PLATFORMS]
    words += ["--no-input", "--retries=2", f"--dest={folder}", f"mediapipe=={version}"]
    done = subprocess.run(
        [sys.executable, "-m", "pip", *words], capture_output=True, text=True, check=False
    )
    wheels = list(folder.glob("*.whl"))
    if done.returncode == 0 and len(wheels) == 1:
        return wheels[0]
    told = done.stderr
    if "No module named pip" in told:
        why = f"{sys.executable} has no pip; give it one with '{sys.executable} -m ensurepip'"
    elif "Retrying" in told or "ConnectionError" in told:
        why = "the package index can't be reached; is there a network?"
    elif "No matching distribution" in told:
        why = "the package index that pip asks has no such wheel"
    else:
        lines = [line for line in told.splitlines() if line.strip()]
        why = f"pip said: {lines[-1] if lines else f'exit status {done.returncode}'}"
    raise ValueError(f"the wheel of mediapipe {version} could not be fetched: {why}")
