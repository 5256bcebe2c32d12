"""The table of bad inputs: what is changed in a valid call, and what should come of it."""

# fmt: off
# ruff: noqa: E501

import dataclasses
import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from break_it.edits import DEEP

NAN, INF, HUGE = math.nan, math.inf, 10**400
CHECKOUT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Case:
    """One try.

    `expect` is "refused": exit status 2 and one sentence; "safe": that, or a result, as long as
    nothing breaks; "noted": a result that says so; "partly": a result of what is right, exit status
    1 and one sentence, or refused; "works": a right input, which keeps the others honest.
    """

    kind: str
    command: str
    name: str
    words: tuple[str, ...]
    edits: tuple[tuple[Any, ...], ...] = ()
    expect: str = "refused"
    says: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    out: tuple[str, ...] = ("out", "out.json")
    may: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


@dataclass(frozen=True, eq=False)
class Call:
    """A valid call: options by name, "" for what stands without one; what it reads and makes."""

    command: str
    options: dict[str, str]
    needs: tuple[str, ...] = ()
    may: tuple[str, ...] = ()
    out: tuple[str, ...] = field(default=("out", "out.json"))

    def words(self, **changes: str | None) -> tuple[str, ...]:
        given = {**self.options, **{k.replace("_", "-"): v for k, v in changes.items()}}
        line = []
        for name, value in sorted(given.items()):
            if value is not None:
                line += [*([f"--{name}"] if name else []), *(value.split("\t") if value else [])]
            if value == "" and name not in FLAGS:
                line += [""]
        return tuple(line)

    def case(self, kind: str, name: str, *edits: tuple[Any, ...], expect: str = "refused",
             says: tuple[str, ...] = (), may: tuple[str, ...] | None = None,
             makes: tuple[str, ...] | None = None, **changes: Any) -> Case:
        words = self.words(**changes)
        return Case(kind, self.command, name, words, edits, expect, says, self.needs,
                    self.out if makes is None else makes, self.may if may is None else may)


FLAGS = ("no-slides", "readme-times", "html-only", "dry-run", "overwrite", "resume", "quiet",
         "no-browser", "sensor", "no-sensor", "film", "watch", "restless", "tensorboard", "no-aggregation")
FRAME = {"rgb": "rgb.png", "depth": "depth.png", "intrinsics": "camera.json", "mask": "mask.png",
         "out": "out"}
NEAREST = Call("restore", {**FRAME, "method": "nearest"})
SEQUENCE = Call("restore", {"rgb": "frames/rgb", "depth": "frames/depth", "mask": "frames/mask", "out": "out",
                            "intrinsics": "camera.json", "method": "nearest"})
HAND = Call("restore", {**FRAME, "method": "hand-median", "hand": "hand.json"})
NETWORK = Call("restore", {**FRAME, "hand": "hand.json", "checkpoint": "net.safetensors"})
PLUS = Call("restore", {**FRAME, "hand": "hand.json", "checkpoint": "plus.safetensors"})
FOUND = Call("restore", {**FRAME, "mask": None, "segmentation": "seg.safetensors",
                         "keypoint-network": "kpt.safetensors", "checkpoint": "net.safetensors"})
GENERATE = Call("generate", {"out": "out", "frames": "1", "width": "64", "height": "36",
                "engine": "raycast", "quality": "fast", "objects": "0000", "workers": "1",
                "recordings": "recordings"})
TRAIN = Call("train", {"out": "out", "data": "data", "preset": "tiny", "epochs": "1"})
RESUME = Call("train", {"out": "run", "data": "data", "preset": "tiny", "epochs": "1",
                        "resume": ""}, may=("run",), out=("run",))
EVALUATE = Call("evaluate", {"": "net.safetensors", "data": "data", "out": "out.json"})
CALIBRATE = Call("calibrate", {"": "plus.safetensors\tdata", "out": "out.json"},
                 may=("plus.safetensors", "plus.json"), out=("out.json", "plus.json"))
REPLAY = Call("handover", {"replay": "log.npz"})
HANDOVER = Call("handover", {"out": "out", "conditions": "raw", "objects": "0004", "holds": "902",
                             "jobs": "1", "dry-run": ""})
ATTEMPT = Call("handover", {"out": "attempt", "conditions": "perfect", "objects": "0004", "holds": "902",
                            "jobs": "1"}, may=("attempt",), out=("attempt",))
REPRODUCE = Call("reproduce", {"out": "out", "only": "known/raw", "dry-run": ""})
AGAIN = Call("reproduce", {"out": "out", "again": "result.json\tnearest"})
BOOK = Call("book", {"build": "build", "readme-times": ""}, out=("build",))
HTML = Call("book", {"build": "build", "html-only": "", "only": "03"}, out=("build",))
COURSE = Call("course", {"out": "out", "only": "03", "no-slides": ""})
VIEW = Call("view", {"": "restored", "no-browser": ""}, out=("restored",))
HAND_MODEL = Call("hand-model", {"out": "hand.task"}, needs=("wheels",), out=("hand.task",))
EXECUTED = Call("course", {"out": "out", "only": "03", "executed": "build"})
#: Right inputs, each once.
RIGHT = (NEAREST, SEQUENCE, HAND, NETWORK, PLUS, FOUND, GENERATE, TRAIN, RESUME, EVALUATE, CALIBRATE, REPLAY,
         HANDOVER, ATTEMPT, REPRODUCE, AGAIN, COURSE, VIEW)
#: Options that name a file or a folder to read: the call, the option, the file that stands there.
READ = (
    *((NEAREST, name, FRAME[name]) for name in ("rgb", "depth", "intrinsics", "mask")),
    *((SEQUENCE, name, f"frames/{name}") for name in ("rgb", "depth", "mask")),
    *((SEQUENCE, name, f"frames/{name}/1.png") for name in ("rgb", "depth", "mask")),
    (NEAREST, "truth", "truth.npy"), (HAND, "hand", "hand.json"), (HAND, "hand-mask", "arm.png"),
    (NETWORK, "checkpoint", "net.safetensors"), (FOUND, "segmentation", "seg.safetensors"),
    (FOUND, "keypoint-network", "kpt.safetensors"), (GENERATE, "recordings", "recordings"),
    (GENERATE, "backgrounds", "photos"), (TRAIN, "data", "data"),
    (TRAIN, "start-from", "net.safetensors"), (TRAIN, "masks", "seg.safetensors"),
    (TRAIN, "keypoints", "kpt.safetensors"), (EVALUATE, "", "net.safetensors"),
    (EVALUATE, "data", "data"), (EVALUATE, "masks", "seg.safetensors"),
    (EVALUATE, "keypoints", "kpt.safetensors"), (CALIBRATE, "", "plus.safetensors"),
    (REPLAY, "replay", "log.npz"), (AGAIN, "again", "result.json"), (VIEW, "", "restored"),
)
#: What stands there instead of a right file or folder.
WRONG = ("missing", "folder", "loop", "fifo", "->/dev/null", "->/dev/zero", "->nowhere",
         "copy rgb.png", "copy hand.json", "copy truth.npy", "pickle")
#: Readers, and a file each: those whose bytes are checked by a sum, and those that have none.
READERS = (
    ("read_color", "rgb.png", True), ("read_color", "rgb.jpg", False),
    ("read_depth", "depth.png", True), ("read_depth", "truth.npy", False),
    ("read_depth", "depth.exr", False), ("read_mask", "mask.png", True),
    ("read_mask", "mask.npy", False), ("read_hand", "hand.json", False),
    ("read_hand", "hand.txt", False), ("read_hand", "hand.npy", False),
    ("load_intrinsics", "camera.json", False), ("load_intrinsics", "camera.yaml", False),
    ("load_checkpoint", "net.safetensors", True), ("load_training_state", "last.safetensors", True),
    ("read_run_log", "log.npz", False), ("load_states", "states.npz", False),
    ("read_recording", "recording.csv", False), ("read_result_file", "result.json", True),
    ("read_sealed", "result.json", True),
)
#: Where a cut file may still be a whole one: text without an end.
ENDLESS = ("camera.yaml", "hand.txt", "recording.csv")
NUMBER: tuple[Any, ...] = (None, "x", [], {}, True, NAN, INF, -1, 0, 1e308, HUGE, "@DROP")
SIZE: tuple[Any, ...] = (*NUMBER, 224.5, "64", 10**7)
TEXT: tuple[Any, ...] = (None, 7, [], {}, "x", "", DEEP)
#: Fields of JSON files: the call that reads the file, the file, the field, values that are wrong.
FIELDS: tuple[tuple[Call, str, str, tuple[Any, ...]], ...] = (
    *((NEAREST, "camera.json", name, NUMBER) for name in ("fx", "fy")),
    *((NEAREST, "camera.json", name, (*NUMBER[:7], 1e308, HUGE, "@DROP"))
      for name in ("cx", "cy")),
    *((NEAREST, "camera.json", name, SIZE) for name in ("width", "height")),
    (NEAREST, "camera.json", "", (None, "x", [], {}, 7, DEEP)),
    (HAND, "hand.json", "", (*NUMBER, DEEP, [[0, 0, 1]] * 20, [[0, 0, 1]] * 22, [[0, 0]] * 21)),
    (HAND, "hand.json", "7", (*NUMBER[:-1], [0, 0], [0, 0, 0, 1], [0, 0, NAN], [0, 0, HUGE])),
    (HAND, "hand.json", "7.2", (None, "x", [], {}, True, NAN, INF, 1e308, HUGE, DEEP)),
)
LOG = "data/test/0000/depth/log_json/000032.json"
LOG_FIELDS = (
    ("camera point", (None, "x", [], {}, 7, [1, 2], [1, 2, NAN], [1, 2, HUGE], DEEP, "@DROP")),
    ("camera angle", (None, "x", [], {}, 7, [1, 2], [1, 2, INF], [1, 2, HUGE], DEEP, "@DROP")),
    ("camera internal", ("x", [], {}, 7, [[1, 2]], [[NAN] * 3] * 3, [[HUGE] * 3] * 3, DEEP)),
    ("camera internal.0.0", (None, "x", -1, 0, NAN, INF, 1e308, HUGE, 1e-9)),
    ("hand_keypoint", (None, "x", [], {}, 7, DEEP, "@DROP")),
    ("hand_keypoint.wrist", (None, "x", [], 7, [1, 2], [1, 2, NAN], [1, 2, HUGE], "@DROP")),
    ("depth_png scale", (None, "x", [], True, NAN, INF, 0, -1, 1e308, HUGE, DEEP)),
    ("world_from_object", (None, "x", [], 7, [[NAN] * 4] * 4, [[0] * 4] * 4, [[HUGE] * 4] * 4)),
    ("hold_id", (7, [], {}, DEEP)),
    ("", (None, [], "x", 7, DEEP)),
)


def record_fields() -> Iterator[tuple[Call, str, str, tuple[Any, ...]]]:
    """Wrong values for the fields of a checkpoint's record that somebody reads."""
    wrong: tuple[Any, ...] = (None, "x", [], {}, NAN, -1, HUGE)
    for call, name in ((NETWORK, "net.safetensors"), (PLUS, "plus.safetensors")):
        sample = "hadr-imagenet" if call is NETWORK else "hadr-plus-imagenet"
        path = CHECKOUT / f"data_samples/checkpoints/{sample}.json"
        model = json.loads(path.read_text(encoding="utf-8"))["model"]
        for key in model:
            yield call, name, f"model.{key}", (*wrong[1:], "@DROP")
        yield call, name, "", (*wrong, 7, DEEP)
        yield call, name, "model", (*wrong, "@DROP")
        yield call, name, "network", ("x", [], {}, 7)
        for key in ("width", "height"):
            yield call, name, key, (*wrong, 0, 1.5, 10**7, True, "@DROP")
        yield call, name, "data", ("x", [], 7)
        yield call, name, "data.corruption", (*wrong[1:], 7, None)
    name = "plus.safetensors"
    yield PLUS, name, "learned_range", ("x", [], {}, 7)
    yield PLUS, name, "learned_range.depth_m", (
        None, "x", [], {}, 7, [1], [2.0, 0.3], [NAN, 1], [INF, INF], [-2, -1], [0.3, HUGE])
    yield PLUS, name, "confidence.center", (None, "x", [], {}, True, NAN, HUGE, [7], "@DROP")
    yield PLUS, name, "confidence.scale", (None, "x", [], {}, True, NAN, HUGE, -1, 0, [7], "@DROP")
    yield PLUS, name, "confidence.calibration", (None, "x", [], {}, 7, [NAN], "@DROP")


#: Numbers given on the command line: the call, the option, values that are wrong.
WORD = ("abc", "", "1e")
REAL = (*WORD, "nan", "inf", "-inf", "-1", "1e309")
SEEDS = (*WORD, "-1", "1.5", "nan")
WHOLE = (*SEEDS, "9" * 30)
OPTIONS = (
    (NEAREST, "depth-scale", (*REAL, "0", "1e308", "1e-300", "1000")),
    (NEAREST, "method", ("foo", "", "Nearest", "hadr nearest")),
    (NETWORK, "corruption", ("foo", "")),
    (GENERATE, "frames", (*WHOLE, "0", "1000000000")),
    (GENERATE, "width", (*WHOLE, "0", "1", "10000000")),
    (GENERATE, "height", (*WHOLE, "0", "1", "10000000")),
    (GENERATE, "seed", SEEDS), (GENERATE, "samples", (*WHOLE, "0")),
    (GENERATE, "workers", (*WHOLE, "0", "1000000")),
    (GENERATE, "frames-per-hold", (*REAL, "0", "0.1")), (GENERATE, "hold-shift", WHOLE),
    (GENERATE, "jpeg", (*WHOLE, "0", "101")), (GENERATE, "rest-step", (*REAL, "0", "100")),
    (GENERATE, "objects", ("9999", "", "0", "0000\t0000", "../0000", "0002")),
    (GENERATE, "engine", ("foo", "")), (GENERATE, "split-by", ("foo", "")),
    (GENERATE, "normals", ("foo",)), (GENERATE, "preset", ("foo", "")),
    (TRAIN, "epochs", (*WHOLE, "0")), (TRAIN, "drop-epoch", (*WORD, "1.5", "-1")),
    (TRAIN, "batch-size", (*WHOLE, "0")), (TRAIN, "learning-rate", (*REAL, "0")),
    (TRAIN, "keypoint-noise", REAL), (TRAIN, "seed", SEEDS),
    (TRAIN, "objects", ("9999", "", "../0000", "0000\t9999", "0000\t0000")),
    (TRAIN, "pretrained", ("foo", "", "../net.safetensors")), (TRAIN, "network", ("foo", "")),
    (TRAIN, "preset", ("foo",)), (TRAIN, "schedule", ("foo",)), (TRAIN, "precision", ("16",)),
    (TRAIN, "accelerator", ("tpu", "")), (TRAIN, "hand", ("4d",)), (TRAIN, "corruption", ("foo",)),
    (TRAIN, "data", ("data\tnowhere", "data\tdata", "")),
    (EVALUATE, "data", ("data\tnowhere", "data\tdata", "")),
    (EVALUATE, "objects", ("9999", "", "../0000", "0000\t9999", "0000\t0000")),
    (EVALUATE, "split", ("foo", "")), (EVALUATE, "corruption", ("foo",)),
    (EVALUATE, "seed", SEEDS), (EVALUATE, "", ("net.safetensors\tnowhere", "")),
    (CALIBRATE, "", ("plus.safetensors\tdata\tnowhere", "plus.safetensors\tdata\tdata")),
    (CALIBRATE, "objects", ("9999", "", "../0000")), (CALIBRATE, "seed", SEEDS),
    (CALIBRATE, "test-objects", ("9999", "")), (CALIBRATE, "corruption", ("foo",)),
    (HANDOVER, "conditions", ("foo", "", "raw\tfoo", "raw\traw")), (HANDOVER, "seed", SEEDS),
    (HANDOVER, "objects", ("9999", "", "../0004", "0004\t0004")),
    (HANDOVER, "holds", (*WHOLE, "902\t902")), (HANDOVER, "jobs", (*WHOLE, "0")),
    (HANDOVER, "hand-speed", (*REAL, "1000")), (HANDOVER, "extrinsics-error", (*REAL[:-1], "400")),
    (HANDOVER, "picture-rate", (*REAL, "0", "30", "100")), (HANDOVER, "latency", (*REAL, "0.13", "3")),
    (REPRODUCE, "seed", SEEDS), (REPRODUCE, "seeds", (*SEEDS, "0\t-1", "0\t0")),
    (REPRODUCE, "jobs", (*WHOLE, "0")), (REPRODUCE, "only", ("99", "", "foo/bar", "known/foo")),
    (REPRODUCE, "preset", ("foo",)), (REPRODUCE, "accelerator", ("tpu",)),
    (REPRODUCE, "corruption", ("foo",)), (REPRODUCE, "data", ("nowhere", "rgb.png", "")),
    (AGAIN, "again", ("result.json\tfoo", "result.json\t")),
    (BOOK, "preset", ("foo", "")), (BOOK, "seed", ("abc", "", "1.5")),
    (HTML, "only", ("99", "", "../03")), (COURSE, "only", ("99", "", "../03", "-1")),
    (COURSE, "preset", ("foo", "")), (COURSE, "seed", (*WORD, "1.5", "-1")),
    (VIEW, "", ("nowhere", "", "folder", "frames")), (HAND_MODEL, "version", ("0.10.20", "", "x")),
    (EXECUTED, "executed", ("nowhere", "", "rgb.png", "folder")),
)
#: Where each command writes: the call, its option.
WRITES = ((NEAREST, "out"), (GENERATE, "out"), (TRAIN, "out"), (EVALUATE, "out"),
          (CALIBRATE, "out"), (HANDOVER, "out"), (ATTEMPT, "json"), (REPRODUCE, "out"),
          (COURSE, "out"), (HTML, "build"), (VIEW, "out"), (HAND_MODEL, "out"))
#: What lies where the result should go, and the edits that put it there.
PLACES = (
    ("", "", ()), ("a file in its path", "taken/out", (("taken", "text", "mine"),)),
    ("a file or folder of mine", "taken", (("taken", "text", "mine"),
                                           ("more/note.txt", "text", "mine"))),
    ("a fifo", "pipe", (("pipe", "replaced", "fifo"),)), ("too long", "x" * 300, ()),
    ("a loop", "round", (("round", "replaced", "loop"),)),
    ("a link to a file of mine", "link", (("taken", "text", "mine"),
                                          ("link", "replaced", "->taken"))),
    ("an input", "rgb.png", ()),
)
UNUSUAL = ("mit Leerzeichen", "ünïcödé 杯", "quote'\"s", "new\nline", "-dash", "a=b", "%s{x}$HOME",
           "* ?")
NOISE = (*(("flip", n) for n in range(4)), *(("flip-head", n) for n in range(3)),
         *(("cut", n) for n in range(5)), ("junk", 0), ("zeros", 0), ("hole", 0), ("hole", 1))


def shown(value: Any) -> str:
    text = "10**400" if value == HUGE else repr(value)
    return text if len(text) < 40 else f"{text[:37]}..."


def all_cases() -> list[Case]:
    """Every bad input, each with a name of its own."""
    from break_it.found import FOUND_ONE_BY_ONE

    made = [call.case("right", "as it should be", expect="works") for call in RIGHT]
    for call, option, file in READ:
        old = call.options.get(option, "")
        given = {option: None if not option else old.replace(file, "") + file}
        changes: dict[str, Any] = {"says": (file, option or file), **(given if option else {})}
        if file.startswith(f"{old}/"):  # one of a folder's files: the others are restored
            changes = {"expect": "partly", "says": ("1 of 3",)}
        for wrong in WRONG:
            if wrong == f"copy {file}" or ("/" in file and "copy" in wrong):
                continue
            made.append(call.case("wrong file", f"--{option} {file}: {wrong}",
                                  (file, "replaced", wrong), **changes))
        for text in ("", "no number at all\n", DEEP, '{"a": ' * 50, "\x00\x01"):
            edits = ((file, "replaced", "missing"), (file, "text", text))
            made.append(call.case("wrong text", f"--{option} {file}: {text[:12]!r}", *edits,
                                  **changes))
        edits = ((file, "unreadable"),)
        made.append(call.case("unreadable", f"--{option} {file}", *edits, **changes))
    for reader, file, summed in READERS:
        one = Case("", reader, "", (file,), says=(file,))
        for wrong in WRONG:
            # A picture is known by its content: a PNG that is called .jpg is a right one.
            if wrong != f"copy {file}" and (file, wrong) != ("rgb.jpg", "copy rgb.png"):
                made.append(also(one, "wrong file", wrong, (file, "replaced", wrong)))
        for how, seed in NOISE:
            sure = summed or how in ("junk", "zeros") or (how == "cut" and file not in ENDLESS)
            made.append(also(one, "noise", f"{how} {seed}", (file, "noise", how, seed),
                             expect="refused" if sure else "safe"))
    fields = [(c, f, n, v, f) for c, f, n, v in (*FIELDS, *record_fields())]
    fields += [(EVALUATE, LOG, n, v, LOG) for n, v in LOG_FIELDS]
    for call, file, name, values, says in fields:
        for value in values:
            edits = ((file, "field", name, value),)
            words = {"hand": file} if file == "hand.json" else {}
            made.append(call.case("field", f"{file}: {name or 'all'} = {shown(value)}", *edits,
                                  says=(Path(says).name, name.split(".")[-1]), **words))
    for call, option, values in OPTIONS:
        for value in values:
            made.append(call.case("option", f"--{option} {value!r}", **{option: value},
                                  says=(option, option.rstrip("s"), value.split("\t")[-1] or "''")))
    for call, option in WRITES:
        for name, out, edits in PLACES:
            may = ("plus.json", "plus.safetensors") if call is CALIBRATE else ()
            made.append(call.case("place", f"--{option}: {name or 'no name'}", *edits, may=may,
                                  **{option: out}, says=(out.split("/")[0] or "empty", "name")))
    for call, option in WRITES[:1] + WRITES[3:4] + WRITES[5:7]:
        for name in UNUSUAL:
            renamed = dataclasses.replace(call, out=(name,))
            made.append(renamed.case("unusual name", f"--{option}={name}", expect="works",
                                     **{option: None}))
            made[-1] = dataclasses.replace(made[-1], words=(*made[-1].words, f"--{option}={name}"))
    made += FOUND_ONE_BY_ONE
    return list({(c.command, c.kind, c.name, c.words): c for c in made}.values())


def also(case: Case, kind: str, name: str, *edits: tuple[Any, ...], expect: str = "refused") -> Case:
    file = case.words[0]
    return dataclasses.replace(case, kind=kind, name=f"{file}: {name}", edits=edits, expect=expect)
