"""A shot in the browser, by viser: orbit, play, scrub, follow a body."""

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warp_immersed.errors import InputError
from warp_immersed.framing import camera_of
from warp_immersed.motion import motion_word
from warp_immersed.picture import srgb
from warp_immersed.shot import Poses, Shot

# Motion is put into a word over this time [s] about the frame shown.
WINDOW = 0.5


class Viewer:
    """Serves one shot until it is closed.

    Args:
        shot: what to see. host, port: where; another port is taken if this one is.

    Raises:
        InputError: viser is not installed.
    """

    def __init__(self, shot: Shot, host: str, port: int):
        try:
            import viser
        except ImportError as error:
            raise InputError(f"view: needs {error.name}; pip install 'warp-immersed[view]'") from error
        self._shot = shot
        self._server = viser.ViserServer(host=host, port=port, label=f"warp-immersed: {shot.name}", verbose=False)
        self._server.scene.set_up_direction("+y")
        self._bodies_of = [np.flatnonzero(shot.look_of == index) for index in range(len(shot.looks))]
        self._frame = -1
        camera = camera_of(shot, 16.0 / 9.0)
        self._server.initial_camera.position = tuple(camera.position)
        self._server.initial_camera.look_at = tuple(camera.target)
        self._server.initial_camera.fov = np.radians(camera.field_of_view) * 9.0 / 16.0
        self._meshes = self._add_bodies(shot.poses(0))
        self._add_ground()
        gui: Any = self._server.gui
        self._slider = gui.add_slider("frame", 0, max(shot.frames - 1, 1), 1, 0)
        self._playing = gui.add_checkbox("play", True)
        self._speed = gui.add_slider("speed", 0.1, 2.0, 0.1, 1.0)
        self._body = gui.add_number("body", 0, min=0, max=len(shot.look_of) - 1, step=1)
        self._follow = gui.add_checkbox("follow it", False)
        self._words = gui.add_markdown("")
        self._target = camera.target

    @property
    def port(self) -> int:
        """The port it listens on."""
        return int(self._server.get_port())

    def close(self) -> None:
        """Stop serving."""
        self._server.stop()

    def play(self, seconds: float | None = None) -> None:
        """Run the show: for ever, or for so long [s]."""
        shot, begin = self._shot, time.monotonic()
        position, last = float(self._slider.value), begin
        while seconds is None or time.monotonic() - begin < seconds:
            now = time.monotonic()
            if int(self._slider.value) != int(position):  # someone moved it
                position = float(self._slider.value)
            if self._playing.value:
                position = (position + (now - last) * shot.fps * self._speed.value) % shot.frames
                self._slider.value = int(position)
            last = now
            self.show(min(int(position), shot.frames - 1))
            time.sleep(1.0 / min(shot.fps, 30.0))

    def show(self, frame: int) -> None:
        """Put all bodies where they are in a frame, and say how the chosen one moves."""
        body = int(np.clip(self._body.value or 0, 0, len(self._shot.look_of) - 1))
        if frame != self._frame:
            self._frame = frame
            poses = self._shot.poses(frame)
            with self._server.atomic():
                for mesh, bodies in zip(self._meshes, self._bodies_of, strict=True):
                    if mesh is not None:
                        mesh.batched_positions = np.asarray(poses.positions[bodies], dtype=np.float32)
                        mesh.batched_wxyzs = np.asarray(poses.orientations[bodies][:, [3, 0, 1, 2]], dtype=np.float32)
            if self._follow.value:
                self._look_at(np.asarray(poses.positions[body], dtype=np.float64))
        self._words.content = self.describe(body, frame)

    def snapshot(self, width: int, height: int) -> NDArray[np.uint8]:
        """What the first browser shows, drawn anew by it in this size: (height, width, 3).

        Raises:
            InputError: no browser is looking.
        """
        clients = self._server.get_clients()
        if not clients:
            raise InputError("view: no browser is looking")
        return np.asarray(clients[min(clients)].get_render(height=height, width=width), dtype=np.uint8)[..., :3]

    def describe(self, body: int, frame: int) -> str:
        """A body's kind, height, speed, spin and motion, in Markdown."""
        shot = self._shot
        half = max(1, round(WINDOW / 2.0 * shot.fps))
        window = [shot.poses(i) for i in range(max(0, frame - half), min(shot.frames, frame + half + 1))]
        velocities = np.array([poses.velocities[body] for poses in window], dtype=np.float64)
        spins = np.array([poses.spins[body] for poses in window], dtype=np.float64)
        now = shot.poses(frame)
        word = motion_word(velocities, spins, len(window) / shot.fps)
        return (
            f"**{shot.looks[shot.look_of[body]].name}, body {body}**: {word}\n\n"
            f"speed {np.linalg.norm(now.velocities[body]):.2f} m/s, sinking {-now.velocities[body][1]:.2f} m/s\n\n"
            f"spin {np.linalg.norm(now.spins[body]) / (2.0 * np.pi):.1f} turns/s, height {now.positions[body][1]:.2f} m\n\n"
            f"time {frame / shot.fps:.2f} s"
        )

    def _look_at(self, target: Any) -> None:
        """Move every camera along with what it follows."""
        moved, self._target = target - self._target, target
        for client in self._server.get_clients().values():
            with client.atomic():
                client.camera.position = np.asarray(client.camera.position) + moved
                client.camera.look_at = target

    def _add_bodies(self, poses: Poses) -> list[Any]:
        """One batch of meshes a look; None for looks that nobody wears."""
        meshes: list[Any] = []
        for index, (look, bodies) in enumerate(zip(self._shot.looks, self._bodies_of, strict=True)):
            if not len(bodies):
                meshes.append(None)
                continue
            meshes.append(
                self._server.scene.add_batched_meshes_simple(
                    f"/crowd/{index}_{look.name}",
                    np.asarray(look.vertices, dtype=np.float32),
                    np.asarray(look.faces, dtype=np.uint32),
                    np.asarray(poses.orientations[bodies][:, [3, 0, 1, 2]], dtype=np.float32),
                    np.asarray(poses.positions[bodies], dtype=np.float32),
                    batched_colors=srgb(np.array(look.color)),
                    lod="off",
                    side="double",
                    cast_shadow=False,
                    receive_shadow=False,
                )
            )
        return meshes

    def _add_ground(self) -> None:
        """The ground plane as a grid, and what stands on it."""
        scene = self._shot.scene
        if scene is not None and scene.ground is not None:
            self._server.scene.add_grid(
                "/ground", 200.0, 200.0, plane="xz", position=(0.0, scene.ground.height, 0.0), infinite_grid=True
            )
        if self._shot.ground is not None:
            self._server.scene.add_mesh_simple(
                "/relief",
                np.asarray(self._shot.ground.vertices, dtype=np.float32),
                np.asarray(self._shot.ground.faces, dtype=np.uint32),
                color=(120, 125, 95),
                side="double",
                flat_shading=True,
            )
