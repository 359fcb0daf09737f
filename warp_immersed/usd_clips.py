"""USD in value clips: the frames of a long shot over several files, opened as one."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pxr import Sdf, Usd, Vt

from warp_immersed.ensemble import Frame
from warp_immersed.export_options import ExportOptions
from warp_immersed.output_files import discard, partial_path, parts_folder, publish, start_parts
from warp_immersed.recording import Prototype
from warp_immersed.usd import (
    CROWD,
    Ids,
    all_ids,
    create_crowd,
    define_world,
    describe_stage,
    largest_radius,
    new_layer,
    rows_of,
    set_time_range,
)
from warp_immersed.usd_samples import SampleWriter, declare_samples, save_layer

CLIP_PRIM = Sdf.Path("/Crowd")


class ClipWriter:
    """Writes frames to value clips in a folder beside a root file that says when each counts.

    Each clip ends with the frame that begins the next, so that USD interpolates over the seam as in one file.

    Args, Raises: as `warp_immersed.usd.UsdWriter`; options.chunk_frames is the length of a clip.
    """

    def __init__(
        self,
        path: Path,
        prototypes: tuple[Prototype, ...],
        fps: float,
        manifest: Mapping[str, Any],
        options: ExportOptions,
        ids: Ids | None = None,
    ):
        self.path = path
        self._options, self._fps = options, fps
        self._ids = all_ids(prototypes) if ids is None else ids
        options.check_output(path, 0, len(self._ids))
        self._radius = largest_radius(prototypes)
        self._starts: list[int] = []
        self._last = 0
        self._clip: SampleWriter | None = None
        self._folder = start_parts(path)
        self._root = new_layer(partial_path(path))
        stage = Usd.Stage.Open(self._root)
        describe_stage(stage, fps, manifest, options)
        define_world(stage)
        create_crowd(stage, CROWD, prototypes, self._ids, options)
        del stage
        declared = self._new_clip_layer("manifest")
        declare_samples(declared, CLIP_PRIM, options)
        save_layer(declared, path)

    def write(self, frame: Frame) -> None:
        """Append a frame.

        Raises:
            InputError: the disk is full or gone.
        """
        if self._clip is not None and frame.index == self._starts[-1] + (self._options.chunk_frames or 0):
            self._clip.write(frame)
            self._end_clip(frame.index)
        if self._clip is None:
            layer = self._new_clip_layer(f"clip_{len(self._starts):04d}")
            rows = rows_of(self._ids)
            self._clip = SampleWriter(layer, CLIP_PRIM, self.path, rows, self._radius, self._options, self._fps)
            self._starts.append(frame.index)
        self._clip.write(frame)
        self._last = frame.index

    def finish(self) -> None:
        """Save the last clip and the root, and give them their names.

        Raises:
            InputError: the disk is full or gone.
        """
        self._end_clip(self._last)
        set_time_range(self._root, [*self._starts[:1], self._last], self._options, self._fps)
        codes = [self._options.time_code(frame, self._fps) for frame in (*self._starts, self._last)]
        self._root.GetPrimAtPath(CROWD).SetInfo(
            "clips",
            {
                "default": {
                    "assetPaths": Sdf.AssetPathArray([self._asset(f"clip_{i:04d}") for i in range(len(self._starts))]),
                    "manifestAssetPath": self._asset("manifest"),
                    "primPath": str(CLIP_PRIM),
                    "active": Vt.Vec2dArray([(code, i) for i, code in enumerate(codes[:-1])]),
                    "times": Vt.Vec2dArray([(code, code) for code in sorted({codes[0], codes[-1]})]),
                }
            },
        )
        save_layer(self._root, self.path)
        del self._root
        publish(self.path)

    def abort(self) -> None:
        """Leave nothing behind."""
        self._clip = None
        vars(self).pop("_root", None)
        discard(self.path)

    def _asset(self, name: str) -> Sdf.AssetPath:
        return Sdf.AssetPath(f"./{parts_folder(self.path).name}/{name}{self.path.suffix}")

    def _new_clip_layer(self, name: str) -> Sdf.Layer:
        layer = new_layer(self._folder / f"{name}{self.path.suffix}")
        Sdf.CreatePrimInLayer(layer, CLIP_PRIM)
        layer.defaultPrim = CLIP_PRIM.name
        # without these USD would take the clip's time codes for 1/24 s
        layer.timeCodesPerSecond = layer.framesPerSecond = self._options.rate(self._fps)
        return layer

    def _end_clip(self, last: int) -> None:
        if self._clip is not None:
            set_time_range(self._clip.layer, [self._starts[-1], last], self._options, self._fps)
            self._clip.save()
            self._clip = None
