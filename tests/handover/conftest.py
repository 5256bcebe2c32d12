"""One whole attempt in the physical world, made once for all tests of attempts."""

import pytest

from hadr.handover.trial import Run, Trial, run_trial

WHOLE = Trial("0010", 922, "perfect")


@pytest.fixture(scope="session")
def whole() -> Run:
    """An attempt with perfect depth that succeeds, from the first picture to the goal."""
    return run_trial(WHOLE)
