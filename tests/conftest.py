"""Fixtures that every part of the suite shares."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

REALDATA = Path(__file__).resolve().parents[2] / "shared" / "realdata"


@pytest.fixture(scope="session")
def realdata() -> Path:
    """The folder of real recordings, beside the project; they are not part of it."""
    if not REALDATA.is_dir():
        pytest.skip(
            "real recordings not found: put ClearGrasp's D435 scenes, the RealSense calibrations "
            "and the UR5 reference into ../shared/realdata, beside the project's folder"
        )
    return REALDATA


# A check that passes twice or never: the same examples each time where a machine judges.
settings.register_profile("ci", derandomize=True, deadline=None)
if os.environ.get("CI"):
    settings.load_profile("ci")
