"""``cnca transfer``: each white box is attacked in turn, and every detector judges.

The folder gets::

    attacks/                one folder for each attack, as of ``cnca optimize``
    views/                  the evaluation of all camouflages, as of ``cnca evaluate``
    transfer.json, .md      the square: attacked × judging
    manifest.json           what was asked for
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from rich.console import Console

from cnca.attack.targets import parse_targets
from cnca.core.errors import CncaError, RunError
from cnca.core.files import write_text
from cnca.core.manifest import write_json
from cnca.core.records import Omitted, as_json
from cnca.core.run_folder import RunFolder
from cnca.jobs.attack.request import Request
from cnca.jobs.attack.runs import finished
from cnca.jobs.evaluate.evaluation import evaluate_scenes
from cnca.jobs.evaluate.parts import build_eyes, shared_label
from cnca.jobs.evaluate.request import EvaluationRequest
from cnca.jobs.transfer_request import Judging
from cnca.judge.records import Estimate, Evidence
from cnca.judge.verdict import TOTAL
from cnca.report.tables import cell, table, with_total

JOB = "transfer"
CONTROLS = ("random", "shuffled")
"""Beside the normal paint: what loud paint and the camouflage's own colors do."""


@dataclass(frozen=True)
class Attacked:
    """One attack of the square."""

    name: str
    """Of its row and of its folder."""
    detector: str
    """As the user gave it."""
    judge: str
    """What the same detector is called among those that judge."""
    seed: int
    problem: Omitted[str] = None
    """Why there is no camouflage."""


@dataclass(frozen=True)
class Transfer:
    """How far attacks on one detector fool the others."""

    views: int
    interval: str
    """What the intervals are."""
    scenes: Sequence[str]
    attacks: Sequence[Attacked]
    judges: Sequence[str]
    rows: Sequence[str]
    """All textures, the camouflages among them, in the order of the table."""
    AP_voc: Mapping[str, Mapping[str, Estimate]]
    """Texture → judge (or ``total``) → AP@0.5 of the vehicle (VOC, area)."""


def transfer(request: Request, judging: Judging, console: Console) -> Transfer:
    """Attack, judge, write the square; the same call goes on after an interruption.

    ``request`` is that of each attack, whose detectors are attacked one by one.  An attack that
    fails is a row that says why.

    Raises:
        CncaError: a scene, texture or judging detector cannot be used, or no attack succeeded.
    """
    detectors = list(parse_targets(request.detectors))
    specs = list(dict.fromkeys([*detectors, *judging.judges]))
    scenes = (request.scene, *judging.scenes)
    # Refuses what cannot judge before anything is attacked.
    names = [eye.name for eye in build_eyes(specs, shared_label(scenes))]
    asked = {"attack": request.as_dict(), "judging": asdict(judging)}
    RunFolder(request.out, JOB).renew(asked, {})
    planned = _plan(request, judging, dict(zip(specs, names, strict=True)))
    attacks = [_attack(request, attacked, console) for attacked in planned]
    succeeded = [attacked for attacked in attacks if attacked.problem is None]
    if not succeeded:
        raise RunError(f"{request.out}: no attack succeeded; the first: {attacks[0].problem}")
    folders = [f"{a.name}={_folder(request, a)}" for a in succeeded]
    evidence = evaluate_scenes(
        EvaluationRequest(
            out=request.out / "views",
            scenes=scenes,
            textures=(*folders, *judging.textures),
            detectors=tuple(specs),
            views=judging.views,
            controls=CONTROLS,
            seed=request.settings.seed,
        ),
        console,
    )
    results = _square(attacks, evidence)
    write_json(request.out / "transfer.json", as_json(results))
    write_text(request.out / "transfer.md", markdown(results))
    return results


def _plan(request: Request, judging: Judging, names: Mapping[str, str]) -> list[Attacked]:
    """Every detector with every seed."""
    planned = []
    for spec in parse_targets(request.detectors):
        base = "on_" + re.sub(r"[^\w.+-]", "_", names[spec])
        for seed in range(request.settings.seed, request.settings.seed + judging.seeds):
            name = base if judging.seeds == 1 else f"{base}_seed{seed}"
            planned.append(Attacked(name, spec, names[spec], seed))
    return planned


def _folder(request: Request, attacked: Attacked) -> Path:
    return request.out / "attacks" / attacked.name


def _attack(request: Request, attacked: Attacked, console: Console) -> Attacked:
    """Run one attack to its end; an attack that fails gets its reason."""
    own_request = replace(
        request,
        detectors=(f"{attacked.detector}=1",),  # a weight: the name may end in a number
        settings=replace(request.settings, seed=attacked.seed),
        out=_folder(request, attacked),
    )
    try:
        finished(own_request, attacked.name, console)
    except CncaError as error:
        console.print(f"{attacked.name}: {error}", soft_wrap=True)
        return replace(attacked, problem=str(error))
    return attacked


def _square(attacks: Sequence[Attacked], evidence: Evidence) -> Transfer:
    columns = [*evidence.detectors, TOTAL]
    return Transfer(
        views=evidence.views,
        interval=evidence.interval,
        scenes=evidence.scenes,
        attacks=attacks,
        judges=evidence.detectors,
        rows=evidence.rows,
        AP_voc={
            row: {name: evidence.all[row][name][evidence.label]["AP_voc"] for name in columns}
            for row in evidence.rows
        },
    )


def square_rows(results: Transfer) -> tuple[list[str], list[list[str]]]:
    """Head and rows: attacks first, those that failed without numbers, then all else.

    A star marks the judge that was attacked.
    """
    judges, known = with_total(results.judges), {a.name: a for a in results.attacks}
    rows = []
    for attacked in results.attacks:
        if attacked.problem is not None:
            rows.append([attacked.name, *["failed"] * len(judges)])
    for row in sorted(results.rows, key=lambda name: name not in known):
        attacked_judge = known[row].judge if row in known else None
        cells = [
            cell(results.AP_voc[row][judge], digits=2) + (" *" if judge == attacked_judge else "")
            for judge in judges
        ]
        rows.append([row, *cells])
    return ["texture", *judges], rows


def markdown(results: Transfer) -> str:
    """The square, and why attacks failed."""
    failures = [f"- {a.name}: {a.problem}\n" for a in results.attacks if a.problem]
    return (
        "# Transfer\n\n"
        f"AP@0.5 of the vehicle (VOC, area) before each detector, over {results.views} views; "
        f"scenes: {', '.join(results.scenes)}. In brackets: {results.interval}. A star marks the "
        "detector that was attacked.\n\n"
        + table(*square_rows(results))
        + ("\n## Attacks that failed\n\n" + "".join(failures) if failures else "")
    )
