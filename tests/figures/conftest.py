"""Figures are drawn without a screen, and closed after each test."""

import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest

mpl.use("Agg")


@pytest.fixture(autouse=True)
def _close_figures():
    yield
    plt.close("all")


@pytest.fixture
def ax():
    """Axes that are rendered after the test, so that what cannot be drawn is noticed."""
    fig, axes = plt.subplots()
    yield axes
    fig.canvas.draw()
