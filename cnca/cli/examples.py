"""Worked examples, with which each command's help ends."""

from __future__ import annotations

from collections.abc import Iterable

import typer

from cnca.cli.help import Command

SCENE = "--scene builtin:sedan_clear"
EXAMPLES = {
    "": ["doctor", "demo", "optimize --help"],
    "doctor": ["doctor"],
    "render-scene": [
        "render-scene builtin:sedan_fog -o fog.png --spp 64",
        "render-scene my.yaml -o layers.exr --all-views --target-error 0.05 --explain",
    ],
    "view": [
        "view builtin:street_day --detector builtin",
        'view builtin:sedan_fog --prompt "zebra strips" --target-error 0.1',
    ],
    "watch": ["watch out/sedan", "watch out/sedan out/sedan_1"],
    "turntable": [
        "turntable out/sedan",
        "turntable out/sedan --scene builtin:street_fog --frames 36 --out turn.gif",
    ],
    "accuracy": ["accuracy builtin:sedan_clear --out out/accuracy --seconds 600"],
    "accuracy-generator": ["accuracy-generator --out out/prices --probes 5"],
    "calibrate": ["calibrate --out out/prices --scenes 8"],
    "optimize": [
        f'optimize {SCENE} --prompt "colorful camouflage" --steps 220 --out out/sedan',
        f'optimize {SCENE} --prompt "graffiti" --tau auto --min-prompt-score 0.3 --out out/auto',
    ],
    "tradeoff": [f'tradeoff {SCENE} --prompt "zebra stripes" --taus 0.5,1,inf --out out/taus'],
    "prompts": [f'prompts {SCENE} "zebra stripes" "yellow black graffiti" --out out/prompts'],
    "transfer": [
        f'transfer {SCENE} --prompt "zebra strips" --detector a.onnx --detector b.cfg '
        "--judge c.onnx --judge-scene builtin:sedan_fog --out out/transfer"
    ],
    "demo": ["demo --out out/demo --steps 40"],
    "evaluate": [
        f"evaluate {SCENE} --texture out/sedan --views 48 --out out/evidence",
        f"evaluate {SCENE} --texture mine=paint.png --detector yolo=yolov3.cfg --out out/yolo",
    ],
    "table1": [f"table1 {SCENE} --texture Ours=out/sedan --out out/table1"],
    "judge-style": [
        "judge-style out/sedan",
        'judge-style mine=paint.png --prompt "zebra strips" --prompt "red plaid"',
    ],
    "train-style-judge": ["train-style-judge --out out/style_judge"],
    "render-dataset": ["render-dataset --scene builtin:sedan_clear --out out/data --images 64"],
    "import-carla": ["import-carla ../carla --out out/carla --scene scenes/etron_carla.yaml"],
    "reorder-uv": ["reorder-uv my_car.obj -o out/my_car.obj --up z --paint-mask mask.png"],
    "train-generator": ["train-generator --out out/generator --resume"],
    "train-scorer": ["train-scorer --out out/scorer --corpus out/generator"],
    "train-detector": ["train-detector --out out/detector --kind anchor-free"],
    "train-efr": ["train-efr --from-render builtin:sedan_clear --out out/efr.safetensors"],
    "harden": ["harden --texture out/sedan --out out/hardened --pictures 240"],
    "rerun": ["rerun out/sedan/manifest.json --out out/again"],
    "report": ["report out/sedan --turntable 36"],
    "survey": ["survey build --images pictures --out out/survey", "survey serve out/survey"],
    "survey build": ["survey build --images pictures --out out/survey"],
    "survey serve": ["survey serve out/survey --port 8080"],
    "survey score": ["survey score out/survey"],
    "check-world": [
        "check-world town.obj --scale 0.0254",
    ],
    "check-vehicle": [
        "check-vehicle my_car.glb --out out/check",
        "check-vehicle my_car.obj --up z --front -y --scale 0.01 --json",
    ],
    "print-sheets": ["print-sheets out/sedan --scale 1:12 --paper A3 --out out/sedan.pdf"],
    "gallery": ["gallery --out out/gallery.png", "gallery scenes/hard"],
}
"""Command, or nothing for ``cnca`` itself → what to write after ``cnca``."""


def add_examples(app: typer.Typer, prefix: str = "") -> None:
    """Let the help of all commands come in panels and end with examples."""
    app.info.epilog = _written(EXAMPLES[prefix.strip()])
    for command in app.registered_commands:
        assert command.callback is not None
        command.cls = Command
        name = prefix + (command.name or command.callback.__name__)
        command.epilog = _written(EXAMPLES.get(name, []))
    for group in app.registered_groups:
        assert group.typer_instance is not None
        add_examples(group.typer_instance, f"{prefix}{group.name} ")


def _written(examples: Iterable[str]) -> str:
    return "\n".join(["Examples:", *(f"  cnca {example}" for example in examples)])
