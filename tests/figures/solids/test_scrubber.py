import base64
import json
import re

import cv2
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

from hadr.figures.solids.scrubber import Slider, scrubber, turning

SHADES = [["#ff0000", "#00ff00"], ["#0000ff", "#ffffff"], ["#000000", "#ffffff"]]


def patch(row: int, column: int = 0, *, size: float = 0.4):
    return plt.figure(figsize=(2 * size, size), dpi=100, facecolor=SHADES[row][column])


def painted(row, column=0):
    figure = patch(row, column)
    ax = figure.add_axes((0, 0, 1, 1))
    ax.set_axis_off()
    ax.add_patch(plt.Rectangle((0, 0), 1, 1, color=SHADES[row][column]))
    return figure


def data_of(page):
    return json.loads(re.search(r"const DATA = (.*);\n", page).group(1))


def picture_at(data, place):
    raw = base64.b64decode(data["pictures"][data["order"][place]])
    return cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_COLOR)[..., ::-1].astype(int)


@pytest.fixture
def two():
    rows, columns = Slider("row", ("a", "b", "c"), start=1), Slider("column", ("x", "y"))
    return scrubber(painted, [rows, columns], title="Two sliders", alt='colours "here"')


def test_each_place_shows_its_own_picture(two):
    data = data_of(two.page)
    for row in range(3):
        for column in range(2):
            wanted = 255 * np.array(mpl.colors.to_rgb(SHADES[row][column]))
            height, width = (picture := picture_at(data, 2 * row + column)).shape[:2]
            np.testing.assert_allclose(picture[height // 2, width // 2], wanted, atol=12)
    assert [s["start"] for s in data["sliders"]] == [1, 0]
    assert plt.get_fignums() == []
    assert data["milliseconds"] == 0


def test_equal_pictures_are_kept_once(two):
    data = data_of(two.page)
    assert len(data["order"]) == 6
    assert len(data["pictures"]) == 5  # white stands in two places


def test_frame_holds_the_page_and_asks_no_other_host(two, tmp_path):
    shown = two._repr_html_()
    assert shown.count("<iframe") == 1
    assert shown.count('"') == 8  # style, title, style and srcdoc: no quote of the page gets out
    assert 'title="Two sliders"' in shown
    assert data_of(two.page)["alt"] == 'colours "here"'
    assert two.page.count("</script>") == 1
    assert not re.search(r"https?://|import\(|fetch\(", two.page)
    two.save(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == two.page


def test_wrong_sliders_and_sizes_are_refused():
    with pytest.raises(ValueError, match="at least one slider"):
        scrubber(painted, [], title="t", alt="a")
    with pytest.raises(ValueError, match="two places"):
        Slider("alone", ("a",))
    with pytest.raises(ValueError, match="starts at 2"):
        Slider("late", ("a", "b"), start=2)
    with pytest.raises(ValueError, match="one size"):
        scrubber(
            lambda row: patch(row, size=0.4 + 0.1 * row),
            [Slider("row", ("a", "b"))],
            title="t",
            alt="a",
        )


def test_a_figure_with_3d_axes_is_turned_about_its_vertical():
    figure = plt.figure(figsize=(2, 2), dpi=60)
    ax = figure.add_subplot(projection="3d", elev=10, azim=-60)
    ax.scatter([1.0], [0.0], [0.0], s=80, c="red", depthshade=False)
    ax.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
    ax.set_axis_off()
    data = data_of(turning(figure, title="t", alt="a", turns=4).page)
    assert data["sliders"][0]["labels"] == ["0", "90", "180", "270"]
    assert data["milliseconds"] == 333  # three views a second
    columns, rows = [], []
    for place in range(4):
        picture = picture_at(data, place)
        red = (picture[..., 0] > 180) & (picture[..., 1:].max(axis=2) < 120)
        rows.append(np.argwhere(red)[:, 0].mean())
        columns.append(np.argwhere(red)[:, 1].mean())
    # the dot goes around: opposite places lie on opposite sides of the middle, at like heights
    middle = picture.shape[1] / 2
    assert min(abs(columns[0] - columns[2]), abs(columns[1] - columns[3])) > 5
    assert (columns[0] - middle) * (columns[2] - middle) < 0
    assert (columns[1] - middle) * (columns[3] - middle) < 0
    assert np.ptp(rows) < 0.25 * picture.shape[0]
    assert (ax.elev, ax.azim) == (10, -60)


def test_a_flat_figure_cannot_be_turned():
    with pytest.raises(ValueError, match="only a figure with 3D axes"):
        turning(patch(0), title="t", alt="a")
    figure = plt.figure()
    figure.add_subplot(projection="3d")
    with pytest.raises(ValueError, match="at least two places"):
        turning(figure, title="t", alt="a", turns=1)
