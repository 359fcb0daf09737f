"""`warp-immersed new`."""

import os
from pathlib import Path
from typing import Annotated

import typer

from warp_immersed.commands.output import check_folder
from warp_immersed.errors import InputError

STARTING_SCENE = """\
# Two hundred birch leaves fall in a light wind.
duration = 6.0                    # s
fps = 24
seed = 1                          # another number, another fall
fluid = "air"                     # or "water", or { density = 1.2, kinematic_viscosity = 1.5e-5 }

[wind]                            # uniform mean wind; y is up
velocity = [0.6, 0.0, 0.0]        # m/s

[turbulence]                      # gusts; leave the table out for still air
kind = "homogeneous"              # or "boundary_layer", or "grid" with a baked field
k = 0.05                          # kinetic energy, m^2/s^2: here gusts of 0.18 m/s a component
epsilon = 0.02                    # its dissipation, m^2/s^3: gusts last about k / (4 epsilon) seconds

[ground]                          # leave the table out to let bodies fall for ever
height = 0.0                      # y of a plane, m
layering = 0.002                  # m: landed bodies lie up to so much apart in height, so that they do not flicker
# mesh = "courtyard.obj"          # what stands on it
# hills = { height = 0.5, length = 6.0, size = [30.0, 30.0] }

# [bounds]                        # bodies that leave this box stop there
# lower = [-20.0, -1.0, -20.0]
# upper = [20.0, 20.0, 20.0]

[[bodies]]                        # one such table for each kind
name = "birch"
count = 200
shape = { library = "birch_leaf", length = 0.05 }   # `warp-immersed info` lists the library
# shape = { mesh = "my_leaf.obj", scale = 0.01 }    # your own; open sheets need density and thickness
# density = 500.0                 # of the material, kg/m^3
# thickness = 2e-4                # of a sheet, m
# colors = [[0.68, 0.46, 0.03], [0.50, 0.46, 0.07]] # linear RGB
emitter = { kind = "box", center = [0.0, 4.0, 0.0], size = [4.0, 2.0, 4.0], duration = 3.0 }

# [view]                          # where `warp-immersed preview` stands; without it the bodies are framed automatically
# position = [0.0, 1.5, 6.0]      # m
# target = [0.0, 2.0, 0.0]
"""


def new(name: Annotated[str, typer.Argument(help="Name or path of the scene to write.")]) -> None:
    """Write a commented scene file to start from; an existing file is never overwritten."""
    path = Path(name if name.endswith(".toml") else f"{name}.toml")
    check_folder(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
    except FileExistsError as error:
        raise InputError(f"{str(path)!r}: exists already and is left as it is; choose another name") from error
    with open(handle, "w", encoding="utf-8", newline="\n") as file:
        file.write(STARTING_SCENE)
    typer.echo(f"{path}: edit it, then warp-immersed run {path}")
