"""From a recipe to its task."""

from __future__ import annotations

import importlib

from hadr.training.recipe import Preset
from hadr.training.tasks.task import Task

_TASKS = {
    "hadr": ("hadr.training.tasks.hadr_task", "HADRTask"),
    "hadr-plus": ("hadr.training.tasks.hadr_plus_task", "HADRPlusTask"),
    "unet-hand": ("hadr.training.tasks.unet_hand_task", "UNetHandTask"),
    "lidf": ("hadr.training.tasks.lidf_task", "LIDFTask"),
    "dfnet": ("hadr.training.tasks.dfnet_task", "DFNetTask"),
    "swindrnet": ("hadr.training.tasks.swindrnet_task", "SwinDRNetTask"),
    "tode": ("hadr.training.tasks.tode_task", "TODETask"),
    "hand-keypoints": ("hadr.training.tasks.keypoint_task", "KeypointTask"),
    "segmentation": ("hadr.training.tasks.segmentation_task", "SegmentationTask"),
}


def task_module(network: str) -> str:
    """Dotted name of the module that trains a kind of network.

    Raises:
        ValueError: There is no such network.
    """
    if network not in _TASKS:
        raise ValueError(f"network must be one of {', '.join(_TASKS)}, got {network!r}")
    return _TASKS[network][0]


def task_of(recipe: Preset) -> Task:
    """Build the task of a recipe; its module is imported only now.

    Args:
        recipe: The recipe; its field `network` decides.

    Returns:
        The task.

    Raises:
        ValueError: There is no such network.
    """
    module = importlib.import_module(task_module(recipe.network))
    task: Task = getattr(module, _TASKS[recipe.network][1])(recipe)
    return task
