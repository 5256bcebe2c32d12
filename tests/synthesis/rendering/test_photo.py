from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import trimesh

from hadr.camera import Intrinsics, ray_directions
from hadr.synthesis.generation.frames import build_scene
from hadr.synthesis.generation.settings import GenerationSettings
from hadr.synthesis.glass.surfaces import Surface
from hadr.synthesis.rendering import photo
from hadr.synthesis.rendering.mitsuba_variant import LLVM, mitsuba_variant
from hadr.synthesis.rendering.shading import RayTracer
from hadr.synthesis.rendering.trial_picture import trial_scene
from hadr.synthesis.scene.contents import Contents, Scene, Surroundings
from hadr.synthesis.scene.lights import AreaLight, Environment

RECORDINGS = Path(__file__).resolve().parents[3] / "data_samples" / "recordings"
CAMERA = Intrinsics(60.0, 60.0, 31.5, 17.5, 64, 36)

pytest.importorskip("mitsuba", reason="path-traced pictures need hadr[generate]")
pytest.importorskip("pyoidn", reason="path-traced pictures need hadr[generate]")


def scene_of(contents, camera=CAMERA) -> Scene:
    """A scene without a hold, seen along z from the origin."""
    return Scene(contents, camera, np.eye(4))


def wall(path, depth, left, right, top, bottom) -> Surroundings:
    """A wall that faces the camera, with one copy of a photograph between the given tangents."""
    corners = depth * np.array(
        [[left, top, 1], [left, bottom, 1], [right, bottom, 1], [right, top, 1]]
    )
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    surface = Surface(corners, faces, np.tile([0, 0, -1.0], (4, 1)))
    uv = np.array([[0, 0], [0, 1], [1, 1], [1, 0.0]])
    number, tint = np.full(2, -1), np.ones((2, 3))
    return Surroundings(surface, uv, number, tint, np.full(2, depth * (bottom - top)), (path,))


@pytest.fixture
def grey(tmp_path) -> Path:
    """A photograph of one grey."""
    cv2.imwrite(str(tmp_path / "grey.png"), np.full((64, 64, 3), 188, np.uint8))
    return tmp_path / "grey.png"


def light_of(value) -> Environment:
    return Environment(np.full((32, 64, 3), value, dtype=np.float32))


@pytest.fixture(scope="module")
def held():
    settings = GenerationSettings(width=64, height=36, quality="fast", recordings=str(RECORDINGS))
    return build_scene(settings.recipe(0), settings)


# Energy --------------------------------------------------------------------------------------


def test_a_grey_wall_under_even_light_has_its_reflectance(grey):
    """Radiance = reflectance x irradiance / pi: a flat wall in light 1 from all sides."""
    around = wall(grey, 2.0, -9, 9, -9, 9)
    contents = Contents(None, (), surroundings=around, environment=light_of(1.0))
    expected = (188 / 255) ** 2.2
    light, albedo, normal = photo.trace(scene_of(contents), seed=1, samples=16)
    assert light.mean() == pytest.approx(expected, rel=0.01)
    np.testing.assert_allclose(albedo, expected, rtol=0.01)
    np.testing.assert_allclose(normal, np.broadcast_to([0, 0, -1], normal.shape), atol=1e-4)
    directions = ray_directions(CAMERA).reshape(-1, 3)
    cast_light = RayTracer(contents).radiance(np.zeros_like(directions), directions, 1 / 60.0)
    np.testing.assert_allclose(cast_light, expected, rtol=0.01)


def test_a_photograph_stands_upright_as_the_ray_caster_draws_it(tmp_path):
    colors = np.arange(4 * 4 * 3, dtype=np.uint8).reshape(4, 4, 3) * 5
    path = tmp_path / "colors.png"
    cv2.imwrite(str(path), cv2.resize(colors, (512, 512), interpolation=cv2.INTER_NEAREST))
    around = wall(path, 2.0, -0.56, 0.56, -0.33, 0.33)
    contents = Contents(None, (), surroundings=around, environment=light_of(1.0))
    _, albedo, _ = photo.trace(scene_of(contents), seed=1, samples=4)
    directions = ray_directions(CAMERA).reshape(-1, 3)
    cast = RayTracer(contents).reflectance(np.zeros_like(directions), directions, 1 / 60.0)
    wrong = np.abs(albedo.reshape(-1, 3) - cast).max(1) > 0.02
    assert wrong.mean() < 0.3  # at the borders of the patches


def test_a_lens_blurs_what_is_out_of_focus(grey):
    """The step at a wall's edge is as wide as the lens's circle of confusion."""
    around = wall(grey, 2.0, -9, 0, -9, 9)
    contents = Contents(None, (), surroundings=around, environment=light_of(0.0))

    def between(focus):
        lens = Scene(contents, CAMERA, np.eye(4), aperture=0.05, focus=focus)
        _, albedo, _ = photo.trace(lens, seed=1, samples=64)
        row = albedo[10:26, :, 0].mean(0) / albedo[..., 0].max()
        return ((row > 0.05) & (row < 0.95)).sum()

    assert between(2.0) <= 1
    # The circle is as many pixels wide: 60 x 2 x 0.05 x (1 / 0.5 - 1 / 2).
    assert 6 <= between(0.5) <= 9


def test_clear_glass_in_even_light_cannot_be_seen():
    """The white furnace: what glass mirrors and lets through is all of the light, and no more."""
    mesh = trimesh.creation.icosphere(4, 0.1)
    ball = Surface(np.add(mesh.vertices, [0, 0, 0.5]), np.asarray(mesh.faces), mesh.vertices / 0.1)
    contents = Contents(None, (ball,), (1.0, 1.0, 1.0), environment=light_of(0.8))
    light, _, _ = photo.trace(scene_of(contents), seed=1, samples=64)
    assert light.mean() == pytest.approx(0.8, rel=0.01)
    block = light[14:22, 28:36].mean((0, 1))  # the middle of the ball
    np.testing.assert_allclose(block, 0.8, rtol=0.05)


def test_a_panel_lights_a_wall_by_the_inverse_square(grey):
    """E = L A cos cos / d^2: a small panel of 10 cm beside the camera, 2 m from a grey wall."""
    lamp = AreaLight(
        np.array([0, -0.8, 0.0]), np.array([0.05, 0, 0]), np.array([0, 0.05, 0]), np.full(3, 90.0)
    )
    assert lamp.normal == pytest.approx([0, 0, 1])
    around = wall(grey, 2.0, -9, 9, -9, 9)
    contents = Contents(None, (), surroundings=around, lamps=(lamp,), environment=light_of(0.0))
    light, _, _ = photo.trace(scene_of(contents), seed=1, samples=64)
    squared = 2.0**2 + 0.8**2
    cosine = 2.0 / np.sqrt(squared)
    expected = (188 / 255) ** 2.2 / np.pi * 90.0 * 0.01 * cosine**2 / squared
    assert light[14:22, 28:36].mean() == pytest.approx(expected, rel=0.06)


def test_mitsuba_sees_the_environment_where_it_is():
    """A bright spot on grey: Mitsuba's own axes and azimuth are others than ours."""
    environment = Environment(np.full((256, 512, 3), 0.1, dtype=np.float32))
    spot = np.exp(-(1 - environment.directions() @ [0.3, -0.1, 0.949]) / 0.003)[..., None]
    environment = Environment((environment.image + spot).astype(np.float32))
    contents = Contents(None, (), environment=environment)
    light, _, _ = photo.trace(scene_of(contents), seed=1, samples=16)
    directions = ray_directions(CAMERA).reshape(-1, 3)
    expected = environment.radiance(directions).reshape(36, 64, 3)
    row, column = np.unravel_index(expected[..., 0].argmax(), (36, 64))
    found = np.unravel_index(light[..., 0].argmax(), (36, 64))
    # Along x by 0.3/0.949 and up by 0.1/0.949 of the focal length of 60 pixels.
    assert abs(column - (31.5 + 19.0)) <= 2
    assert abs(row - (17.5 - 6.3)) <= 2
    assert np.abs(np.subtract(found, (row, column))).max() <= 2
    assert np.corrcoef(light.ravel(), expected.ravel())[0, 1] > 0.98


# The process ---------------------------------------------------------------------------------


def test_dr_jit_gets_back_the_threads_that_it_had(held):
    drjit = pytest.importorskip("drjit", reason="Dr.Jit comes with hadr[generate]")
    before = drjit.thread_count()
    try:
        drjit.set_thread_count(3)
        with photo._one_order(SimpleNamespace(variant=lambda: LLVM)):
            assert drjit.thread_count() == 1
        assert drjit.thread_count() == 3
        photo.trace(held, seed=0, samples=1)
        assert drjit.thread_count() == 3
    finally:
        drjit.set_thread_count(before)


def test_the_trial_runs_the_kernels_that_a_frame_needs(held):
    """A kernel that was never tried may end the process; the camera's numbers are part of one."""
    if mitsuba_variant() != LLVM:
        pytest.skip("no LLVM that Mitsuba can use: install 17 or newer (on Debian: libllvm19)")
    import drjit

    def kernels(scene):
        drjit.kernel_history_clear()
        photo.trace(scene, seed=0, samples=2)
        return {kernel["hash"] for kernel in drjit.kernel_history() if "hash" in kernel}

    with drjit.scoped_set_flag(drjit.JitFlag.KernelHistory):
        trials = [replace(trial_scene(lamps), camera=held.camera) for lamps in (1, 2)]
        tried = kernels(trials[0]) | kernels(trials[1])
        needed = kernels(held)
        lenses = [replace(held, aperture=0.003 + 0.001 * i, focus=0.4 + 0.2 * i) for i in (0, 1)]
        first, second = map(kernels, lenses)
    assert len(needed) > 2
    assert needed <= tried
    assert second <= first, "another lens must not compile the kernels anew"


# The picture ---------------------------------------------------------------------------------


@pytest.mark.parametrize("shift", [0, 7])
def test_the_box_filter_keeps_neighbours_apart(tmp_path, shift):
    """Black left of an edge between two columns, white right of it: none is mixed."""
    image = np.zeros((64, 4096 // 4, 3), np.uint8)
    image[:, 512:] = 255
    cv2.imwrite(str(tmp_path / "edge.png"), image)
    camera = replace(CAMERA, cx=CAMERA.cx + shift)
    edge = (36 + 0.5 - camera.cx) / 60.0  # between columns 36 and 37
    around = wall(tmp_path / "edge.png", 1.0, edge - 4, edge + 4, -9, 9)
    contents = Contents(None, (), surroundings=around, environment=light_of(1.0))
    light, _, _ = photo.trace(scene_of(contents, camera), seed=1, samples=64)
    columns = light.mean((0, 2))
    assert columns[:36].max() < 1e-4
    assert columns[36] < 0.15  # one texel is half a pixel wide, and it is blended with the next
    assert columns[37] > 0.75
    assert columns[38:].min() > 0.85


def test_the_same_seed_gives_the_same_bytes(held):
    first = photo.photograph(held, seed=5, samples=2)
    assert first.shape == (36, 64, 3)
    assert first.dtype == np.uint8
    np.testing.assert_array_equal(first, photo.photograph(held, seed=5, samples=2))
    assert (first != photo.photograph(held, seed=6, samples=2)).mean() > 0.2


def test_a_photograph_is_bright_and_shows_what_the_ray_caster_shows(held):
    """Both engines draw the same scene: the light of each block agrees roughly."""
    picture = photo.photograph(held, seed=1).astype(float)
    assert 80 < picture.mean() < 210
    view = held.camera, held.world_from_camera, np.random.default_rng(0)
    cast_light = RayTracer(held.contents).picture(*view).astype(float)

    def pattern(image):
        small = cv2.resize(image, (16, 9), interpolation=cv2.INTER_AREA)
        return (small - small.mean((0, 1))).ravel()

    assert np.corrcoef(pattern(picture), pattern(cast_light))[0, 1] > 0.8


def test_the_denoiser_takes_noise_away_and_keeps_an_edge():
    rng = np.random.default_rng(0)
    truth = np.full((72, 128, 3), 0.2, dtype=np.float32)
    truth[:, 64:] = 0.8
    noisy = (truth * rng.gamma(4.0, 0.25, truth.shape)).astype(np.float32)
    normal = np.zeros_like(truth)
    normal[..., 2] = 1.0
    clean = photo.denoise(noisy, truth, normal)
    assert np.abs(clean - truth).mean() < 0.15 * np.abs(noisy - truth).mean()
    assert clean[:, 62].mean() < 0.25
    assert clean[:, 65].mean() > 0.72


def test_the_guide_looks_through_glass(grey, pane):
    """Behind a pane the guide has the wall's reflectance, dimmed by what two surfaces mirror."""
    around = wall(grey, 2.0, -9, 9, -9, 9)
    contents = Contents(None, (pane(0.5, 0.52),), (1.0,) * 3, around, environment=light_of(1.0))
    _, albedo, _ = photo.trace(scene_of(contents), seed=1, samples=1)
    assert albedo[18, 32].mean() == pytest.approx(0.96**2 * (188 / 255) ** 2.2, rel=0.02)


def test_errors_name_the_value(held):
    with pytest.raises(ValueError, match="samples must be at least 1 path a pixel, got 0"):
        photo.photograph(held, seed=0, samples=0)
    squashed = replace(held, camera=replace(held.camera, fy=held.camera.fy * 1.2))
    with pytest.raises(ValueError, match="needs square pixels"):
        photo.trace(squashed, seed=0, samples=1)
