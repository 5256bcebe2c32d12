"""What all networks' configurations have in common: the way to JSON and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Self

import cattrs

_CONVERTER = cattrs.Converter(forbid_extra_keys=True, detailed_validation=False)


class NetworkConfig:
    """Base of a network's configuration, a frozen dataclass of numbers, words, tuples and parts."""

    def to_dict(self) -> dict[str, Any]:
        """The configuration as built-in types, for JSON."""
        return asdict(self)  # type: ignore[call-overload, no-any-return]

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Build the configuration from `to_dict`, or from the same read from JSON.

        Raises:
            ValueError: A value is of the wrong kind, missing, or unknown.
        """
        try:
            return _CONVERTER.structure(values, cls)
        except (KeyError, TypeError, cattrs.ForbiddenExtraKeysError) as error:
            raise ValueError(f"no configuration of a network: {error}") from error
