"""What is done to a valid file to make a case of it: a word and its arguments, in a table."""

import contextlib
import json
import os
import pickle
import random
import re
import shutil
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

DEEP = "@DEEP"
"""Stands in a JSON value for a list in a list in a list, 100,000 times."""


class Planted:
    """What a file of pickle does to whoever loads it: it leaves a file `executed-pickle`."""

    def __reduce__(self) -> Any:
        return (open, ("executed-pickle", "w"))


def put(value: Any, dotted: str, given: Any) -> None:
    """Set a field of nested JSON, such as "data.corruption"; DROP removes it."""
    *path, last = [int(p) if p.isdigit() else p for p in dotted.split(".")]
    for part in path:
        value = value[part]
    if given == "@DROP":
        del value[last]
    else:
        value[last] = given


def dumped(value: Any) -> str:
    return json.dumps(value).replace(f'"{DEEP}"', "[" * 100_000 + "]" * 100_000)


def to_record(path: Path, change: Any, honest: bool = True) -> None:
    """Change the record in a checkpoint's header, and its checksum too, if that is honest."""
    from safetensors.torch import load_file

    from hadr.training.checkpoints import checksum

    data = path.read_bytes()
    (size,) = struct.unpack("<Q", data[:8])
    header = json.loads(data[8 : 8 + size])
    record = change(header["__metadata__"]["hadr"])
    with contextlib.suppress(TypeError, AttributeError, RecursionError):
        forged = json.loads(record)
        if honest:
            forged["sha256"] = checksum(load_file(path), forged)
            record = dumped(forged)
    header["__metadata__"]["hadr"] = record
    text = json.dumps(header).encode()
    path.write_bytes(struct.pack("<Q", len(text)) + text + data[8 + size :])


def field(path: Path, dotted: str, given: Any) -> None:
    """Set a field: of a JSON file, or of a checkpoint's record."""

    def change(text: str) -> str:
        if not dotted:
            return dumped(given)
        value = json.loads(text)
        put(value, dotted, given)
        return dumped(value)

    if path.suffix == ".safetensors":
        to_record(path, change)
    else:
        path.write_text(change(path.read_text()))


def flipped_record(path: Path, old: str, new: str) -> None:
    """Change a checkpoint's record as damage would: a few characters, and no checksum."""
    to_record(path, lambda text: re.sub(old, new, text, count=1), honest=False)


def weights(path: Path, how: str) -> None:
    """Change a checkpoint's weights and nothing else."""
    data = bytearray(path.read_bytes())
    (size,) = struct.unpack("<Q", data[:8])
    start = 8 + size
    if how == "nan":
        data[start : start + 4 * 500] = struct.pack("<f", float("nan")) * 500
    else:  # one bit, half way
        data[start + (len(data) - start) // 2] ^= 64
    path.write_bytes(data)


def array(path: Path, expression: str) -> None:
    """Replace an array, or one of an .npz as `name: expression`; the old one is `a`."""
    names = {"np": np, "nan": np.nan, "inf": np.inf}
    if path.suffix == ".npz":
        name, _, expression = expression.partition(": ")
        with np.load(path, allow_pickle=True) as file:
            content = dict(file)
        content[name] = np.asarray(eval(expression, {**names, "a": content.get(name)}))
        np.savez_compressed(path, **content)
        return
    old: Any = np.load(path) if path.suffix == ".npy" else _picture(path)
    new = np.asarray(eval(expression, {**names, "a": old}))
    if path.suffix == ".npy":
        np.save(path, new, allow_pickle=True)
    else:
        _write_picture(path, new)


def _picture(path: Path) -> Any:
    import cv2

    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


def _write_picture(path: Path, pixels: Any, kind: str = ".png") -> None:
    import cv2

    path.write_bytes(cv2.imencode(kind, pixels)[1].tobytes())


def turned(path: Path, orientation: int) -> None:
    """Write into a picture how it is to be turned."""
    from PIL import ExifTags, Image

    with Image.open(path) as picture:
        about = picture.getexif()
        about[ExifTags.Base.Orientation] = orientation
        picture.save(path, exif=about)


def exr(path: Path, channels: str) -> None:
    """Write an EXR with channels of these names."""
    import OpenEXR

    plane = np.full((48, 64), 0.8, np.float32)
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {c: plane for c in channels}).write(str(path))


def noise(path: Path, how: str, seed: int) -> None:
    """Change the bytes by chance: a flipped bit, a cut, others of the same length, more of them."""
    rng, data = random.Random(f"{path.name} {how} {seed}"), bytearray(path.read_bytes())
    if how == "flip":
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    elif how == "flip-head":
        data[rng.randrange(min(len(data), 64))] ^= 1 << rng.randrange(8)
    elif how == "cut":
        del data[int(len(data) * (0.02, 0.25, 0.5, 0.75, 0.9)[seed % 5]) + seed // 5 :]
    elif how == "junk":
        data = bytearray(rng.randbytes(len(data)))
    elif how == "zeros":
        data = bytearray(len(data))
    elif how == "blot":  # behind what a picture begins with
        at = rng.randrange(len(data) // 2, len(data) - 100)
        data[at : at + 64] = rng.randbytes(64)
    elif how == "hole":
        at = rng.randrange(len(data))
        del data[at : at + 16]
    path.write_bytes(data)


def replaced(path: Path, what: str) -> None:
    """Put something else there under the file's name."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.is_dir() and not path.is_symlink():
        os.rename(path, path.with_name(path.name + ".before"))
    else:
        path.unlink(missing_ok=True)
    if what == "folder":
        path.mkdir()
    elif what == "fifo":
        os.mkfifo(path)
    elif what == "loop":
        path.symlink_to(path.name)
    elif what.startswith("->"):
        path.symlink_to(what[2:])
    elif what.startswith("copy "):
        path.write_bytes((path.parent / what[5:]).read_bytes())
    elif what == "pickle":
        np.save(path.with_suffix(".npy"), np.array([Planted()], object), allow_pickle=True)
        if path.suffix == ".npz":
            np.savez(path, header=np.array([Planted()], object))
        elif path.suffix != ".npy":
            os.remove(path.with_suffix(".npy"))
            path.write_bytes(pickle.dumps(Planted()))
    elif what != "missing":
        raise ValueError(what)


def header(path: Path, text: str) -> None:
    """An .npy whose header is this text."""
    body = text.encode()
    path.write_bytes(b"\x93NUMPY\x02\x00" + struct.pack("<I", len(body)) + body + bytes(4096))


def size(path: Path, width: int, height: int) -> None:
    """Write another size into a PNG's header, and its checksum."""
    data = bytearray(path.read_bytes())
    data[16:24] = struct.pack(">II", width, height)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    path.write_bytes(data)


def column(path: Path, part: str, expression: str) -> None:
    """Change the numbers x of a recording's columns whose names hold one of these words."""
    lines = path.read_text().splitlines()
    first = next(n for n, line in enumerate(lines) if not line.startswith("#"))
    names = lines[first].split(",")
    wanted = [n for n, name in enumerate(names) if any(word in name for word in part.split("|"))]
    for number, line in enumerate(lines[first + 1 :], first + 1):
        cells = line.split(",")
        for n in wanted:
            cells[n] = str(eval(expression, {"x": float(cells[n]), "nan": np.nan}))
        lines[number] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n")


def log(path: Path, name: str, given: Any) -> None:
    """Forge a field of a run log's header, with the right checksum."""
    from hadr.handover.logs.run_log import RunLog, read_run_log

    found = read_run_log(path)
    content = dict(found.header)
    put(content, name, given)
    RunLog(found.arrays, content).save(path)


def log_array(path: Path, name: str, expression: str) -> None:
    """Forge an array of a run log, with the right checksum."""
    from hadr.handover.logs.run_log import RunLog, read_run_log

    found = read_run_log(path)
    new = eval(expression, {"np": np, "nan": np.nan, "a": found.arrays[name]})
    RunLog({**found.arrays, name: np.asarray(new)}, found.header).save(path)


def sealed(path: Path, dotted: str, given: Any) -> None:
    """Change a record or a result file, and give it the right checksum."""
    from hadr.records.result_file import read_sealed, seal_row, write_sealed

    content = json.loads(path.read_text())
    if "provenance" in content:
        content = read_sealed(path)
        put(content, dotted, given)
        write_sealed(path, content)
    else:
        put(content, dotted, given)
        path.unlink()  # as it was written: it is not to be kept
        seal_row(path, content)


def scaled(path: Path, name: str, factor: Any) -> None:
    """Multiply all numbers of a field of a JSON file."""
    content = json.loads(path.read_text())
    old = content[name]
    new = (
        {k: np.multiply(v, factor).tolist() for k, v in old.items()}
        if isinstance(old, dict)
        else (np.multiply(old, factor).tolist())
    )
    path.write_text(json.dumps({**content, name: new}))


def swapped(path: Path, other: str) -> None:
    """Two files or folders take each other's name."""
    path.rename(path.with_name("aside"))
    path.with_name(other).rename(path)
    path.with_name("aside").rename(path.with_name(other))


def locked(path: Path) -> None:
    """A run has the folder in which this file lies to itself, as long as this process lives."""
    from hadr.records.writing import sole_owner

    HELD.append(owner := sole_owner(path.parent, "hadr train"))
    owner.__enter__()


HELD: list[Any] = []
EDITS = {
    "text": lambda path, text: (path.parent.mkdir(parents=True, exist_ok=True),
                                path.write_text(text.replace(DEEP, "[" * 100_000))),
    "field": field, "weights": weights, "record": flipped_record, "array": array,
    "exr": exr, "turned": turned, "noise": noise, "replaced": replaced, "header": header,
    "size": size, "column": column, "log": log, "log_array": log_array, "sealed": sealed,
    "scaled": scaled, "swapped": swapped, "locked": locked,
    "tree": lambda path, source: shutil.copytree(path.parent / source, path),
    "swap": lambda path, old, new: path.write_text(path.read_text().replace(old, new)),
    "unreadable": lambda path: path.chmod(0),
    "lossy": lambda path, kind: _write_picture(path, _picture(path), kind),
    "bytes": lambda path, hexadecimal: path.write_bytes(bytes.fromhex(hexadecimal)),
}  # fmt: skip
