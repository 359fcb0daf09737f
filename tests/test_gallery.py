"""Every built-in scene shows what its story says, and what lands, lies."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

import warp_immersed as wi
from tests.bodies import rotate
from warp_immersed.kernels.rigid_body import LANDED
from warp_immersed.motion import motion_word
from warp_immersed.scene import Scene, builtin_scenes
from warp_immersed.scene_ground import scene_ground_mesh
from warp_immersed.simulation import MemorySink, Plan, ensemble_of, plan, run

# the crowds are thinned: what they show does not depend on their number
SCALES = {"autumn_crowd": 0.1, "snow": 0.01, "confetti": 0.2, "autumn_street": 0.1}


@dataclass(frozen=True)
class Played:
    scene: Scene
    planned: Plan
    recording: wi.Recording

    def moving(self, kind: str, height: float = 0.3) -> np.ndarray:
        """(frames, bodies of a kind): in the air, above a height, and released at least half a second ago."""
        bodies = self.bodies(kind)
        moved = np.linalg.norm(self.recording.velocities[:, bodies], axis=2) > 0.0
        late = np.cumsum(moved, axis=0) > 0.5 * self.scene.fps
        return moved & late & (self.recording.positions[:, bodies, 1] > height)

    def bodies(self, kind: str) -> slice:
        first = 0
        for table in self.scene.bodies:
            if table.name == kind:
                return slice(first, first + table.count)
            first += table.count
        raise KeyError(kind)


@cache
def played(name: str) -> Played:
    scene = Scene.load(name).changed(count_scale=SCALES.get(name, 1.0))
    return Played(scene, plan(scene), wi.simulate(scene, device="cpu"))


def words(show: Played, kind: str, seconds: float = 0.5) -> list[str]:
    """What each body of a kind does in the middle of its fall."""
    recording, bodies = show.recording, show.bodies(kind)
    flying, half, said = show.moving(kind), round(seconds / 2.0 * show.scene.fps), []
    for body in range(flying.shape[1]):
        frames = np.flatnonzero(flying[:, body])
        if len(frames) > 2 * half:
            middle = frames[len(frames) // 2]
            window = slice(middle - half, middle + half + 1)
            velocities = recording.velocities[window, bodies][:, body]
            said.append(motion_word(velocities, recording.angular_velocities[window, bodies][:, body], seconds))
    return said


def surface_height(mesh, x: np.ndarray, z: np.ndarray, base: float) -> np.ndarray:
    """Height of a height field's triangles at places, without any ray: by the cell and the side of its diagonal."""
    vertices = np.asarray(mesh.vertices)
    columns = np.count_nonzero(np.isclose(vertices[:, 0], vertices[0, 0]))
    grid = vertices.reshape(-1, columns, 3)
    first, last = grid[0, 0], grid[-1, -1]
    u = (x - first[0]) / (last[0] - first[0]) * (grid.shape[0] - 1)
    v = (z - first[2]) / (last[2] - first[2]) * (columns - 1)
    inside = (u >= 0) & (v >= 0) & (u < grid.shape[0] - 1) & (v < columns - 1)
    i, j = np.clip(u.astype(int), 0, grid.shape[0] - 2), np.clip(v.astype(int), 0, columns - 2)
    s, t = u - i, v - j
    a, b, c, d = (grid[i + di, j + dj, 1] for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1)))
    height = np.where(s >= t, a + s * (b - a) + t * (c - b), a + t * (d - a) + s * (c - d))
    return np.where(inside, np.maximum(height, base), base)


@pytest.mark.parametrize("name", sorted(builtin_scenes()))
def test_every_scene_tells_its_story(name) -> None:
    scene = Scene.load(name)
    assert 30 < len(scene.story) < 250
    assert scene.story.endswith(".")
    assert scene.view is not None


@pytest.mark.parametrize("name", ["falling_leaves", "autumn_crowd", "confetti", "coins_in_water", "snow"])
def test_a_landed_crowd_lies_still_on_the_ground(name) -> None:
    show = played(name)
    recording, scene, ground = show.recording, show.scene, show.scene.ground
    assert ground is not None
    mesh = scene_ground_mesh(scene)
    landed = recording.state == LANDED
    assert landed[-1].mean() > 0.3
    # none moves once it rests, and none pops: not into its rest, nor when it has all but stopped
    step = np.linalg.norm(np.diff(recording.positions.astype(float), axis=0), axis=2)
    speed = np.linalg.norm(recording.velocities, axis=2)
    assert not step[landed[:-1]].any()
    assert (landed[1:] | ~landed[:-1]).all()
    slow = np.maximum(speed[:-1], speed[1:]) / scene.fps < 1e-3
    started = np.cumsum(speed > 0.0, axis=0)[:-1] > 0
    near = recording.positions[1:, :, 1] < ground.height + 0.02 if mesh is None else landed[1:]
    assert step[slow & started & near & landed[1:]].max(initial=0.0) < 5e-3
    # none sinks in by more than it is thick
    for kind in show.planned.kinds:
        bodies = show.bodies(kind.table.name)
        lying = landed[-1, bodies]
        q = recording.orientations[-1, bodies][lying].astype(float)
        x = recording.positions[-1, bodies][lying].astype(float)
        deepest = np.full(len(x), np.inf)
        for point in kind.model.resting.supports:
            place = x + rotate(q, np.broadcast_to(point, x.shape))
            if mesh is None:
                below = np.full(len(x), ground.height)
            else:
                below = surface_height(mesh, place[:, 0], place[:, 2], ground.height)
            deepest = np.minimum(deepest, place[:, 1] - below)
        assert deepest.min() > -kind.shape.thickness, f"{kind.table.name} sinks in by {-1e3 * deepest.min():.2f} mm"
        assert deepest.max() < ground.layering + (1e-4 if mesh is None else 0.02), "and none hovers"


def test_falling_paper_tumbles_and_flutters() -> None:
    show = played("falling_paper")
    said = words(show, "paper")
    assert len(said) > 40
    assert sum(word in ("tumbling", "autorotating", "fluttering") for word in said) > 0.9 * len(said), said
    falling = show.moving("paper")
    sink = -show.recording.velocities[..., 1][falling]
    # the slides' paper, 4 x 1 cm and 0.1 mm: weight against drag at C_D 0.5 to 2
    weight, area = show.planned.kinds[0].shape.mass * 9.81, np.pi * 0.02 * 0.005
    slow, fast = (np.sqrt(2.0 * weight / (1.204 * c * area)) for c in (2.0, 0.5))
    assert slow < sink.mean() < fast
    assert (show.recording.state[-1] == LANDED).all()


def test_rubber_ellipsoids_sink_at_the_speed_of_their_weight() -> None:
    show = played("rubber_ellipsoid_in_water")
    falling = show.moving("rubber", 0.2)
    sink = -show.recording.velocities[..., 1][falling]
    # slower than a body that falls edge on without lift, faster than one that lies broadside
    a, b, c = 0.04, 0.02, 0.01
    pull = (1100.0 - 998.2) * 4.0 / 3.0 * np.pi * a * b * c * 9.81
    broadside = np.sqrt(2.0 * pull / (998.2 * 1.2 * np.pi * a * b))
    edge_on = np.sqrt(2.0 * pull / (998.2 * 0.2 * np.pi * b * c))
    assert broadside * 0.8 < sink.mean() < edge_on
    assert set(words(show, "rubber")) & {"fluttering", "tumbling"}


def test_coins_flutter_and_lie_flat() -> None:
    show = played("coins_in_water")
    recording = show.recording
    assert (recording.state[-1] == LANDED).all()
    normals = rotate(recording.orientations[-1].astype(float), np.tile([0.0, 0.0, 1.0], (120, 1)))
    assert (np.abs(normals[:, 1]) > 0.999).all()
    said = words(show, "coin")
    assert sum(word in ("fluttering", "tumbling") for word in said) > 0.8 * len(said)
    # no two coins lie at the very same height: where they overlap, they do not flicker
    heights = np.sort(recording.positions[-1, :, 1])
    assert np.diff(heights).min() > 1e-6


def test_how_far_an_airplane_glides_depends_on_its_launch() -> None:
    show = played("paper_airplane")
    recording = show.recording
    assert (recording.state[-1] == LANDED).all()
    end = {name: recording.positions[-1, show.bodies(name), 0] for name in ("gentle", "firm", "hard")}
    assert all(np.ptp(x) < 0.3 for x in end.values()), "still air: every throw at a speed ends at one place"
    assert end["gentle"].mean() > 2.0 * 2.0, "from 2 m up: a glide ratio above 2"
    assert end["firm"].mean() > end["gentle"].mean() + 0.5
    assert end["hard"].mean() > end["firm"].mean() + 0.5
    assert words(show, "firm").count("gliding") > 6


def test_confetti_rises_then_tumbles_down_in_every_colour() -> None:
    show = played("confetti")
    recording = show.recording
    start = recording.positions[0, :, 1]
    assert (recording.positions[..., 1].max(axis=0) > start + 0.05).mean() > 0.9, "thrown upward"
    said = words(show, "confetti")
    assert sum(word in ("tumbling", "autorotating") for word in said) > 0.5 * len(said)
    sink = -recording.velocities[..., 1][show.moving("confetti")]
    assert 0.3 < np.median(sink) < 1.5
    assert len(recording.prototypes[0].colors) == 6


def test_snow_drifts_with_the_wind_and_whitens_the_ground() -> None:
    show = played("snow")
    recording = show.recording
    falling = show.moving("flake")
    sink, drift = -recording.velocities[..., 1][falling], recording.velocities[..., 0][falling]
    assert 0.3 < sink.mean() < 1.2
    assert drift.mean() == pytest.approx(0.8, abs=0.15)
    assert (recording.state[-1] == LANDED).sum() > 300


def test_samaras_spin_down_like_rotors() -> None:
    show = played("samaras")
    recording = show.recording
    falling = show.moving("samara", 1.0)
    sink = -recording.velocities[..., 1][falling]
    assert 0.5 < sink.mean() < 2.5
    assert recording.velocities[..., 0][falling].mean() == pytest.approx(0.6, abs=0.25)
    said = words(show, "samara")
    assert said.count("autorotating") > 0.6 * len(said)
    assert (recording.state[-1] == LANDED).mean() > 0.9


@pytest.mark.parametrize("name", ["falling_leaves", "autumn_crowd"])
def test_leaves_of_every_species_come_down_with_the_wind(name) -> None:
    show = played(name)
    wind = np.array(show.scene.wind.velocity)
    for table in show.scene.bodies:
        falling = show.moving(table.name, 1.5)
        velocities = show.recording.velocities[:, show.bodies(table.name)][falling]
        assert 0.4 < -velocities[:, 1].mean() < 2.5, table.name
        along = velocities.mean(axis=0) @ wind / np.linalg.norm(wind)
        assert along == pytest.approx(np.linalg.norm(wind), abs=0.25), table.name
    assert len({p.colors for p in show.recording.prototypes}) == len(show.scene.bodies)


def test_bodies_that_leave_the_bounds_stop_there_and_are_counted() -> None:
    text = Scene.load("confetti").text.replace(
        "[view]", "[bounds]\nlower = [-2.0, -1.0, -9.0]\nupper = [2.0, 9.0, 9.0]\n\n[view]"
    )
    scene = Scene.from_text(text.replace("duration = 9.0", "duration = 4.0"), "confetti").changed(count_scale=0.1)
    sink = MemorySink(scene.frame_count, scene.body_count)
    outcome = run(ensemble_of(plan(scene)), scene.frame_count, [sink])
    positions, state = sink.arrays["positions"], sink.arrays["state"]
    beyond = np.abs(positions[..., 0]) > 2.0
    # parked where a frame found them: they are there at its end, and then for good
    parked = beyond[-1] & (state[-1] == LANDED)
    assert parked.sum() > 20
    assert parked.sum() > 0.9 * beyond[-1].sum()
    for body in np.flatnonzero(parked):
        first = int(beyond[:, body].argmax())
        assert np.ptp(positions[first + 1 :, body], axis=0).max(initial=0.0) < 1e-6
    assert outcome.parked == parked.sum()
