"""Checkpoints: the weights and how they came about, in one file that is whole or not there.

A checkpoint is a safetensors file. Its header holds the network's configuration and the record of
its training as JSON; the `.json` file beside it is the same record for human eyes. Both are
written to a temporary file first and renamed, so a crash never leaves half a file under the name.
The record holds a checksum of itself and of all tensors; a file without it is refused.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field, is_dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, TypeVar

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from hadr.confidence.calibration import ConfidenceRule
from hadr.confidence.known_ground import Ground
from hadr.corruption import CORRUPTIONS, Corruption
from hadr.models.networks import NETWORKS
from hadr.records.provenance import IF_CHANGED, plain, write_json
from hadr.records.reading import check_size, parse_json, structured
from hadr.records.writing import write_whole

_CHECKSUM = "sha256"
_HEADER = "hadr"
_LARGEST = 16384
_STATE = "training/"  # prefix of tensors that only a resumed training needs
STEP = "step/"
"""Prefix of the steps of weights that are stored as 8-bit integers."""

Network = TypeVar("Network", bound=nn.Module)
Stored = Literal["float32", "float16", "int8"]
"""How weights are stored; by "int8" those with an output axis are, each output with a step of its
own, and the others by "float16"."""


@dataclass(frozen=True)
class _LearnedRange:
    """Nearest and farthest depth that a training has shown, metres."""

    depth_m: tuple[float, float]

    def __post_init__(self) -> None:
        near, far = self.depth_m
        if not 0 <= near < far:
            raise ValueError(f"depth_m must be two rising depths in metres, got {self.depth_m}")


@dataclass(frozen=True)
class _Record:
    """What each checkpoint's record must say, and what it may; there is more in it."""

    network: str
    model: dict[str, Any]
    width: int
    height: int
    sha256: str
    data: dict[str, Any] | None = field(default=None, metadata=IF_CHANGED)
    preset: dict[str, Any] | None = field(default=None, metadata=IF_CHANGED)
    learned_range: _LearnedRange | None = field(default=None, metadata=IF_CHANGED)

    def __post_init__(self) -> None:
        if self.network not in NETWORKS:
            known = ", ".join(NETWORKS)
            raise ValueError(f"network must be one of {known}, got {self.network!r}")
        for name in ("width", "height"):
            if not 1 <= getattr(self, name) <= _LARGEST:
                raise ValueError(f"{name} must be 1 to {_LARGEST}, got {getattr(self, name)}")


def save_checkpoint(
    path: str | Path,
    model: nn.Module,
    meta: Mapping[str, Any],
    *,
    stored: Stored = "float32",
    training_state: Mapping[str, Tensor] | None = None,
) -> None:
    """Write a checkpoint, `.safetensors`, and the record beside it, `.json`.

    The record is `meta` with "network", the network's kind, and "model", its configuration;
    `training_state` are further tensors that a resumed training needs. ValueError for another name
    or an unknown network.
    """
    path = Path(path)
    if path.suffix != ".safetensors":
        raise ValueError(f"a checkpoint's name must end with .safetensors, got {path.name!r}")
    config: Any = model.config
    record = plain({**meta, "network": kind_of(model), "model": config.to_dict()})
    tensors = {}
    for name, values in model.state_dict().items():
        values = values.detach().cpu().contiguous()
        if stored == "float32" or not values.is_floating_point():
            tensors[name] = values
        elif stored == "int8" and values.ndim > 1:
            step = values.flatten(1).abs().amax(dim=1).clamp(min=1e-12) / 127  # (outputs,)
            tensors[name] = (values / _along(step, values)).round().to(torch.int8)
            tensors[STEP + name] = step
        else:
            tensors[name] = values.half()
    for name, values in (training_state or {}).items():
        tensors[_STATE + name] = values.detach().cpu().contiguous()

    _write(path, tensors, record)


def load_checkpoint(path: str | Path) -> tuple[Any, dict[str, Any]]:
    """Read a checkpoint of any network.

    Args:
        path: A `.safetensors` file that `save_checkpoint` wrote.

    Returns:
        The network with 32-bit weights, ready for inference (`HADR`, or the class of the kind that
        the record's key "network" names), and its record.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is cut off or damaged, its weights or its record are not those that
            were written; or weights are no numbers, or the record lacks a field or has a wrong one.
    """
    tensors, meta = _read(Path(path))
    kind = meta["network"]
    config = NETWORKS[kind].config_class().from_dict(meta["model"], f"{path}: model")
    try:
        trained_corruption(meta)
        if NETWORKS[kind].can_say and meta.get("confidence") is not None:
            ConfidenceRule.from_dict(meta["confidence"])
        if meta.get("ground") is not None:
            Ground.from_dict(meta["ground"])
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    try:
        model = NETWORKS[kind].network_class()(_without_download(config))
    except (RuntimeError, ValueError, IndexError, ZeroDivisionError) as error:
        raise ValueError(f"{path}: its model is no network that can be: {error}") from error
    weights = {}
    for name, values in tensors.items():
        if name.startswith((_STATE, STEP)):
            continue
        step = tensors.get(STEP + name)
        if step is not None:
            weights[name] = values * _along(step, values)
        else:
            weights[name] = values.float() if values.is_floating_point() else values
    for name, values in weights.items():
        if not bool(torch.isfinite(values).all()):
            raise ValueError(f"{path} holds weights that are no numbers, in {name}")
    try:
        model.load_state_dict(weights)
    except RuntimeError as error:
        wanted = model.state_dict()
        other = [n for n in wanted if n in weights and wanted[n].shape != weights[n].shape]
        raise ValueError(
            f"{path} does not fit its own configuration: of {len(wanted)} weights "
            f"{len(wanted.keys() - weights.keys())} are missing and {len(other)} of another size, "
            f"and {len(weights.keys() - wanted.keys())} have unknown names (is transformers as new "
            "as pyproject.toml asks for?)"
        ) from error
    model.eval()
    return model, meta


def load_kind(path: str | Path, kind: str) -> tuple[Any, tuple[int, int]]:
    """Load a network of one kind for inference, with the (width, height) it was trained at.

    ValueError where it is one of another kind; else errors as `load_checkpoint`.
    """
    model, meta = load_checkpoint(path)
    if meta["network"] != kind:
        raise ValueError(f"{path} holds a network of kind {meta['network']!r}, expected {kind!r}")
    return for_inference(model), (int(meta["width"]), int(meta["height"]))


def for_inference(network: Network) -> Network:
    """Copy a network, in evaluation mode, with batch normalisation folded into convolutions.

    A normalisation that is registered right after a convolution is taken to follow it, as it does
    in all networks of this package. Weights of convolutions lie channels last. Answers agree but
    for rounding; on a CPU they need less time (``benchmarks/speed/perception.py``).
    """
    network = deepcopy(network).eval()
    for module in list(network.modules()):
        for (name, conv), (after, norm) in pairwise(module.named_children()):
            if isinstance(conv, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
                module.register_module(name, fuse_conv_bn_eval(conv, norm))
                module.register_module(after, nn.Identity())
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    return network


def _along(step: Tensor, weights: Tensor) -> Tensor:
    """The steps (outputs,) in the shape that multiplies weights (outputs, ...)."""
    return step.view(-1, *[1] * (weights.ndim - 1))


def kind_of(model: nn.Module) -> str:
    """Give the kind of a network, such as "hadr"; ValueError where it is of no known kind."""
    for kind, network in NETWORKS.items():
        if type(model).__name__ == network.network:
            return kind
    raise ValueError(f"{type(model).__name__} is none of the networks {', '.join(NETWORKS)}")


def trained_corruption(meta: Mapping[str, Any]) -> Corruption:
    """Read from a checkpoint's record of which corruption it learned; ValueError if of none."""
    stored = (meta.get("data") or {}).get("corruption", meta.get("corruption", "oracle"))
    for name in CORRUPTIONS:
        if name == str(stored).partition(":")[0]:
            return name
    raise ValueError(f"corruption must be one of {', '.join(CORRUPTIONS)}, got {stored!r}")


def update_record(path: str | Path, additions: Mapping[str, Any]) -> dict[str, Any]:
    """Add to a checkpoint's record, in it and beside it; give it. Tensors keep their bytes.

    Errors as `load_checkpoint`.
    """
    path = Path(path)
    tensors, meta = _read(path)
    record: dict[str, Any] = plain({**meta, **additions})
    _write(path, tensors, record)
    return record


def load_training_state(path: str | Path) -> dict[str, Tensor]:
    """Read the tensors that a resumed training needs; errors as `load_checkpoint`."""
    tensors, _ = _read(Path(path))
    return {n.removeprefix(_STATE): t for n, t in tensors.items() if n.startswith(_STATE)}


def _write(path: Path, tensors: dict[str, Tensor], record: dict[str, Any]) -> None:
    """Write checkpoint and record, each whole or not at all."""
    record[_CHECKSUM] = checksum(tensors, record)
    write_whole(path, save(tensors, metadata={_HEADER: json.dumps(record)}))
    write_json(path.with_suffix(".json"), record)


def _read(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """The tensors and the record, whose checksum and fields are checked."""
    if not path.is_file():
        raise FileNotFoundError(f"there is no checkpoint at {path}")
    check_size(path)
    try:
        with safe_open(path, framework="pt") as file:
            header = file.metadata() or {}
            if _HEADER not in header:
                raise ValueError(f"{path} is a safetensors file, but not a checkpoint of HADR")
            meta: dict[str, Any] = parse_json(header[_HEADER], f"the record of {path}")
            structured(meta, _Record, path, further=True)
            names = file.keys()
            tensors: dict[str, Tensor] = {name: file.get_tensor(name) for name in names}
    except (SafetensorError, OSError) as error:
        raise ValueError(
            f"{path} ({path.stat().st_size} bytes) is cut off or damaged, not a whole checkpoint: "
            f"{error}"
        ) from error
    if meta[_CHECKSUM] != checksum(tensors, meta):
        raise ValueError(
            f"{path} was damaged or changed: weights and record do not fit their checksum"
        )
    return tensors, meta


def read_record(path: str | Path) -> dict[str, Any]:
    """Read a checkpoint's record alone; errors as `load_checkpoint`."""
    return _read(Path(path))[1]


def checksum(tensors: Mapping[str, Tensor], record: Mapping[str, Any]) -> str:
    """SHA-256 of the record but for itself, and of the tensors' names, types, shapes, bytes."""
    rest = {name: value for name, value in record.items() if name != _CHECKSUM}
    digest = hashlib.sha256(json.dumps(rest, sort_keys=True).encode())
    for name in sorted(tensors):
        values = tensors[name].contiguous()
        digest.update(f"{name} {values.dtype} {tuple(values.shape)}".encode())
        digest.update(values.reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()


def _without_download(config: Any) -> Any:
    """Build without fetching published weights: they will be overwritten at once."""
    parts: dict[str, Any] = {}
    for name, value in vars(config).items():
        if name == "pretrained":
            # Older records say False where frozen weights had come from a file.
            parts[name] = None if value or getattr(config, "frozen", 0) else value
        elif is_dataclass(value):
            parts[name] = _without_download(value)
    return replace(config, **parts)


def adam_state(optimizer: torch.optim.Adam) -> dict[str, Tensor]:
    """Flatten Adam's moments to named tensors."""
    state = optimizer.state_dict()["state"]
    return {
        f"{number}/{name}": torch.as_tensor(value)
        for number, entry in state.items()
        for name, value in entry.items()
    }


def restore_adam(optimizer: torch.optim.Adam, tensors: Mapping[str, Tensor]) -> None:
    """Put the moments of `adam_state` back; an empty mapping leaves a fresh optimizer."""
    entries: dict[int, dict[str, Tensor]] = {}
    for key, value in tensors.items():
        number, name = key.split("/")
        entries.setdefault(int(number), {})[name] = value
    groups = optimizer.state_dict()["param_groups"]
    optimizer.load_state_dict({"state": entries, "param_groups": groups})
