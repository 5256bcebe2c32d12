import numpy as np
import pytest
import trimesh

from hadr.synthesis.hand.surface_nets import surface_nets


def test_finds_a_sphere():
    axis = np.arange(-12, 13) * 0.1
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    field = (np.sqrt(x**2 + y**2 + z**2) - 0.83).astype(np.float32)
    vertices, faces = surface_nets(field, (axis, axis, axis))
    assert np.abs(np.linalg.norm(vertices, axis=1) - 0.83).max() < 0.012
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 0.83**3, rel=0.02)


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
