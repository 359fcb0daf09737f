"""Landing: flat, on the ground, at rest."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.bodies import model_in, random_orientations, rotate, started, trajectory
from warp_immersed import library
from warp_immersed.device_state import Group, Surroundings
from warp_immersed.fluid import AIR, WATER
from warp_immersed.kernels.rigid_body import LANDED, MOVING
from warp_immersed.resting import resting
from warp_immersed.turbulence import HomogeneousTurbulence

GROUND = 0.25
SHAPES = [
    "disk",
    "elliptic_paper",
    "rectangular_paper",
    "maple_leaf",
    "oak_leaf",
    "willow_leaf",
    "samara",
    "paper_airplane",
    "sphere",
]


def fall(name: str, fluid=AIR, fps=24.0, seconds=6.0, count=60, **surroundings):
    shape = library.SHAPES[name]()
    start = started(positions=(0.0, GROUND + 0.8, 0.0), orientations=random_orientations(count, 6), count=count)
    world = Surroundings(fluid, ground_height=GROUND, **surroundings)
    return shape, trajectory(model_in(shape, fluid), start, world, fps, round(seconds * fps))


def heights(shape, run) -> np.ndarray:
    """Height of the lowest vertex over the ground (frames, bodies) [m]."""
    supports = resting(shape).supports
    q, x = run["orientations"].astype(float), run["positions"].astype(float)
    lowest = np.full(x.shape[:2], np.inf)
    for point in supports:
        lowest = np.minimum(lowest, (x + rotate(q, np.broadcast_to(point, x.shape)))[..., 1])
    return lowest - GROUND


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("fps", [12.0, 60.0])
def test_bodies_come_to_rest_on_the_ground(name: str, fps: float) -> None:
    shape, run = fall(name, fps=fps)
    assert (run["state"][-1] == LANDED).all()
    over = heights(shape, run)
    assert over.min() > -2e-6, "nothing sinks in, not even for one frame"
    assert np.abs(over[-1]).max() < 2e-6, "and what lies, lies on the ground"
    landed = run["state"] == LANDED
    assert not run["velocities"][landed].any()
    assert not run["angular_velocities"][landed].any()
    first = landed.argmax(axis=0)
    for body in range(run["state"].shape[1]):
        rest = slice(first[body], None)
        assert (run["state"][rest, body] == LANDED).all()
        assert np.ptp(run["positions"][rest, body], axis=0).max() == 0.0, "no jitter"
        assert np.ptp(run["orientations"][rest, body], axis=0).max() == 0.0
        jump = np.abs(np.diff(run["positions"][first[body] - 1 :, body], axis=0)).max()
        assert jump < 5e-3 + 0.2 / fps, "no popping when it is declared landed"


@pytest.mark.parametrize("name", ["disk", "elliptic_paper", "rectangular_paper"])
def test_flat_sheets_lie_flat(name: str) -> None:
    shape, run = fall(name)
    normals = rotate(run["orientations"][-1].astype(float), np.tile([0.0, 0.0, 1.0], (60, 1)))
    assert np.abs(np.abs(normals[:, 1]) - 1.0).max() < 1e-6
    assert np.allclose(run["positions"][-1][:, 1], GROUND + shape.thickness / 2.0, atol=2e-6)


@pytest.mark.parametrize("name", ["maple_leaf", "oak_leaf", "birch_leaf", "ginkgo_leaf"])
def test_curved_leaves_lie_on_three_points(name: str) -> None:
    shape, run = fall(name)
    normals = rotate(run["orientations"][-1].astype(float), np.tile([0.0, 0.0, 1.0], (60, 1)))
    assert np.degrees(np.arccos(np.abs(normals[:, 1]))).max() < 25.0
    supports = resting(shape).supports
    for body in range(60):
        q = np.tile(run["orientations"][-1, body].astype(float), (len(supports), 1))
        touching = (rotate(q, supports)[:, 1] + run["positions"][-1, body, 1] - GROUND) < 2e-5
        assert touching.sum() >= 3


def test_settling_takes_a_moment_and_not_for_ever() -> None:
    _, run = fall("maple_leaf", fps=120.0, seconds=5.0)
    touch = (np.abs(np.diff(run["velocities"][..., 1], axis=0)) > 0.3).argmax(axis=0)
    landed = (run["state"] == LANDED).argmax(axis=0)
    assert (landed > 0).all()
    assert (landed - touch < 2.0 * 120).all()


def test_friction_stops_what_the_wind_brings() -> None:
    _, run = fall("maple_leaf", mean_wind=(3.0, 0.0, 0.0), turbulence=HomogeneousTurbulence(0.1, 0.1))
    assert (run["state"][-1] == LANDED).all()
    assert run["positions"][-1, :, 0].min() > 0.3


def test_buoyant_bodies_never_pass_the_floor() -> None:
    shape = library.sphere(0.01, 500.0)
    start = started(positions=(0.0, GROUND + 0.05, 0.0), velocities=(0.1, -3.0, 0.0), count=3)
    run = trajectory(model_in(shape, WATER), start, Surroundings(WATER, ground_height=GROUND), 60.0, 60)
    assert heights(shape, run).min() > -1e-5
    assert (run["state"] == MOVING).all()
    assert run["positions"][-1, :, 1].min() > GROUND + 0.05, "and rise again"


def test_rest_directions_are_those_of_a_box() -> None:
    import trimesh

    from warp_immersed.shape import Shape

    rests = resting(Shape.from_mesh(trimesh.creation.box((0.1, 0.2, 0.3)), 500.0)).rests
    assert sorted(map(tuple, rests.round(6))) == sorted(map(tuple, np.concatenate([np.eye(3), -np.eye(3)]).round(6)))


def test_a_box_topples_onto_a_face() -> None:
    import trimesh

    from warp_immersed.shape import Shape

    shape = Shape.from_mesh(trimesh.creation.box((0.1, 0.2, 0.3)), 500.0)
    start = started(positions=(0.0, GROUND + 0.6, 0.0), orientations=random_orientations(40, 7), count=40)
    run = trajectory(model_in(shape, AIR), start, Surroundings(AIR, ground_height=GROUND), 24.0, 100)
    assert (run["state"][-1] == LANDED).all()
    height = run["positions"][-1, :, 1] - GROUND
    assert np.isclose(height[:, None], [0.05, 0.1, 0.15], atol=1e-5).any(axis=1).all()


def test_bodies_land_on_a_roof_and_beside_it() -> None:
    import trimesh

    roof = trimesh.creation.box(bounds=[[-1.0, 0.0, -1.0], [0.0, 2.0, 1.0]])
    shape = library.disk()
    x = np.linspace(-0.95, 0.95, 40)
    place = np.column_stack([x, np.full(40, 3.0), np.zeros(40)])
    start = started(positions=place, orientations=random_orientations(40, 11), count=40)
    world = Surroundings(AIR, ground_height=GROUND, ground_mesh=roof)
    run = trajectory(model_in(shape, AIR), start, world, 24.0, 240)
    assert (run["state"][-1] == LANDED).all()
    end = run["positions"][-1]
    on_roof = (end[:, 0] < 0.0) & (np.abs(end[:, 2]) < 1.0) & (end[:, 0] > -1.0)
    assert 5 < on_roof.sum() < 35
    clear = np.abs(end[:, 0]) > shape.bounding_radius
    half = shape.thickness / 2.0
    assert np.allclose(end[on_roof & clear, 1], 2.0 + half, atol=1e-5)
    assert np.allclose(end[~on_roof & clear, 1], GROUND + half, atol=1e-5)


def test_bodies_lie_along_a_slope() -> None:
    import trimesh

    slope = np.radians(20.0)
    hill = trimesh.creation.box(bounds=[[-30.0, -1.0, -30.0], [30.0, 0.0, 30.0]])
    hill.apply_transform(trimesh.transformations.rotation_matrix(slope, [0.0, 0.0, 1.0]))
    shape = library.rectangular_paper()
    start = started(positions=(0.0, 1.0, 0.0), orientations=random_orientations(30, 12), count=30)
    run = trajectory(model_in(shape, AIR), start, Surroundings(AIR, ground_mesh=hill), 24.0, 120)
    assert (run["state"][-1] == LANDED).all()
    up = np.array([-np.sin(slope), np.cos(slope), 0.0])
    normals = rotate(run["orientations"][-1].astype(float), np.tile([0.0, 0.0, 1.0], (30, 1)))
    assert np.allclose(np.abs(normals @ up), 1.0, atol=1e-6)
    assert np.allclose(run["positions"][-1] @ up, shape.thickness / 2.0, atol=1e-5)


@pytest.mark.parametrize("level", ["quasi_steady", "point"])
def test_velocities_are_those_of_the_motion_while_a_body_topples(level) -> None:
    """Motion blur at landing: the centre sinks as the body turns about its lowest point, and the velocity says so."""
    fps = 480.0
    start = started(positions=(0.0, 0.03, 0.0), orientations=Rotation.from_euler("x", -30.0, degrees=True).as_quat())
    group = Group(model_in(library.disk(0.04, 1e-3, 2000.0), AIR), start, 1, level)
    run = trajectory([group], None, Surroundings(AIR, ground_height=0.0), fps, 400)
    y, v = run["positions"][:, 0, 1].astype(float), run["velocities"][:, 0, 1]
    touched = int(np.argmax(np.diff(v) > 0.02))
    rest = int(np.argmax(run["state"][:, 0] == LANDED))
    toppling = slice(touched + 3, rest - 3)
    assert rest - touched > 20
    measured = (y[2:] - y[:-2])[touched + 2 : rest - 4] * fps / 2.0
    assert np.abs(measured).max() > 0.01
    assert np.abs(v[toppling] - measured).max() < 0.05 * np.abs(measured).max() + 1e-4
