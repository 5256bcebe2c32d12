"""The glass objects with their sections, and a sheet of the ways in which hands hold them."""

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from hadr.camera import Array
from hadr.figures.depth.frames import contact_sheet
from hadr.figures.panels import COLORS, bare_axes
from hadr.figures.solids.studio import PLAIN, studio_picture, studio_view
from hadr.figures.solids.turntable import bare_glass, held_glass, solid_of
from hadr.synthesis.glass.objects import bodies
from hadr.synthesis.glass.shape import GlassObject
from hadr.synthesis.glass.surfaces import Surface
from hadr.synthesis.holding.hold import Hold

# Vertices of a small picture's hand, metres apart.
_QUICK_STEP = 0.004
_HALF_CM, _CELL_CM = 12.5, 30.0


def glass_section(item: GlassObject) -> list[Array]:
    """Closed outlines (x, z), (N, 2) metres each, of an object cut at y = 0; holes run backward."""
    outlines: list[Array] = []
    for body in bodies(item):
        # The section plane of the library is z = 0: lay the object on its back.
        turned = body.vertices @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
        lying = Surface(turned, body.faces, body.normals)
        outlines += [np.asarray(p, dtype=float) for p in solid_of(lying).slice(0.0).to_polygons()]
    return outlines


def draw_objects(
    items: Sequence[GlassObject], notes: Mapping[str, str], *, columns: int = 4, pixels: int = 260
) -> Figure:
    """Draw objects at one scale, each beside its section."""
    rows = [items[k : k + columns] for k in range(0, len(items), columns)]
    tall = [100 * max(item.height for item in row) + 5.0 for row in rows]
    size = (9.0, sum(9.0 / columns * t / _CELL_CM for t in tall) + 0.3 * len(rows))
    fig: Figure
    fig, axes = plt.subplots(len(rows), columns, figsize=size, height_ratios=tall, squeeze=False)
    fig.set_layout_engine("constrained", w_pad=0.03, h_pad=0.03, hspace=0.0, wspace=0.0)
    for row, line, top in zip(rows, axes, tall, strict=True):
        for ax in line[len(row) :]:
            ax.set_axis_off()
        for ax, item in zip(line, row, strict=False):
            _draw_object(ax, item, notes.get(item.object_id, ""), pixels)
            ax.set_ylim(-3.9, top - 3.9)
    return fig


def _draw_object(ax: Axes, item: GlassObject, note: str, pixels: int) -> None:
    scene = bare_glass(item)
    view = studio_view(scene, radius=_HALF_CM / 100 / 1.06, center=(0.0, 0.0, item.height / 2))
    picture = studio_picture(scene, view, pixels=pixels, paper=False)
    outlines = [100 * p for p in glass_section(item)]
    low_x, high_x = (float(f([f(p[:, 0]) for p in outlines])) for f in (np.min, np.max))
    # The picture is cut to the glass; its scale holds in the plane of the axis.
    shown = min(max(-low_x, high_x) + 0.8, _HALF_CM)
    cut = round(pixels / 2 * (1 - shown / _HALF_CM))
    low_z = 50 * item.height - _HALF_CM
    extent = (-shown, shown, low_z, low_z + 2 * _HALF_CM)
    ax.imshow(picture[:, cut : pixels - cut], extent=extent, interpolation="bilinear")
    across = shown + 0.7 - low_x
    offset = np.array([across, 0.0])
    closed = [Path(offset + np.concatenate([p, p[:1]]), closed=True) for p in outlines]
    section = Path.make_compound_path(*closed)
    ax.add_patch(PathPatch(section, fc=COLORS["glass"], ec=COLORS["hadr"], lw=0.7))
    ax.plot([across, across], [-0.6, 100 * item.height + 0.8], "-.", color="0.5", lw=0.7)
    ax.plot([across - 2.5, across + 2.5], [-1.5, -1.5], color="black", lw=1.5)
    ax.text(across, -1.8, "5 cm", ha="center", va="top", fontsize=7.5)
    middle = (across + high_x - shown) / 2
    ax.set(xlim=(middle - _CELL_CM / 2, middle + _CELL_CM / 2), aspect="equal")
    ax.set_facecolor((PLAIN, PLAIN, PLAIN))
    bare_axes(ax, f"{item.object_id} {item.name}" + (f" ({note})" if note else ""))
    ax.title.set_fontsize(9.5)


def draw_hold_sheet(
    holds: Sequence[Sequence[Hold]], titles: Sequence[str], *, pixels: int
) -> Figure:
    """Draw a sheet of holds, a titled row an object, a column a kind, from the thumb's side."""
    columns = max(len(row) for row in holds)
    blank = np.full((pixels, pixels, 3), 255, np.uint8)
    pictures, kinds = [], []
    for row in holds:
        scenes = [held_glass(hold, tolerance=0.0, step=_QUICK_STEP) for hold in row]
        pictures += [studio_picture(scene, pixels=pixels) for scene in scenes]
        pictures += [blank] * (columns - len(row))
        kinds += [*(hold.kind for hold in row), *[""] * (columns - len(row))]
    fig = contact_sheet(pictures, kinds, columns=columns)
    for title, ax in zip(titles, fig.axes[::columns], strict=True):
        ax.set_ylabel(title, fontsize=9)
    return fig
