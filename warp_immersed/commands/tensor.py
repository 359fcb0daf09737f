"""`warp-immersed tensor`."""

from pathlib import Path
from typing import Annotated

import typer

from warp_immersed.commands.console import notes_printed, solving_report, start_warp
from warp_immersed.errors import InputError


def tensor(
    mesh: Annotated[Path, typer.Argument(help="A mesh file: closed, or open with a thickness.")],
    thickness: Annotated[float | None, typer.Option(help="Of an open sheet, m.")] = None,
    density: Annotated[float | None, typer.Option(help="Of the material, kg/m^3: adds shares of mass and inertia.")] = None,
    fluid: Annotated[str, typer.Option(help="air, water, or a density in kg/m^3.")] = "air",
    scale: Annotated[float, typer.Option(help="Multiplies the mesh's coordinates.")] = 1.0,
    tolerance: Annotated[float, typer.Option(help="Relative error wanted.")] = 0.01,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    cache: Annotated[bool, typer.Option(help="Look it up on disk, and keep it there.")] = True,
) -> None:
    """Print the added mass (Kirchhoff tensor) of a mesh."""
    import json as json_module

    start_warp()
    from warp_immersed.added_mass import kirchhoff_solution
    from warp_immersed.fluid import PRESETS, Fluid
    from warp_immersed.shape import Shape
    from warp_immersed.tensor_report import tensor_dict, tensor_table

    if fluid in PRESETS:
        medium = PRESETS[fluid]
    else:
        try:
            medium = Fluid(float(fluid), 1e-6)
        except ValueError as error:
            raise InputError(f"fluid: found {fluid!r}, must be air, water or a positive density [kg/m^3]") from error
    with notes_printed():
        shape = Shape.from_mesh(mesh, 1000.0 if density is None else density, thickness, scale=scale)
        with solving_report() as report:
            solution = kirchhoff_solution(shape, medium, tolerance=tolerance, cache=cache, progress=report)
    if json:
        typer.echo(json_module.dumps(tensor_dict(solution, shape, medium, mesh.name, density is not None), indent=1))
    else:
        typer.echo(tensor_table(solution, shape, medium, mesh.name, density is not None))
