"""Checkpoints: the whole state of a run after one of its frames, in a file that is replaced in one stroke."""

import json
import os
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warp_immersed.errors import InputError
from warp_immersed.output_files import hidden_beside


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """Where a run stood: after frame number `frame` and body_steps substeps, its device held `state`, arrays by name."""

    frame: int
    body_steps: int
    state: Mapping[str, NDArray[Any]]
    manifest: Mapping[str, Any]

    def save(self, path: Path) -> None:
        """Write it; an earlier one stays until this one is whole and on the disk.

        Raises:
            OSError: the disk is full or gone.
        """
        part = path.with_name(path.name + ".part")
        header = json.dumps({"frame": self.frame, "body_steps": self.body_steps, "manifest": self.manifest})
        try:
            with part.open("wb") as file:
                np.savez(file, header=np.array(header), **self.state)  # type: ignore[arg-type]
                file.flush()
                os.fsync(file.fileno())
            os.replace(part, path)
        except BaseException:
            part.unlink(missing_ok=True)
            raise

    @staticmethod
    def load(path: Path) -> "Checkpoint":
        """Read one.

        Raises:
            InputError: it is damaged.
        """
        try:
            with np.load(path) as stored:
                header = json.loads(str(stored["header"]))
                state = {name: stored[name] for name in stored.files if name != "header"}
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise InputError(f"checkpoint {str(path)!r}: damaged ({error}); run without --resume") from error
        return Checkpoint(header["frame"], header["body_steps"], state, header["manifest"])


def checkpoint_path(path: Path) -> Path:
    """Where the checkpoint of an output is kept while it is written."""
    return hidden_beside(path, "checkpoint", ".npz")


def check_same_run(path: Path, found: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Refuse to go on with an output whose manifest differs from that of the run that would go on with it.

    Raises:
        InputError: the first entry that differs, what it is there and what it is here.
    """
    told_last = ("scene_digest", "model_digest")
    for key in sorted(wanted, key=lambda key: key in told_last):
        if key != "scene_text" and found.get(key) != wanted[key]:
            there, here = (str(values.get(key))[:40] for values in (found, wanted))
            raise InputError(
                f"output {str(path)!r}: cannot go on with another run: its {key.replace('_', ' ')} is {there!r}, not {here!r}; "
                f"restore that, or run without --resume"
            )
