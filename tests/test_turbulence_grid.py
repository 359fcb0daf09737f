import h5py
import numpy as np
import pytest

from warp_immersed.boundaries import Inlet, LogInlet
from warp_immersed.errors import InputError
from warp_immersed.turbulence_grid import TurbulenceGrid, far_field, sample_field


def linear_flow(x):
    """A flow linear in space, which trilinear sampling must return exactly; x (..., 3)."""
    velocity = np.stack([1.0 + 2.0 * x[..., 1], 0.5 - x[..., 0], 0.3 * x[..., 2]], axis=-1)
    return velocity, 2.0 + 0.1 * x[..., 0], 3.0 + 0.2 * x[..., 1]


def make_grid(cells=(6, 5, 4), solid=(), **given):
    lower, spacing = (-1.0, 0.0, 2.0), (0.5, 0.25, 1.0)
    axes = [low + (np.arange(n) + 0.5) * h for low, n, h in zip(lower, cells, spacing, strict=True)]
    centers = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    velocity, k, epsilon = (a.astype(np.float32) for a in linear_flow(centers))
    fluid = np.ones(cells, dtype=bool)
    for cell in solid:
        fluid[cell] = False
        velocity[cell], k[cell], epsilon[cell] = 0.0, 0.0, 0.0
    return TurbulenceGrid(lower=lower, spacing=spacing, velocity=velocity, k=k, epsilon=epsilon, fluid=fluid, **given)


def points_inside(count=200, seed=0):
    return np.random.default_rng(seed).uniform([-0.75, 0.125, 2.5], [1.75, 1.125, 5.5], (count, 3))


def test_trilinear_sampling_is_exact_for_a_linear_flow():
    points = points_inside()
    velocity, k, epsilon = make_grid().sample(points)
    expected = linear_flow(points)
    np.testing.assert_allclose(velocity, expected[0], atol=2e-6)
    np.testing.assert_allclose(k, expected[1], atol=2e-6)
    np.testing.assert_allclose(epsilon, expected[2], atol=2e-6)


def test_solid_cells_are_not_mixed_in():
    grid = make_grid(solid=[(2, 2, 2), (2, 3, 2)])
    x = np.array([[-1 + 2.9 * 0.5, 2.6 * 0.25, 2 + 2.5]])  # between a solid cell and fluid ones
    _, k, _ = grid.sample(x)
    assert 2.0 < k[0] < 2.2  # a solid zero mixed in would pull it far below 2
    inside = make_grid(solid=[(i, j, k) for i in range(4) for j in range(4) for k in range(4)])
    velocity, k, epsilon = inside.sample([[-0.4, 0.5, 3.5]])
    assert not velocity.any()
    assert k[0] == epsilon[0] == 0.0


def test_the_flow_fades_to_the_far_field_outside():
    far = Inlet((7.0, 0.0, 0.0), 0.5, 0.25)
    grid = make_grid(far=far, fade=2.0)
    edge, halfway, away = grid.sample([[2.0, 0.6, 4.0], [3.0, 0.6, 4.0], [9.0, 0.6, 4.0]])[0]
    np.testing.assert_allclose(away, far.velocity)
    np.testing.assert_allclose(halfway, 0.5 * (edge + away), rtol=1e-5)


def test_gradient_matches_the_flow():
    import warp as wp

    from warp_immersed.kernels import sampling

    points = wp.array(points_inside(50).astype(np.float32), dtype=wp.vec3)
    out = wp.zeros(50, dtype=wp.mat33)
    wp.launch(sampling.sample_gradients, 50, [make_grid().on_device(), 0.0, points], [out], device="cpu")
    expected = np.array([[0.0, 2.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.3]])
    np.testing.assert_allclose(out.numpy(), np.broadcast_to(expected, (50, 3, 3)), atol=1e-5)


def test_time_is_interpolated_and_held_at_the_ends():
    steady = make_grid()
    scale = np.array([1.0, 3.0, 5.0], dtype=np.float32)
    moving = TurbulenceGrid(
        lower=steady.lower,
        spacing=steady.spacing,
        velocity=scale[:, None, None, None, None] * steady.velocity,
        k=scale[:, None, None, None] * steady.k,
        epsilon=scale[:, None, None, None] * steady.epsilon,
        fluid=steady.fluid,
        time=np.array([10.0, 11.0, 12.0]),
    )
    point = points_inside(1)
    base = steady.sample(point)[1][0]
    for time, factor in ((9.0, 1.0), (10.25, 1.5), (11.5, 4.0), (20.0, 5.0)):
        assert moving.sample(point, time)[1][0] == pytest.approx(factor * base, rel=1e-5)


def test_log_wind_needs_no_grid():
    wind = LogInlet.from_reference((1.0, 0.0, 1.0), 5.0, 10.0, 0.05)
    velocity, k, epsilon = sample_field(far_field(wind), [[3.0, 10.0, 2.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(velocity[0], 5.0 / np.sqrt(2.0) * np.array([1.0, 0.0, 1.0]), rtol=1e-5)
    np.testing.assert_allclose(velocity[1], 0.0, atol=1e-6)
    u = wind.friction_velocity
    assert k[0] == pytest.approx(u**2 / 0.3, rel=1e-5)
    assert epsilon[0] == pytest.approx(u**3 / (0.41 * 10.05), rel=1e-5)


def test_file_round_trip(tmp_path):
    grid = make_grid(
        solid=[(0, 0, 0)],
        far=LogInlet.from_reference((1, 0, 0), 5.0, 10.0, 0.05),
        fade=3.0,
        scene="[domain]\n",
        provenance={"converged": True},
        history=np.arange(10.0).reshape(2, 5),
    )
    path = tmp_path / "field.h5"
    grid.save(path)
    back = TurbulenceGrid.load(path)
    for name in ("velocity", "k", "epsilon", "fluid", "history"):
        np.testing.assert_array_equal(getattr(back, name), getattr(grid, name))
    for name in ("lower", "spacing", "far", "fade", "scene", "provenance", "cells"):
        assert getattr(back, name) == getattr(grid, name)
    assert [p.name for p in tmp_path.iterdir()] == ["field.h5"]
    with h5py.File(path) as file:
        assert file["epsilon"].attrs["units"] == "m^2/s^3"
        np.testing.assert_array_equal(file["VTKHDF/CellData/k"][()].transpose(2, 1, 0), grid.k)


@pytest.mark.parametrize("size", [0, 100, 3000])
def test_a_truncated_file_is_an_input_error(tmp_path, size):
    path = tmp_path / "field.h5"
    make_grid().save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: min(size, len(whole) - 10)])
    with pytest.raises(InputError, match=r"field\.h5.*bake it again"):
        TurbulenceGrid.load(path)


def spoil_nan(file):
    file["k"][0, 0, 0] = np.nan


def spoil_version(file):
    file.attrs["schema_version"] = 99


def spoil_schema(file):
    del file.attrs["schema"]


def spoil_shape(file):
    del file["k"]
    file["k"] = np.zeros((2, 2, 2), dtype=np.float32)


def spoil_missing(file):
    del file["epsilon"]


def spoil_negative(file):
    file["epsilon"][0, 0, 0] = -1.0


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (spoil_nan, "k: is not finite"),
        (spoil_version, "schema version 99"),
        (spoil_schema, "not a bake file"),
        (spoil_shape, "k: found shape"),
        (spoil_missing, "epsilon"),
        (spoil_negative, "negative"),
    ],
)
def test_a_spoiled_file_is_an_input_error(tmp_path, spoil, says):
    path = tmp_path / "field.h5"
    make_grid().save(path)
    with h5py.File(path, "r+") as file:
        spoil(file)
    with pytest.raises(InputError, match=says) as caught:
        TurbulenceGrid.load(path)
    assert "field.h5" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_says_how_to_make_it(tmp_path):
    with pytest.raises(InputError, match="bake"):
        TurbulenceGrid.load(tmp_path / "none.h5")


def test_a_grid_with_nan_is_never_written():
    grid = make_grid()
    bad = grid.k.copy()
    bad[1, 2, 3] = np.inf
    with pytest.raises(InputError, match=r"k: is not finite at \(1, 2, 3\)"):
        TurbulenceGrid(
            lower=grid.lower, spacing=grid.spacing, velocity=grid.velocity, k=bad, epsilon=grid.epsilon, fluid=grid.fluid
        )
