import numpy as np
import pytest
import torch

from hadr.press.exercises import Verdict, check


def test_right_number():
    verdict = check(0.1 + 0.2, 0.3)
    assert verdict
    assert verdict == Verdict("right", "Right: 0.3.")
    assert str(verdict) == "✓ Right: 0.3."


def test_a_right_answer_is_shown_where_it_is_short():
    assert check([24700, -1.38629], [24700, -1.3863], rtol=1e-4).message == "Right: 24,700, -1.386."
    assert check(np.arange(5), np.arange(5)).message == "Right."
    assert check("edges", "edges").message == "Right."


def test_not_answered_yet():
    verdict = check(..., 3)
    assert verdict.status == "open"
    assert not verdict
    assert "Not answered yet" in str(verdict)


def test_wrong_number_says_what_it_was():
    verdict = check(2.0, 3.0)
    assert (verdict.status, bool(verdict)) == ("wrong", False)
    assert "2" in verdict.message
    assert "3" not in verdict.message  # the solution is not given away


def test_plausible_wrong_answer_gets_its_hint():
    hints = [(70.0, "That is in centimetres."), (1 / 0.7, "Turned upside down.")]
    assert check(70.0, 0.7, wrong=hints).message == "That is in centimetres."
    assert check(1 / 0.7, 0.7, wrong=hints).message == "Turned upside down."
    assert check(0.7, 0.7, wrong=hints).status == "right"
    assert check(5.0, 0.7, wrong=hints).message not in {h for _, h in hints}


@pytest.mark.parametrize(
    "answer",
    [np.array([1.0, 2.0]), [1, 2], (1.0, 2.0), torch.tensor([1.0, 2.0], requires_grad=True)],
)
def test_arrays_lists_and_tensors(answer):
    assert check(answer, [1.0, 2.0])
    assert not check(answer, [1.0, 2.5])


def test_wrong_array_tells_the_largest_difference():
    verdict = check(np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.5, 3.1]))
    assert verdict.message.endswith("0.5.")


def test_shape_mismatch_names_both_shapes():
    column = np.zeros((3, 1))
    assert check(np.zeros(3), column).message == (
        "This is 3 numbers; the answer is an array of shape (3, 1)."
    )
    assert check(np.zeros(3), 0.0).message == "This is 3 numbers; the answer is one number."
    assert check(0.0, np.zeros(2)).message == "This is one number; the answer is 2 numbers."


def test_an_answer_that_is_half_done_is_open():
    assert check([0.1, ..., 0.5], [0.1, 0.2, 0.5]).status == "open"


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (0.6501, "Nearly"),  # 0.65079 to three digits
        (65.079, "100 times"),
        (0.00065079, "0.001 times"),
        (-0.65079, "sign"),
        (0.8, "Not 0.8. Check the units"),
        (0.498, "A hint"),  # of 0.5, to two digits
    ],
)
def test_a_slip_is_told_from_an_error(answer, message):
    verdict = check(answer, 0.65079, wrong=[(0.5, "A hint.")])
    assert verdict.status == "wrong"
    assert message in verdict.message


def test_slips_of_arrays_and_counts():
    assert "1000 times" in check([100.0, 0.0, -500.0], [0.1, 0.0, -0.5]).message
    assert "sign" in check([1.0, -2.0], [-1.0, 2.0]).message
    assert check(487, 500).message == "Not 487. Count again."
    assert check(2.5e-13, 0.0).message == "Right: 0."


def test_nan_in_the_answer():
    assert "NaN" in check(np.array([1.0, np.nan]), [1.0, 2.0]).message
    assert "NaN" in check(float("nan"), 1.0).message
    assert check([1.0, np.nan], [1.0, np.nan])  # where NaN is the answer


def test_tolerances():
    assert not check(1.01, 1.0)
    assert check(1.01, 1.0, rtol=0.02)
    assert not check(1e-4, 0.0)
    assert check(1e-4, 0.0, atol=1e-3)


def test_words_masks_and_whole_numbers():
    assert check("z", "z")
    assert check("x", "z") == Verdict("wrong", "Not 'x'.")
    assert check("x", "z", wrong=[("x", "That is the closing axis.")]).message.startswith("That is")
    assert check(["a", "b"], ["a", "b"])
    assert not check("a", ["a", "a"])  # one word is not two
    assert check(np.array([True, False]), [True, False])
    assert check(5, 5)
    assert not check(True, 5)


@pytest.mark.parametrize(
    "answer",
    [None, "three", object(), {"a": 1}, [1, [2, 3]], [object()], lambda: 3, np.array(["a"])],
)
@pytest.mark.parametrize("expected", [3.0, [1.0, 2.0], "z", ["a", "b"]])
def test_never_raises_for_an_answer(answer, expected):
    verdict = check(answer, expected, wrong=[(1.0, "no"), ([1.0, 2.0, 3.0], "no")])
    assert verdict.status == "wrong"
    assert verdict.message


@pytest.mark.parametrize("answer", [..., 3.0, 4.0])
@pytest.mark.parametrize("wrong", [{4.0: "A mapping."}, [4.0], "no", [(4.0, "a", "b")]])
def test_a_check_whose_hints_are_no_pairs_says_so_at_once(answer, wrong):
    """Not only to the learner who gives a wrong answer: every run of the chapter meets it."""
    with pytest.raises(ValueError, match="wrong must list pairs"):
        check(answer, 3.0, wrong=wrong)


def test_html_is_escaped_and_coloured_by_verdict():
    shown = Verdict("wrong", "Not <b>3</b>.")._repr_html_()
    assert "&lt;b&gt;3" in shown
    assert "<b>" not in shown
    colours = {Verdict(s, "")._repr_html_().split('"')[1] for s in ("right", "wrong", "open")}
    assert len(colours) == 3
