"""A process that imports hadr once and tries case after case: JSON lines in, JSON lines out."""

import contextlib
import hashlib
import importlib
import json
import os
import re
import resource
import shutil
import sys
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from break_it.edits import EDITS

PROGRESS = re.compile(r"^.*\d+%\|.*?(?=hadr \w+: error|$)", re.MULTILINE)
READERS: dict[str, Callable[..., Any]] = {}
"""What is called for a case that names no command: by a reader's name."""


SAME = {
    "hand": ("keypoint",), "hand.npy": ("keypoint",), "hand.json": ("keypoint",),
    "hand.txt": ("keypoint",), "rgb": ("colour",),
    "camera.yaml": ("intrinsics",), "camera.json": ("intrinsics",), "build": ("folder",),
}  # fmt: skip
"""What a sentence may say in place of a file's or an option's name."""


def of(module: str, name: str) -> Callable[..., Any]:
    return lambda *args: getattr(importlib.import_module(f"hadr.{module}"), name)(*args)


for where in (
    "frame_io:read_color read_depth read_mask read_hand", "camera_file:load_intrinsics",
    "training.checkpoints:load_checkpoint load_training_state",
    "handover.logs.run_log:read_run_log", "simulation.world.state:load_states",
    "synthesis.recordings.recording:read_recording", "data.samples:verify_manifest",
    "records.result_file:read_result_file read_sealed",
):  # fmt: skip
    READERS |= {name: of(where.split(":")[0], name) for name in where.split(":")[1].split()}
READERS["TransHand"] = lambda root: list(of("data.transhand", "TransHand")(root, "test"))


def snapshot(folder: Path) -> dict[str, str]:
    """What lies in a folder: each file's kind and content by its name."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_symlink():
            found[name] = f"link to {os.readlink(path)}"
        elif path.is_file() and os.access(path, os.R_OK):
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
        else:
            found[name] = f"kind {path.lstat().st_mode >> 12}"
    return found


def differences(before: dict[str, str], after: dict[str, str]) -> tuple[list[str], list[str]]:
    """Names that were lost or changed, and new ones."""
    gone = [name for name in before if after.get(name) != before[name]]
    return gone, [name for name in after if name not in before]


def complaint(words: str, told: str, says: list[str], program: str) -> str:
    """What is wrong with a refusal's words; "" if it is one sentence that names what is wrong."""
    told = PROGRESS.sub("", told.replace("\r", "\n"))
    flat = " ".join(told.split())
    if "Traceback (most recent call last)" in told:
        return "a traceback on stderr"
    tyro = " ---" in told  # a wrong call: its box has lines
    if not flat:
        return "no word why"
    if not tyro and len(told.strip().splitlines()) > 1:
        return f"more than a sentence: {told.strip()[:300]}"
    if len(flat) > 1500:
        return f"endless: {len(flat)} characters, {flat[:200]}"
    words = [*says, *(same for word in says for same in SAME.get(word, ()))]
    words += [word.replace("-", by) for word in says for by in " _"]  # --depth-scale: depth scale
    if says and not any(word.lower() in flat.lower() for word in words):
        return f"names none of {says}: {flat[:300]}"
    if program and not tyro and not flat.startswith(f"hadr {program}"):
        return f"does not begin with hadr {program}: {flat[:300]}"
    return ""


def judged(case: dict[str, Any], before: dict[str, str], after: dict[str, str],
           status: Any, told: str) -> tuple[str, str]:  # fmt: skip
    """A case's verdict and the detail."""
    gone, new = differences(before, after)
    gone = [n for n in gone if not any(n == o or n.startswith(f"{o}/") for o in case["may"])]
    if any("executed" in name for name in new):
        return "executed", f"code in a file was run: {new}"
    if isinstance(status, str):
        return "traceback", status
    if gone:
        return "damaged", f"{gone[:5]} (exit status {status})"
    if status == 0:
        strange = [n for n in new if n.split("/")[0] not in case["out"]]
        noted = case["expect"] == "noted" and any(word in told for word in case["says"])
        if case["expect"] in ("refused", "noted", "partly") and not noted:
            return "accepted", told.strip()[-200:]
        return ("left over", f"{strange[:5]}") if strange else ("fine", "")
    if case["expect"] == "works":
        return "refused a right one", told.strip()[-400:]
    partly = case["expect"] == "partly" and status == 1
    if new and not (partly and all(n.split("/")[0] in case["out"] for n in new)):
        return "left over", f"{new[:5]} after a refusal"
    if status not in (1, 2):
        return "wrong status", f"exit status {status}"
    reader = case["command"] in READERS
    wrong = complaint("", told, case["says"], "" if reader else case["command"])
    return ("unclear", wrong) if wrong else ("fine", "")


def call(case: dict[str, Any]) -> tuple[Any, str]:
    """Call a command or a reader; its exit status, or the traceback and the place in hadr."""
    try:
        if case["command"] in READERS:
            try:
                READERS[case["command"]](*case["words"])
            except (ValueError, OSError) as error:
                print(error, file=sys.stderr)
                return 2, ""
            return 0, ""
        return importlib.import_module("hadr.cli").main([case["command"], *case["words"]]), ""
    except SystemExit as left:
        return left.code or 0, ""
    except BaseException as error:
        frames = [f for f in traceback.extract_tb(error.__traceback__) if "/hadr/" in f.filename]
        where = frames[-1] if frames else None
        place = f"{where.filename.split('/hadr/')[-1]}:{where.lineno}" if where else "?"
        return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}", f"hadr/{place}"


@contextlib.contextmanager
def caught(folder: Path) -> Any:
    """Put both streams into files, also what compiled libraries write."""
    kept = os.dup(1), os.dup(2)
    files = [open(folder / f"{n}.stream", "wb") for n in (1, 2)]  # noqa: SIM115
    for n, file in zip((1, 2), files, strict=True):
        os.dup2(file.fileno(), n)
    try:
        yield
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        for n, old, file in zip((1, 2), kept, files, strict=True):
            os.dup2(old, n)
            os.close(old)
            file.close()


def tried(case: dict[str, Any], fixtures: Path, folder: Path) -> dict[str, Any]:
    """Try a case in a fresh folder."""
    work = folder / "work"
    work.mkdir()
    names = {str(w).split("/")[0].split("=")[-1] for w in (*case["words"], *case["needs"])}
    names |= {name.split("/")[0] for name, *_ in case["edits"]}
    names |= {Path(str(a)[5:]).name for _, *args in case["edits"] for a in args}  # "copy rgb.png"
    for name in names & set(os.listdir(fixtures)):
        if (fixtures / name).is_dir():
            shutil.copytree(fixtures / name, work / name)
        else:
            shutil.copy(fixtures / name, work / name)
    for name, edit, *args in case["edits"]:
        EDITS[edit](work / name, *args)
    before = snapshot(work)
    os.chdir(work)
    with caught(folder), warnings.catch_warnings():
        warnings.simplefilter("always", RuntimeWarning)
        warnings.simplefilter("always", UserWarning)
        status, place = call(case)
    os.chdir("/")
    told = (folder / "2.stream").read_text(errors="replace")
    if "Traceback (most recent call last)" in told and status == 1:  # the command's own word
        found = re.findall(r'/(hadr/[\w/]+\.py)", line (\d+)', told)
        status, place = told.strip()[-400:], ":".join(found[-1]) if found else "?"
    if case["expect"] == "noted" and status == 0:
        told += (folder / "1.stream").read_text(errors="replace")
    verdict, detail = judged(case, before, snapshot(work), status, told)
    return {"verdict": verdict, "detail": detail, "place": place}


def main() -> None:
    fixtures = Path(sys.argv[1])
    with contextlib.suppress(ValueError, OSError):  # where there is such a limit
        resource.setrlimit(resource.RLIMIT_AS, (5 << 30, 5 << 30))
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.stdin:
        request = json.loads(line)
        try:
            answer = tried(request["case"], fixtures, Path(request["folder"]))
        except Exception:
            answer = {"verdict": "broken case", "detail": traceback.format_exc()[-1500:]}
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
