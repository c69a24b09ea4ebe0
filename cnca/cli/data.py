"""Commands that make data sets."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cnca.cli.app import app
from cnca.cli.help import VEHICLES
from cnca.cli.options import Given, takes
from cnca.core.options import OUTPUT, WHAT
from cnca.jobs.datasets.request import DatasetRequest


@app.command("render-dataset", rich_help_panel=VEHICLES)
@takes(DatasetRequest)
def render_dataset(given: Given[DatasetRequest]) -> None:
    """Render 16 weathers, poses and colors with COCO annotations, masks, poses and weather."""
    from cnca.cli import show
    from cnca.core import parallel
    from cnca.jobs.datasets.rendered import render_dataset

    request = given.record()
    with parallel.joined():
        show.dataset(request.out, render_dataset(request, show.messages()))


@app.command("import-carla", rich_help_panel=VEHICLES)
def import_carla(
    folder: Annotated[Path, typer.Argument(help="Folder of .npz frames.", rich_help_panel=WHAT)],
    out: Annotated[Path, typer.Option(help="Folder for the data set.", rich_help_panel=OUTPUT)],
    scene: Annotated[
        Path, typer.Option(help="Scene file with the frames' vehicle.", rich_help_panel=WHAT)
    ] = Path("scenes/etron_carla.yaml"),
    fov: Annotated[
        float, typer.Option(help="Horizontal field of view in degrees.", rich_help_panel=WHAT)
    ] = 90.0,
) -> None:
    """Turn CARLA frames into a labelled data set, and say how well the mesh meets them."""
    from cnca.cli import show
    from cnca.jobs.datasets.carla import import_carla

    show.frames(out, import_carla(folder, out, scene, fov=fov, console=show.messages()))
