"""What data sets, meshes and trainings say."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table

from cnca.core import parallel

if TYPE_CHECKING:
    from cnca.jobs.vehicle.reorder_uv import Source


_LAYOUT = {
    "charts": "charts",
    "seam_length": "seams, m",
    "stretch": "L² stretch",
    "density_spread": "texels per metre, 95th over 5th percentile",
    "used": "share of the texture in use",
    "overlap": "share of it used twice",
}
"""Of the painted faces that can be seen from outside."""


@parallel.joined()
def dataset(scene: Path, out: Path, **options: Any) -> None:
    """Render a data set with progress, then say how far it has come."""
    from cnca.jobs.datasets.rendered import render_dataset

    console = Console(stderr=True, quiet=parallel.rank() > 0)
    report = render_dataset(scene, out, console=console, **options)
    speed = report.per_second
    rate = f", {parallel.count() * speed:.2f} a second" if speed else ""
    Console().print(
        f"{out}: {report.rendered} pictures rendered{rate}, {report.done} there in all",
        soft_wrap=True,
    )


def reorder_uv(source: Source, out: Path, size: int) -> None:
    """Write a vehicle with a new UV layout, then compare the layouts."""
    from cnca.jobs.vehicle.reorder_uv import reorder_uv as write_reordered

    report, shown = write_reordered(source, out, size=size), Console()
    listed = Table("layout", f"before: {report.was}", "after")
    for key, meaning in _LAYOUT.items():
        listed.add_row(
            meaning, *(f"{getattr(layout, key):.4g}" for layout in (report.before, report.after))
        )
    shown.print(listed)
    shown.print(f"scene: vehicle: {json.dumps(report.vehicle)}", soft_wrap=True)
    for ending in ("obj", "json", "png"):
        shown.print(out.with_suffix(f".{ending}"), soft_wrap=True)


def import_carla(folder: Path, out: Path, scene: Path, *, fov: float) -> None:
    """Turn frames into a data set with progress, then say how well the mesh meets them."""
    from cnca.jobs.datasets.carla import FrameProblem
    from cnca.jobs.datasets.carla import import_carla as import_frames

    listed = Table("frame", "lift, m", "outline, px: median", "90th percentile")
    for record in import_frames(folder, out, scene, fov=fov, console=Console(stderr=True)):
        if isinstance(record, FrameProblem):
            listed.add_row(record.source, record.problem, "", "")
            continue
        pixels = record.outline_pixels
        numbers = f"{record.lift:.3f}", f"{pixels.median:.1f}", f"{pixels.percentile_90:.1f}"
        listed.add_row(record.source, *numbers)
    Console().print(listed)
    Console().print(out, soft_wrap=True)


@parallel.joined()
def train_efr(out: Path, **options: Any) -> None:
    """Train with progress, then say what it came to."""
    from cnca.jobs.train_efr import train_efr as train  # loads the renderer

    console = Console(stderr=True, quiet=parallel.rank() > 0)
    report = train(out, console=console, **options)
    print(
        f"{out}: mean absolute error {report['error_before']:.4f} before, "
        f"{report['error_after']:.4f} after, on {report['test_views']} views not trained on"
    )
    if options["carla"]:
        print("one car in one paint: says nothing about other textures, cars or weathers")
