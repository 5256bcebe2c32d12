"""Networks written to ONNX files and run by ONNX Runtime: the same result, sooner (optional).

ONNX Runtime knows the whole graph before it runs it: what does not depend on the input (attention
masks, position biases) is computed once, and neighbouring operations are fused. Optionally the
matrix products are done in 8-bit integers: weights rounded once, activations by their range in each
frame. This needs the packages of the extra "onnx" and is for inference only; nothing in this
library requires it.
"""

from __future__ import annotations

import contextlib
import copy
import importlib.util
import logging
import os
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
import torch
from torch import Tensor, nn

from hadr.models.backbone import ColorBackbone
from hadr.models.enlarged_map import EnlargedMap

Network = TypeVar("Network", bound=nn.Module)


class ExportedNetwork:
    """A network from an ONNX file: one tensor in, one tensor out.

    Args:
        path: The file that `export_network` wrote.
        threads: CPU threads; None takes as many as torch does.

    Raises:
        FileNotFoundError: There is no such file.
        ImportError: ONNX Runtime is not installed.
    """

    def __init__(self, path: str | Path, threads: int | None = None) -> None:
        require_onnx("onnxruntime")
        import onnxruntime

        if not Path(path).is_file():
            raise FileNotFoundError(f"there is no exported network at {path}")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads or torch.get_num_threads()
        options.log_severity_level = 3
        self.session = onnxruntime.InferenceSession(
            str(path), options, providers=["CPUExecutionProvider"]
        )
        (self.input,) = self.session.get_inputs()
        self.shape = tuple(self.input.shape)

    def __call__(self, values: Tensor) -> Tensor:
        """Run the network.

        Args:
            values: float32, of the shape with which it was exported.

        Raises:
            ValueError: The shape is another one.
        """
        if tuple(values.shape) != self.shape:
            raise ValueError(
                f"the network was exported for {self.shape}, got {tuple(values.shape)}"
            )
        (result,) = self.session.run(None, {self.input.name: np.ascontiguousarray(values)})
        return torch.from_numpy(result)


def export_network(
    network: nn.Module, shape: tuple[int, ...], path: str | Path, *, integers: bool = False
) -> Path:
    """Write a network to an ONNX file.

    Args:
        network: Takes one tensor and returns one; it is exported in evaluation mode.
        shape: Shape of its input, the batch included; the file serves this shape alone.
        path: The file to write; written whole or not at all.
        integers: Do the matrix products with 8-bit weights and activations.

    Returns:
        The path.

    Raises:
        ImportError: The packages of the extra "onnx" are not installed.
    """
    require_onnx("onnx", "onnxscript", "onnxruntime")
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    modes = {module: module.training for module in network.modules()}
    with tempfile.TemporaryDirectory(dir=path.parent) as folder, _quiet(), torch.no_grad():
        made = Path(folder) / "network.onnx"
        try:
            program = torch.onnx.export(
                network.eval(), (torch.zeros(shape),), dynamo=True, verbose=False
            )
        finally:
            for module, mode in modes.items():
                module.training = mode
        cast(Any, program).save(made)
        if integers:
            from onnxruntime.quantization import QuantType, quantize_dynamic

            folded, exact = Path(folder) / "folded.onnx", made
            made = Path(folder) / "integers.onnx"
            _fold_constants(exact, folded)
            # Seven bits: without VNNI instructions the products of eight would overflow.
            quantize_dynamic(
                folded,
                made,
                op_types_to_quantize=["MatMul", "Gemm"],
                per_channel=True,
                reduce_range=True,
                weight_type=QuantType.QInt8,
            )
        os.replace(made, path)
    return path


def _fold_constants(source: Path, target: Path) -> None:
    """Compute what does not depend on the input: products of weights are no layers."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC
    options.optimized_model_filepath = str(target)
    options.log_severity_level = 3
    onnxruntime.InferenceSession(str(source), options, providers=["CPUExecutionProvider"])


class _Coarse(nn.Module):
    """The part of the backbone that is worth exporting, as a network of its own."""

    def __init__(self, backbone: ColorBackbone) -> None:
        super().__init__()
        self.backbone = backbone

    def forward(self, color: Tensor) -> Tensor:
        return self.backbone.coarse(color)


class ExportedBackbone(nn.Module):
    """Stands where a `ColorBackbone` stood; frames go through it one at a time.

    Args:
        network: The exported backbone.
        patch: Side of a cell of its map, pixels.
    """

    def __init__(self, network: ExportedNetwork, patch: int) -> None:
        super().__init__()
        self.network, self.patch = network, patch

    def coarse(self, color: Tensor) -> Tensor:
        """As `ColorBackbone.coarse`."""
        return torch.cat([self.network(frame[None]) for frame in color])

    def features(self, color: Tensor) -> EnlargedMap:
        """As `ColorBackbone.features`."""
        return EnlargedMap(self.coarse(color), color.shape[2], color.shape[3], self.patch)

    def forward(self, color: Tensor) -> Tensor:
        """As `ColorBackbone.forward`."""
        return self.features(color).dense()


def export_backbone(
    model: nn.Module, size: tuple[int, int], path: str | Path, *, integers: bool = False
) -> Path:
    """Write the backbone of a depth network to an ONNX file.

    Args:
        model: A network with a `ColorBackbone` named `backbone`, e.g. `HADR`.
        size: (width, height) of the frames in pixels.
        path: The file to write.
        integers: As in `export_network`.

    Returns:
        The path.
    """
    width, height = size
    return export_network(_Coarse(_backbone(model)), (1, 3, height, width), path, integers=integers)


def with_exported_backbone(model: Network, path: str | Path, threads: int | None = None) -> Network:
    """Give a copy of a depth network, for inference, whose backbone is an exported one.

    Args:
        model: The network; it stays as it is, and shares its other weights with the copy.
        path: The file that `export_backbone` wrote.
        threads: CPU threads of the backbone; None takes as many as torch does.
    """
    backbone = _backbone(model)
    memo: dict[int, Any] = {id(p): p for p in [*model.parameters(), *model.buffers()]}
    memo[id(backbone)] = ExportedBackbone(ExportedNetwork(path, threads), backbone.config.patch)
    return copy.deepcopy(model, memo).eval()


def _backbone(model: nn.Module) -> ColorBackbone:
    backbone = getattr(model, "backbone", None)
    if not isinstance(backbone, ColorBackbone):
        raise ValueError(
            f"{type(model).__name__} has no colour backbone, but {type(backbone).__name__}"
        )
    return backbone


def require_onnx(*packages: str) -> None:
    """Check that optional packages are there.

    Raises:
        ImportError: One is missing; the message says how to get it.
    """
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    if missing:
        raise ImportError(
            f"exported networks need {', '.join(missing)}; install them with: "
            'pip install "hadr[onnx]"'
        )


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep the exporter's remarks on its own workings from the user."""
    loggers = [logging.getLogger(name) for name in ("torch.onnx", "onnxscript", "root")]
    levels = [logger.level for logger in loggers]
    try:
        for logger in loggers:
            logger.setLevel(logging.ERROR)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
