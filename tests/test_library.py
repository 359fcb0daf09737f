"""The shape library: valid bodies, leaves that are leaves."""

import numpy as np
import pytest

from warp_immersed import library
from warp_immersed.errors import InputError
from warp_immersed.library import SHAPES

LEAVES = ["maple_leaf", "oak_leaf", "birch_leaf", "willow_leaf", "ginkgo_leaf"]
ARGUMENTS = {"ellipsoid": {"semi_axes": (0.01, 0.03, 0.02)}, "sheet": {"outline": [(0, 0), (0.1, 0), (0.1, 0.05), (0, 0.06)]}}


def make(name, **changes):
    return SHAPES[name](**{**ARGUMENTS.get(name, {}), **changes})


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_are_whole(name) -> None:
    shape = make(name)
    assert shape.mass > 0.0
    assert (np.diff(shape.inertia) >= -1e-12 * shape.inertia[2]).all()
    assert shape.inertia[2] <= shape.inertia[0] + shape.inertia[1] + 1e-12
    assert shape.semi_axes[0] >= shape.semi_axes[1] >= shape.semi_axes[2] > 0.0
    uv = np.asarray(shape.mesh.visual.uv)
    assert uv.shape == (len(shape.mesh.vertices), 2)
    assert uv.min() > -0.01
    assert uv.max() < 1.01
    assert 40 <= len(shape.mesh.faces) <= 2000


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_scale(name) -> None:
    """Twice the size at the same density: 8 times the mass, 32 times the inertia."""
    lengths = {"ellipsoid": {"semi_axes": (0.02, 0.06, 0.04)}, "sphere": {"radius": 0.02}}
    if name in lengths:
        changed = lengths[name]
    elif name == "sheet":
        changed = {"outline": [(0, 0), (0.2, 0), (0.2, 0.1), (0, 0.12)], "thickness": 2e-4}
    else:
        import inspect

        defaults = {k: p.default for k, p in inspect.signature(SHAPES[name]).parameters.items()}
        changed = {k: 2.0 * v for k, v in defaults.items() if k not in ("density", "nose_weight")}
    one, two = make(name), make(name, **changed)
    assert two.mass == pytest.approx(8.0 * one.mass, rel=1e-6)
    assert np.allclose(two.inertia, 32.0 * one.inertia, rtol=1e-6)


@pytest.mark.parametrize("name", LEAVES)
def test_leaves_are_curved_and_pulled_by_their_petiole(name) -> None:
    shape = make(name)
    extent = np.ptp(shape.mesh.vertices, axis=0)
    assert 0.02 < extent[2] / extent[0] < 0.4, "curved, but a sheet"
    assert np.linalg.norm(shape.geometric_center[:2]) > 0.005 * extent[0]
    flat = SHAPES[name](thickness=1e-2 * extent[0])
    assert np.linalg.norm(shape.geometric_center[:2]) > np.linalg.norm(flat.geometric_center[:2]), "a thin blade weighs less"


def test_exact_forms_have_exact_mass_properties() -> None:
    ball = library.sphere(0.01, 2000.0)
    assert ball.mass == pytest.approx(2000.0 * 4.0 / 3.0 * np.pi * 1e-6, rel=1e-12)
    assert np.allclose(ball.inertia, 0.4 * ball.mass * 1e-4, rtol=1e-12)
    paper = library.elliptic_paper()
    assert np.allclose(paper.semi_axes, [0.02, 0.005, 5e-5])
    assert paper.mass == pytest.approx(800.0 * np.pi * 0.02 * 0.005 * 1e-4, rel=1e-12)
    expected = paper.mass * np.array([0.005**2 / 4 + 1e-8 / 12, 0.02**2 / 4 + 1e-8 / 12, (0.02**2 + 0.005**2) / 4])
    assert np.allclose(paper.inertia, expected, rtol=1e-12)


def test_the_nose_of_the_airplane_is_its_heavy_end() -> None:
    plane = library.paper_airplane()
    nose = plane.mesh.vertices[np.argmax(np.abs(plane.mesh.vertices[:, 0]))]
    assert nose[0] * plane.geometric_center[0] < 0.0


def test_the_nut_is_the_heavy_end_of_a_samara() -> None:
    seed = library.samara()
    assert np.abs(seed.geometric_center[0]) > 0.15 * np.ptp(seed.mesh.vertices[:, 0])


@pytest.mark.parametrize("name", [n for n in SHAPES if n not in ("ellipsoid", "sheet")])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), "long"])
def test_sizes_must_be_positive(name, value) -> None:
    import inspect

    for parameter in inspect.signature(SHAPES[name]).parameters:
        if parameter == "nose_weight" and value == 0.0:
            continue  # no clip
        with pytest.raises(InputError, match=parameter):
            SHAPES[name](**{parameter: value})
