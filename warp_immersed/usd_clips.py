"""USD in value clips: the frames of a long shot over several files, opened as one."""

from pxr import Sdf, Usd, Vt

from warp_immersed.ensemble import Frame
from warp_immersed.output_files import parts_folder, start_parts
from warp_immersed.usd import CROWD, CrowdWriter, create_crowd, new_layer
from warp_immersed.usd_samples import SampleWriter, declare_samples, save_layer

CLIP_PRIM = Sdf.Path("/Crowd")


class ClipWriter(CrowdWriter):
    """Value clips of options.chunk_frames frames in a folder beside a root file that says when each counts.

    Each clip ends with the frame that begins the next, so that USD interpolates over the seam as in one file.

    Args, Raises: as `CrowdWriter`.
    """

    def _begin(self, stage: Usd.Stage) -> None:
        create_crowd(stage, CROWD, self.prototypes, self.ids, self.options)
        self._starts: list[int] = []
        self._clip: SampleWriter | None = None
        self._folder = start_parts(self.path)
        declared = self._new_clip_layer("manifest")
        declare_samples(declared, CLIP_PRIM, self.options)
        save_layer(declared, self.path)

    def _write(self, frame: Frame) -> None:
        if self._clip is not None and frame.index == self._starts[-1] + (self.options.chunk_frames or 0):
            self._clip.write(frame)
            self._end_clip(frame.index)
        if self._clip is None:
            layer = self._new_clip_layer(f"clip_{len(self._starts):04d}")
            self._clip = self.samples(layer, CLIP_PRIM, self.ids)
            self._starts.append(frame.index)
        self._clip.write(frame)

    def _end(self, first: int, last: int) -> None:
        self._end_clip(last)
        codes = [self.options.time_code(frame, self.fps) for frame in (*self._starts, last)]
        self.root.GetPrimAtPath(CROWD).SetInfo(
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

    def _asset(self, name: str) -> Sdf.AssetPath:
        return Sdf.AssetPath(f"./{parts_folder(self.path).name}/{name}{self.path.suffix}")

    def _new_clip_layer(self, name: str) -> Sdf.Layer:
        layer = new_layer(self._folder / f"{name}{self.path.suffix}")
        Sdf.CreatePrimInLayer(layer, CLIP_PRIM)
        layer.defaultPrim = CLIP_PRIM.name
        # without these USD would take the clip's time codes for 1/24 s
        layer.timeCodesPerSecond = layer.framesPerSecond = self.options.rate(self.fps)
        return layer

    def _end_clip(self, last: int) -> None:
        if self._clip is not None:
            self.set_time_range(self._clip.layer, self._starts[-1], last)
            self._clip.save()
            self._clip = None
