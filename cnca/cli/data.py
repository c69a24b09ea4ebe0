"""Commands that make data sets and mend meshes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cnca.cli.app import app
from cnca.cli.help import VEHICLES
from cnca.cli.options import Samples


@app.command("render-dataset", rich_help_panel=VEHICLES)
def render_dataset(
    scene: Annotated[Path, typer.Option(help="Scene file.")],
    out: Annotated[Path, typer.Option(help="Folder; the same command goes on in it.")],
    images: Annotated[int | None, typer.Option(help="Pictures; by default the whole grid.")] = None,
    shard: Annotated[str, typer.Option(help="Which part to render, such as 2/4.")] = "1/1",
    tar: Annotated[bool, typer.Option("--tar", help="Pack WebDataset tars, too.")] = False,
    spp: Samples = None,
) -> None:
    """Render 16 weathers, poses and colours with COCO annotations, masks, poses and weather."""
    from cnca.cli import data_output as terminal

    terminal.dataset(scene, out, images=images, shard=shard, tar=tar, samples=spp)


@app.command("import-carla", rich_help_panel=VEHICLES)
def import_carla(
    folder: Annotated[Path, typer.Argument(help="Folder of .npz frames.")],
    out: Annotated[Path, typer.Option(help="Folder for the data set.")],
    scene: Annotated[Path, typer.Option(help="Scene file with the frames' vehicle.")] = Path(
        "scenes/etron_carla.yaml"
    ),
    fov: Annotated[float, typer.Option(help="Horizontal field of view in degrees.")] = 90.0,
) -> None:
    """Turn CARLA frames into a labelled data set, and say how well the mesh meets them."""
    from cnca.cli import data_output as terminal

    terminal.import_carla(folder, out, scene, fov=fov)


@app.command("reorder-uv", rich_help_panel=VEHICLES)
def reorder_uv(
    mesh: Annotated[str, typer.Argument(help="Mesh file, or builtin:NAME.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="OBJ file to write.")],
    up: Annotated[str, typer.Option(help="The file's upward axis.")] = "y",
    front: Annotated[str, typer.Option(help="The file's forward axis.")] = "+x",
    scale: Annotated[float, typer.Option(help="Metres per unit of the file.")] = 1.0,
    paint_mask: Annotated[Path | None, typer.Option(help="White where there is paint.")] = None,
    base_texture: Annotated[Path | None, typer.Option(help="The car's own texture.")] = None,
    size: Annotated[int, typer.Option(help="Texels per side of carried textures.")] = 2048,
) -> None:
    """Lay out a vehicle's UVs so that its painted outside is connected, and compare."""
    from cnca.cli import data_output as terminal
    from cnca.jobs.vehicle.reorder_uv import Source

    terminal.reorder_uv(Source(mesh, up, front, scale, paint_mask, base_texture), out, size)
