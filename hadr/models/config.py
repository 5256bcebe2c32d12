"""What all networks' configurations have in common: the way to JSON and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Self

from hadr.records.reading import structured


class NetworkConfig:
    """Base of a network's configuration, a frozen dataclass of numbers, words, tuples and parts."""

    def to_dict(self) -> dict[str, Any]:
        """The configuration as built-in types, for JSON."""
        return asdict(self)  # type: ignore[call-overload, no-any-return]

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], where: str = "model") -> Self:
        """Build it from `to_dict`, or the same read from JSON; a ValueError names what is wrong."""
        config = structured(values, cls, where)
        for name, value in vars(config).items():
            if isinstance(value, int | float) and value < 0:
                raise ValueError(f"{where}: {name} must not be negative, got {value}")
        return config
