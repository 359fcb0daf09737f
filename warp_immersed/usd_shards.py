"""USD in shards: the bodies of a big crowd over several files, each with its own point instancer, under one root."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom

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
from warp_immersed.usd_samples import SampleWriter, save_layer


class ShardWriter:
    """Writes frames to point instancers in files of their own, in a folder beside a root file that refers to them.

    Each file also opens by itself.

    Args, Raises: as `warp_immersed.usd.UsdWriter`; options.shards is their number.
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
        self._range: list[int] = []
        ids = all_ids(prototypes) if ids is None else ids
        options.check_output(path, 0, len(ids))
        folder, radius = start_parts(path), largest_radius(prototypes)
        self._root = new_layer(partial_path(path))
        stage = Usd.Stage.Open(self._root)
        describe_stage(stage, fps, manifest, options)
        define_world(stage)
        UsdGeom.Xform.Define(stage, CROWD)
        del stage
        self._shards: list[SampleWriter] = []
        for index, part in enumerate(np.array_split(ids, options.shards or 1)):
            name = f"Crowd_{index:03d}"
            prim = Sdf.CreatePrimInLayer(self._root, CROWD.AppendChild(name))
            prim.specifier = Sdf.SpecifierDef
            prim.referenceList.Prepend(Sdf.Reference(f"./{parts_folder(path).name}/{name}{path.suffix}"))
            layer = new_layer(folder / f"{name}{path.suffix}")
            shard = Usd.Stage.Open(layer)
            describe_stage(shard, fps, manifest, options)
            instancer = create_crowd(shard, Sdf.Path("/Crowd"), prototypes, part, options)
            shard.SetDefaultPrim(instancer.GetPrim())
            prim_path = instancer.GetPath()
            del instancer, shard
            self._shards.append(SampleWriter(layer, prim_path, path, rows_of(part), radius, options, fps))
            self._shards[-1].save()

    def write(self, frame: Frame) -> None:
        """Append a frame.

        Raises:
            InputError: the disk is full or gone.
        """
        self._range = [*self._range[:1], frame.index]
        for shard in self._shards:
            shard.write(frame)

    def finish(self) -> None:
        """Save the shards and the root, and give them their names.

        Raises:
            InputError: the disk is full or gone.
        """
        for shard in self._shards:
            set_time_range(shard.layer, self._range, self._options, self._fps)
            shard.save()
        self._shards.clear()
        set_time_range(self._root, self._range, self._options, self._fps)
        save_layer(self._root, self.path)
        del self._root
        publish(self.path)

    def abort(self) -> None:
        """Leave nothing behind."""
        self._shards.clear()
        vars(self).pop("_root", None)
        discard(self.path)
