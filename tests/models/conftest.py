"""Networks in double precision, for tests that compare two ways to one answer."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace

import pytest
from torch import nn

from hadr.models.hadr_input import HADRInput


def _in_double(network: nn.Module, inputs: HADRInput) -> tuple[nn.Module, HADRInput]:
    exact = {name: v.double() for name, v in vars(inputs).items() if v.is_floating_point()}
    return copy.deepcopy(network).double(), replace(inputs, **exact)


@pytest.fixture(scope="session")
def in_double() -> Callable[[nn.Module, HADRInput], tuple[nn.Module, HADRInput]]:
    """Gives a copy of a network, and frames, with numbers of 64 bits.

    What then differs by more than 1e-12 is no rounding, whatever the processor.
    """
    return _in_double
