"""Where the repository lies: its chapters, its book and its result files are in no wheel."""

from __future__ import annotations

import os
from pathlib import Path


def checkout_root() -> Path:
    """The folder of the checkout that holds ``notebooks/``, ``book/`` and ``results/``.

    It is the one that the library was imported from. A library that was installed without its
    checkout, from a wheel, takes the one whose samples ``$HADR_SAMPLES`` names
    (`hadr.data.samples.samples_dir`).

    Raises:
        FileNotFoundError: There is neither; the message says what to do.
    """
    own = Path(__file__).resolve().parents[2]
    if (own / "notebooks").is_dir():
        return own
    samples = os.environ.get("HADR_SAMPLES")
    if not samples:
        raise FileNotFoundError(
            f"no folder 'notebooks' in {own}: chapters and result files are part of a checkout of "
            "the repository. Clone it and install it with `pip install -e .`, or set HADR_SAMPLES "
            "to its folder data_samples"
        )
    root = Path(samples).resolve().parent
    if not (root / "notebooks").is_dir():
        raise FileNotFoundError(
            f"HADR_SAMPLES names {samples!r}, which is in no checkout of the repository: there is "
            f"no folder 'notebooks' in {root}"
        )
    return root
