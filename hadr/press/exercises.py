"""Check cells for the book's exercises: is the learner right, plausibly wrong, or not done yet."""

import html
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

SHOWN = 4
"""So many numbers of a right answer are shown, where it has no more."""


@dataclass(frozen=True)
class Verdict:
    """What a check found; shows itself in a notebook and as text.

    Args:
        status: ``right``, ``wrong`` or ``open`` (not answered yet).
        message: One sentence for the learner.
    """

    status: Literal["right", "wrong", "open"]
    message: str

    def __bool__(self) -> bool:
        """Whether the answer is right."""
        return self.status == "right"

    def __str__(self) -> str:
        """The mark and the sentence, as plain text."""
        mark = {"right": "✓", "wrong": "✗", "open": "…"}[self.status]
        return f"{mark} {self.message}"

    def _repr_html_(self) -> str:
        # with a paper of its own, so that it is read on dark pages, too
        color, paper = {
            "right": ("#00604c", "#e2f3ee"),
            "wrong": ("#963a00", "#fdeee2"),
            "open": ("#4d4d4d", "#f0f0f0"),
        }[self.status]
        style = f"color:{color};background:{paper};padding:0.2em 0.6em;font-weight:600"
        return f'<p style="{style}">{html.escape(str(self))}</p>'


def _as_array(value: Any) -> npt.NDArray[Any] | None:
    try:
        array = np.asarray(value.detach().cpu() if hasattr(value, "detach") else value)
    except (TypeError, ValueError):
        return None
    return array if array.dtype.kind in "biufc" else None


def _close(answer: npt.NDArray[Any], expected: npt.ArrayLike, rtol: float, atol: float) -> bool:
    same = answer.shape == np.shape(expected)
    return same and bool(np.allclose(answer, expected, rtol=rtol, atol=atol, equal_nan=True))


def _same_words(answer: Any, expected: Any) -> bool:
    try:
        given, target = np.asarray(answer, dtype=object), np.asarray(expected, dtype=object)
    except (TypeError, ValueError):
        return False
    return given.shape == target.shape and bool(np.all(given == target))


def check(
    answer: Any,
    expected: npt.ArrayLike,
    *,
    rtol: float = 1e-6,
    atol: float = 1e-9,
    wrong: Iterable[tuple[npt.ArrayLike, str]] = (),
) -> Verdict:
    """Compare a learner's answer with the expected one. It never raises for an answer.

    Args:
        answer: What the learner computed; ``...`` means not answered yet.
        expected: The right number or array.
        rtol: Relative tolerance.
        atol: Absolute tolerance.
        wrong: Plausible wrong answers, each with a hint that says what went wrong there.

    Returns:
        The verdict, true where the answer is right.

    Raises:
        ValueError: ``wrong`` does not list pairs, whatever the answer is.
    """
    wrong = list(wrong)
    if not all(isinstance(pair, tuple) and len(pair) == 2 for pair in wrong):
        raise ValueError(f"wrong must list pairs (value, 'hint'), got {wrong!r}")
    if answer is ...:
        return Verdict("open", "Not answered yet: put your result in place of the three dots.")
    target = np.asarray(expected)
    if target.dtype.kind not in "biufc":
        if _same_words(answer, expected):
            return Verdict("right", "Right.")
        hints = (hint for value, hint in wrong if _same_words(answer, value))
        return Verdict("wrong", next(hints, f"Not {answer!r}."))
    array = _as_array(answer)
    if array is None:
        return Verdict("wrong", f"A number or an array is expected, not {type(answer).__name__}.")
    if array.shape != target.shape:
        return Verdict(
            "wrong", f"The shape is {array.shape}; {target.shape or 'one number'} is expected."
        )
    if _close(array, target, rtol, atol):
        few = array.size <= SHOWN and array.dtype.kind in "iuf"
        numbers = ", ".join(
            f"{v:.4g}" if abs(v) < 1e4 else f"{v:,.0f}" for v in array.ravel() if few
        )
        return Verdict("right", f"Right: {numbers}." if numbers else "Right.")
    for value, hint in wrong:
        if _close(array, value, rtol, atol):
            return Verdict("wrong", hint)
    if not np.isfinite(array.astype(complex)).all() and np.isfinite(target.astype(complex)).all():
        return Verdict("wrong", "The answer holds NaN or infinite values; it should not.")
    if array.size == 1:
        return Verdict("wrong", f"Not {array.item():.6g}. Check the units and the formula.")
    worst = float(np.nanmax(np.abs(array.astype(complex) - target.astype(complex))))
    return Verdict("wrong", f"Not yet: the largest difference from the answer is {worst:.3g}.")
