"""Where the repository is found, from its own checkout and from a wheel."""

from pathlib import Path

import pytest

from hadr.records import checkout
from hadr.records.checkout import checkout_root

ROOT = Path(__file__).resolve().parents[2]


def test_the_librarys_own_checkout_comes_first(monkeypatch, tmp_path):
    monkeypatch.setenv("HADR_SAMPLES", str(tmp_path))
    assert checkout_root() == ROOT


def test_a_wheel_takes_the_checkout_whose_samples_are_named(monkeypatch, tmp_path):
    monkeypatch.setattr(checkout, "__file__", str(tmp_path / "site" / "hadr" / "checkout.py"))
    monkeypatch.delenv("HADR_SAMPLES", raising=False)
    with pytest.raises(FileNotFoundError, match="set HADR_SAMPLES to its folder data_samples"):
        checkout_root()
    monkeypatch.setenv("HADR_SAMPLES", str(ROOT / "data_samples"))
    assert checkout_root() == ROOT
    (tmp_path / "alone" / "data_samples").mkdir(parents=True)
    monkeypatch.setenv("HADR_SAMPLES", str(tmp_path / "alone" / "data_samples"))
    with pytest.raises(FileNotFoundError, match="which is in no checkout of the repository"):
        checkout_root()
