"""USD in shards: the bodies of a big crowd over several files, each with its own point instancer, under one root."""

from pxr import Sdf, Usd, UsdGeom

from warp_immersed.ensemble import Frame
from warp_immersed.output_files import parts_folder, start_parts
from warp_immersed.usd import CROWD, CrowdWriter, Ids, create_crowd, new_layer
from warp_immersed.usd_samples import SampleWriter

SHARD_PRIM = Sdf.Path("/Crowd")


class ShardWriter(CrowdWriter):
    """options.shards point instancers in files of their own, in a folder beside a root file that refers to them.

    Each file also opens by itself. Args, Raises: as `CrowdWriter`.
    """

    def _begin(self, stage: Usd.Stage) -> None:
        UsdGeom.Xform.Define(stage, CROWD)
        folder = start_parts(self.path)
        self._shards = []
        count = self.options.shards or 1
        for index in range(count):
            ids = self.ids[index::count]  # every kind in every shard, so that all cost the same
            name = f"Crowd_{index:03d}"
            layer = new_layer(folder / f"{name}{self.path.suffix}")
            self._shards.append(self._begin_shard(layer, ids))
            prim = stage.DefinePrim(CROWD.AppendChild(name))
            spec = self.root.GetPrimAtPath(prim.GetPath())
            spec.referenceList.Prepend(Sdf.Reference(f"./{parts_folder(self.path).name}/{name}{self.path.suffix}"))

    def _begin_shard(self, layer: Sdf.Layer, ids: Ids) -> SampleWriter:
        stage = Usd.Stage.Open(layer)
        self.describe(stage)
        instancer = create_crowd(stage, SHARD_PRIM, self.prototypes, ids, self.options)
        stage.SetDefaultPrim(instancer.GetPrim())
        return self.samples(layer, SHARD_PRIM, ids)

    def _write(self, frame: Frame) -> None:
        for shard in self._shards:
            shard.write(frame)

    def _end(self, first: int, last: int) -> None:
        for shard in self._shards:
            self.set_time_range(shard.layer, first, last)
            shard.save()
        self._shards.clear()
