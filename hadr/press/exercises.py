"""Check cells for the book's exercises: is the learner right, plausibly wrong, or not done yet."""

import html
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

SHOWN = 4
"""So many numbers of a right answer are shown, where it has no more."""

NEARLY = 0.02
"""Within this share of the answer a wrong one is told that little is missing."""


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
        if isinstance(answer, (list, tuple)) and any(part is ... for part in answer):
            return Verdict("open", "Not finished yet: three dots are left in the answer.")
        return Verdict("wrong", f"A number or an array is expected, not {type(answer).__name__}.")
    if array.shape != target.shape:
        given, wanted = map(_in_words, (array.shape, target.shape))
        return Verdict("wrong", f"This is {given}; the answer is {wanted}.")
    if _close(array, target, rtol, atol):
        few = target.size <= SHOWN and target.dtype.kind in "iuf"
        shown = (0.0 if abs(v) <= atol else float(v) for v in target.ravel() if few)
        numbers = ", ".join(f"{v:.4g}" if abs(v) < 1e4 else f"{v:,.0f}" for v in shown)
        return Verdict("right", f"Right: {numbers}." if numbers else "Right.")
    near = max(rtol, NEARLY)
    for tolerance in (rtol, near):
        for value, hint in wrong:
            if _close(array, value, tolerance, atol):
                return Verdict("wrong", hint)
        if _close(array, target, near, atol):
            return Verdict("wrong", "Nearly: a digit more, or a small error is left.")
    if not np.isfinite(array.astype(complex)).all() and np.isfinite(target.astype(complex)).all():
        return Verdict("wrong", "The answer holds NaN or infinite values; it should not.")
    if target.any() and target.dtype.kind != "b":
        for factor in (-1.0, *(10.0**power for power in (1, 2, 3, 6, -1, -2, -3, -6))):
            if _close(array, factor * target, near, 0):
                slip = "check the sign" if factor < 0 else "check the unit"
                return Verdict("wrong", f"This is {factor:g} times the answer: {slip}.")
    if array.size == 1:
        advice = "Count again" if target.dtype.kind in "iu" else "Check the units and the formula"
        return Verdict("wrong", f"Not {array.item():.6g}. {advice}.")
    worst = float(np.nanmax(np.abs(array.astype(complex) - target.astype(complex))))
    return Verdict("wrong", f"Not yet: the largest difference from the answer is {worst:.3g}.")


def _in_words(shape: tuple[int, ...]) -> str:
    if len(shape) < 2:
        return f"{shape[0]} numbers" if shape else "one number"
    return f"an array of shape {shape}"
