"""Curved and folded sheets as plates: what they are divided into, and that airplanes, cards and seeds fly as they should."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from tests.bodies import model_in, random_orientations, rotate, started, trajectory
from warp_immersed import library
from warp_immersed.device_state import Surroundings
from warp_immersed.fluid import AIR
from warp_immersed.mass_properties import PointMass
from warp_immersed.plates import plates_of
from warp_immersed.shape import Shape
from warp_immersed.sheet_mesh import rectangle_mesh


def arched_sheet(angle: float) -> Shape:
    """A sheet of 10 x 6 cm, bent about its length so that its edges are inclined by an angle [rad]."""
    mesh = rectangle_mesh(0.10, 0.06).subdivide().subdivide()
    y = mesh.vertices[:, 1]
    mesh.vertices[:, 2] = np.tan(angle) / 0.06 * y**2
    return Shape.from_mesh(mesh, 500.0, 2e-4)


@pytest.mark.parametrize(
    ("shape", "count"),
    [
        (library.disk(), 0),
        (library.rectangular_paper(), 0),
        (library.maple_leaf(), 0),
        (library.sphere(), 0),
        (arched_sheet(np.radians(10.0)), 0),
        (arched_sheet(np.radians(30.0)), 2),
        (library.paper_airplane(), 3),
        (library.samara(), 4),
    ],
    ids=["disk", "rectangle", "leaf", "sphere", "slight arch", "arch", "airplane", "samara"],
)
def test_a_body_has_no_more_plates_than_it_needs(shape, count) -> None:
    assert len(plates_of(shape, AIR)) == count


def test_plates_share_area_and_added_mass() -> None:
    """Two halves of an arch: mirror images, together the area of the sheet and its added mass along the normal."""
    shape = arched_sheet(np.radians(30.0))
    one, other = plates_of(shape, AIR)
    area = sum(plate.loads.drag_broadside for plate in (one, other)) / (0.5 * AIR.density * 1.178)
    assert area == pytest.approx(shape.mesh.area, rel=0.06)
    assert one.axes[:, 2] * [1, -1, 1] == pytest.approx(other.axes[:, 2] * np.sign(one.axes[2, 2] * other.axes[2, 2]), abs=1e-6)
    center, mirrored = (plate.axes @ plate.loads.pressure_center for plate in (one, other))
    assert center * [1, -1, 1] == pytest.approx(mirrored, abs=1e-6)
    assert (one.share + other.share)[2] == pytest.approx((one.axes[2, 2] ** 2), rel=1e-6)


def flight(shape: Shape, speed: float, seconds: float, roll: float = 0.0, fps: float = 60.0):
    """Thrown along world x, its mesh's x ahead and z up."""
    base = Rotation.from_euler("x", -90.0, degrees=True) * Rotation.from_euler("x", roll, degrees=True)
    start = started(orientations=(base * Rotation.from_matrix(shape.rotation)).as_quat(), velocities=(speed, 0.0, 0.0))
    return trajectory(model_in(shape, AIR), start, Surroundings(AIR), fps, round(seconds * fps) + 1)


def glide_ratios(velocities: np.ndarray, parts: int) -> np.ndarray:
    """Distance over loss of height in equal parts of a flight (F, 3)."""
    pieces = np.array_split(velocities, parts)
    return np.array([np.hypot(piece[:, 0], piece[:, 2]).mean() / -piece[:, 1].mean() for piece in pieces])


@pytest.mark.parametrize("speed", [2.0, 3.0, 5.0])
def test_a_nose_heavy_airplane_settles_into_a_glide(speed) -> None:
    """Lift over drag between 2 and 8, steady within 5 %, from whatever speed it is thrown with."""
    late = flight(library.paper_airplane(), speed, 8.0)["velocities"][240:, 0]
    ratios = glide_ratios(late, 8)
    assert 2.0 < ratios.mean() < 8.0
    assert np.abs(ratios / ratios.mean() - 1.0).max() < 0.05
    pace = np.linalg.norm(late, axis=1)
    assert np.abs(pace / pace.mean() - 1.0).max() < 0.05


def test_a_tail_heavy_airplane_stalls() -> None:
    """Without its clip it rears up until it flies backward or upside down."""
    shape = library.paper_airplane(nose_weight=0.0)
    run = flight(shape, 3.0, 4.0)
    ahead = rotate(run["orientations"][:, 0], np.tile(shape.rotation.T @ [1.0, 0.0, 0.0], (241, 1)))
    assert ahead[:, 1].max() > np.sin(np.radians(50.0))
    assert ahead[:, 1].min() < -np.sin(np.radians(50.0))


def test_mirrored_throws_make_mirrored_flights() -> None:
    right, left = (flight(library.paper_airplane(), 3.0, 3.0, roll)["positions"][:, 0] for roll in (10.0, -10.0))
    assert np.abs(right[:, 2]).max() > 0.1, "a banked airplane turns"
    assert np.abs(right * [1.0, 1.0, -1.0] - left).max() < 0.01 * np.linalg.norm(right[-1] - right[0])


def test_a_card_weighted_along_an_edge_glides_and_a_plain_one_does_not() -> None:
    """A flat sheet whose centre of mass lies before its middle: a steady glide instead of tumbling (Andersen et al. 2005)."""

    def card(ballast: float) -> Shape:
        edge = [PointMass(ballast, (0.0, 0.049, 0.0))] if ballast else ()
        return Shape.from_mesh(rectangle_mesh(0.2, 0.1), 800.0, 1e-4, edge)

    runs = []
    for shape in (card(0.0), card(4e-4)):
        turn = Rotation.from_matrix([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]) * Rotation.from_matrix(shape.rotation)
        start = started(orientations=turn.as_quat(), velocities=(2.0, 0.0, 0.0))
        runs.append(trajectory(model_in(shape, AIR), start, Surroundings(AIR), 60.0, 361))
    plain, weighted = (np.linalg.norm(run["angular_velocities"][240:, 0], axis=1).mean() for run in runs)
    assert plain > 3.0
    assert weighted < 0.3
    ratios = glide_ratios(runs[1]["velocities"][240:, 0], 6)
    assert 1.5 < ratios.mean() < 8.0
    assert np.abs(ratios / ratios.mean() - 1.0).max() < 0.05


def test_a_samara_can_autorotate() -> None:
    """Maple keys sink at 0.8 to 1.4 m/s and turn 60 to 150 rad/s. From some attitudes this one dives nut first; they do not."""
    run = trajectory(
        model_in(library.samara(), AIR), started(orientations=random_orientations(30, 1), count=30), Surroundings(AIR), 60.0, 301
    )
    sink = -run["velocities"][240:, :, 1].mean(axis=0)
    turning = np.abs(run["angular_velocities"][240:, :, 1].mean(axis=0))
    spinning = (turning > 50.0) & (sink < 2.0)
    assert spinning.mean() > 0.25
    assert (turning[spinning] < 150.0).all()
    assert (sink[spinning] > 0.8).all()


def test_plates_do_not_depend_on_how_the_mesh_is_numbered() -> None:
    shape = arched_sheet(np.radians(30.0))
    order = np.random.default_rng(0).permutation(len(shape.mesh.faces))
    other = Shape.from_mesh(trimesh.Trimesh(shape.mesh.vertices, shape.mesh.faces[order], process=False), 500.0, 2e-4)
    areas = [sorted(plate.loads.drag_broadside for plate in plates_of(body, AIR)) for body in (shape, other)]
    assert areas[0] == pytest.approx(areas[1], rel=1e-6)
