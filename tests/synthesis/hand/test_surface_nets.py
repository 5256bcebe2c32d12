import numpy as np
import trimesh

from hadr.synthesis.hand.surface_nets import surface_nets


def test_grid_lines_need_not_be_even():
    """A box's faces lie where the linear field crosses zero, whatever the spacing."""
    x = np.array([0.0, 0.1, 0.3, 0.5, 0.8, 1.0])
    y = np.linspace(-1, 1, 9)
    sides = (
        (np.abs(x - 0.5) - 0.35)[:, None, None],
        (np.abs(y) - 0.6)[None, :, None],
        (np.abs(y) - 0.6)[None, None, :],
    )
    field = np.maximum(np.maximum(sides[0], sides[1]), sides[2])
    vertices, faces = surface_nets(field.astype(np.float32), (x, y, y))
    inner = vertices[(np.abs(vertices[:, 1]) < 0.3) & (np.abs(vertices[:, 2]) < 0.3)]
    np.testing.assert_allclose(np.unique(np.round(inner[:, 0], 6)), [0.15, 0.85], atol=1e-6)
    assert trimesh.Trimesh(vertices, faces, process=False).is_watertight
