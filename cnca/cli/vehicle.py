"""Commands for one's own vehicle: is it fit, and how does it look in print and in pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cnca.cli.app import app
from cnca.cli.help import BEGIN, VEHICLES
from cnca.cli.options import Given, takes
from cnca.core.options import COST, OUTPUT, WHAT
from cnca.jobs.vehicle.source import Source


@app.command("check-vehicle", rich_help_panel=VEHICLES)
def check_vehicle(
    mesh: Annotated[
        str,
        typer.Argument(help="Mesh, builtin:NAME, or a scene file with one.", rich_help_panel=WHAT),
    ],
    up: Annotated[
        str | None, typer.Option(help="The file's upward axis; default y.", rich_help_panel=WHAT)
    ] = None,
    front: Annotated[
        str | None, typer.Option(help="Its forward axis; default +x.", rich_help_panel=WHAT)
    ] = None,
    scale: Annotated[
        float | None, typer.Option(help="Metres per unit; default 1.", rich_help_panel=WHAT)
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for pictures and the report.", rich_help_panel=OUTPUT),
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print the report as JSON.", rich_help_panel=OUTPUT)
    ] = False,
) -> None:
    """Say what stands between a mesh and an attack on it, and what mends it.

    Exit code 0 if the vehicle can be attacked, 1 if a fault stops that.
    """
    import json as text

    from cnca.cli import show
    from cnca.jobs.vehicle.check_vehicle import check_vehicle

    given = {"up": up, "front": front, "scale": scale}
    report = check_vehicle(mesh, out, **{k: v for k, v in given.items() if v is not None})
    if json:
        typer.echo(text.dumps(report.content(), indent=2))
    else:
        for finding in report.findings:
            typer.echo(finding.line())
        typer.echo("usable" if report.usable else "not usable as it is")
        typer.echo(f"scene: vehicle: {text.dumps(report.vehicle)}")
        if out is not None:
            scene = out / "scene.yaml"
            attack = ["optimize", "--scene", scene, "--prompt", "colorful camouflage"]
            following = [[*attack, "--out", f"{out}_attack"]] if report.usable else []
            show.ending({"scene": scene, "picture": out / "vehicle.png"}, *following)
    raise typer.Exit(0 if report.usable else 1)


@app.command("check-world", rich_help_panel=VEHICLES)
def check_world(
    mesh: Annotated[Path, typer.Argument(help="OBJ, PLY, glTF or Mitsuba XML file.")],
    up: Annotated[str | None, typer.Option(help="Its up axis; y for glTF and XML, else z.")] = None,
    scale: Annotated[float, typer.Option(help="Metres per unit.")] = 1.0,
) -> None:
    """Say what stands between a world's file and a vehicle in it, and which keys mend it.

    Exit code 0 if a vehicle can stand in it, 1 if it cannot.
    """
    import json

    from cnca.world.checkup import check_world

    report = check_world(mesh, up=up, scale=scale)
    if mesh.suffix.lower() == ".xml":
        from cnca.mi_bridge.xml_world import refuse_unknown_plugins

        refuse_unknown_plugins(mesh)
    for finding in report.findings:
        typer.echo(finding)
    typer.echo(f"scene: world: {json.dumps(report.section)}")
    raise typer.Exit(0 if report.usable else 1)


@app.command("reorder-uv", rich_help_panel=VEHICLES)
@takes(Source)
def reorder_uv(
    source: Given[Source],
    out: Annotated[
        Path, typer.Option("-o", "--out", help="OBJ file to write.", rich_help_panel=OUTPUT)
    ],
    size: Annotated[
        int, typer.Option(help="Texels per side of carried textures.", rich_help_panel=OUTPUT)
    ] = 2048,
) -> None:
    """Lay out a vehicle's UVs so that its painted outside is connected, and compare."""
    from cnca.cli import show
    from cnca.jobs.vehicle.reorder_uv import reorder_uv

    show.layouts(out, reorder_uv(source.record(), out, size=size))


@app.command("print-sheets", rich_help_panel=VEHICLES)
def print_sheets(
    run: Annotated[
        Path, typer.Argument(help="Folder of a finished cnca optimize.", rich_help_panel=WHAT)
    ],
    out: Annotated[
        Path, typer.Option(help="PDF to write; a report goes beside it.", rich_help_panel=OUTPUT)
    ],
    scale: Annotated[str, typer.Option(help="Of the model.", rich_help_panel=OUTPUT)] = "1:12",
    paper: Annotated[
        str, typer.Option(help="A4 to A1, Letter or Tabloid.", rich_help_panel=OUTPUT)
    ] = "A4",
    profile: Annotated[
        Path | None,
        typer.Option(
            help="ICC profile of the printer; default offset, coated paper.", rich_help_panel=OUTPUT
        ),
    ] = None,
    no_judge: Annotated[
        bool,
        typer.Option(
            "--no-judge",
            help="Do not predict the attack's strength in print.",
            rich_help_panel=COST,
        ),
    ] = False,
) -> None:
    """Print a camouflage for a model car: panels of true size, and what printing costs."""
    from cnca.cli import show
    from cnca.jobs.printing.print_sheets import markdown, print_sheets, read_scale

    report = print_sheets(
        run,
        out,
        scale=read_scale(scale),
        paper=paper,
        profile=profile,
        judged=not no_judge,
        console=show.messages(),
    )
    show.line(markdown(report))
    show.ending({"sheets": out})


@app.command(rich_help_panel=BEGIN)
def gallery(
    folder: Annotated[
        Path | None,
        typer.Argument(
            help="Folder of scene files; default the shipped ones.", rich_help_panel=WHAT
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Sheet to render, .png.", rich_help_panel=OUTPUT)
    ] = None,
    width: Annotated[
        int, typer.Option(help="Pixels per row of the sheet.", rich_help_panel=OUTPUT)
    ] = 960,
    no_captions: Annotated[
        bool,
        typer.Option(
            "--no-captions",
            help="Write no names into it; the list has its order.",
            rich_help_panel=OUTPUT,
        ),
    ] = False,
) -> None:
    """List the shipped scenes, or a folder's, and render them into one sheet."""
    from cnca.cli import show
    from cnca.jobs.scene_gallery import entries, write_sheet

    listed = entries(folder)
    rows = []
    for entry in listed:
        scene = entry.scene
        cells = (
            (Path(scene.vehicle.mesh).name, entry.weather(), str(len(scene.cameras)))
            if scene
            else ()
        )
        rows.append([entry.name, *(cells or (entry.problem, "", ""))])
    show.table(["scene", "vehicle", "weather", "cameras"], rows)
    if out is not None:
        problems = write_sheet(listed, out, show.messages(), width=width, captions=not no_captions)
        for name, problem in problems.items():
            show.line(f"{name}: not rendered: {problem}")
        show.ending({"picture": out})
