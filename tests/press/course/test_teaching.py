import pytest

from hadr.press.course.chapter import MARKS, hints
from hadr.press.course.teaching import PLANS, chapters_text, instructor_text, plans_text


@pytest.mark.parametrize("plan", PLANS, ids=lambda plan: f"{plan.hours}h")
def test_a_plan_is_as_long_as_it_says(plan):
    minutes = [sum(block.minutes for block in session) for session in plan.sessions]
    assert sum(minutes) == 60 * plan.hours
    assert set(minutes) == {120}
    assert [plan.hours for plan in PLANS] == [2, 6, 12]


def test_plans_and_marks_name_what_there_is(book):
    numbers = {chapter.number for chapter in book}
    labels = {exercise.label: chapter.number for chapter in book for exercise in chapter.exercises}
    assert set(MARKS) <= set(labels)
    for plan in PLANS:
        done = []
        for block in (block for session in plan.sessions for block in session):
            assert set(block.chapters) <= numbers
            assert {labels[label] for label in block.exercises} <= set(block.chapters)
            done += block.exercises
        assert len(done) == len(set(done))
    long = {number for session in PLANS[-1].sessions for b in session for number in b.chapters}
    assert long == numbers


def test_exercises_are_numbered_as_on_the_pages_of_the_book(book):
    first, second = book[3].exercises[:2]
    assert (first.number, second.number) == ("3.1", "3.2")
    assert f"- **3.1 {first.title}**" in instructor_text(book[3:4], book)
    assert f"3.1 {first.title}" in plans_text(book)


def test_the_page_names_goals_marks_and_mistakes(book):
    text = instructor_text(book[3:4], book)
    (chapter,) = book[3:4]
    for goal in chapter.goals:
        assert goal in text
    for exercise in chapter.exercises:
        assert exercise.title in text
        for hint in hints(exercise):
            assert f"  - {hint}" in text
    assert "(3 marks)" in text
    assert [exercise.marks for exercise in chapter.exercises] == [2, 2, 3]
    assert "student/03_ray_voxels.ipynb" in text
    assert "student/04" not in text
    assert all(f"### {hours} hours" in plans_text(book) for hours in (2, 6, 12))


def test_titles_lead_where_they_should(small):
    text = chapters_text([small], lambda chapter: f"there/{chapter.name}.ipynb")
    assert text.startswith("### 7. [A small chapter](there/07_small.ipynb)")
    assert "- stop." in text
