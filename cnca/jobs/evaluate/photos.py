"""``cnca evaluate --photos``: the paper's Table 2 from anyone's labelled photographs.

The photographs in each folder right below ``--photos`` are one row, such as ``normal`` and
``CNCA``.  Unlike rendered views they are not the same for every row, so each row is
resampled by itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict

import cv2
import numpy as np
import torch
from rich.console import Console

from cnca.core import parallel
from cnca.core.detections import ALARM
from cnca.core.errors import RunError
from cnca.core.files import replacing
from cnca.core.manifest import hashes, write_json
from cnca.core.pictures import SrgbPicture, as_pictures, draw_boxes, side_by_side, write_png
from cnca.core.progress import bar
from cnca.core.records import as_json
from cnca.core.run_folder import RunFolder
from cnca.core.types import Detections, SrgbImages
from cnca.detect import detector_files
from cnca.detect.classes import CAR, VEHICLES, counted
from cnca.jobs.evaluate.parts import build_eyes
from cnca.jobs.evaluate.request import PhotoRequest
from cnca.judge.bootstrap import Sampled, mean, resample
from cnca.judge.candidates import named
from cnca.judge.evaluate import look
from cnca.judge.gallery import digest, kept_detections
from cnca.judge.labels import read_labels
from cnca.judge.photo import Photo
from cnca.judge.records import Comparison, PhotoEvidence
from cnca.judge.scores import rank
from cnca.judge.stage import Eye
from cnca.judge.verdict import KINDS, TOTAL, Seen, estimates, word_for
from cnca.report.paper_tables import TABLE2, TABLE2_COLUMNS, quoted_table
from cnca.report.tables import cell, column_titles, table, with_total

SHOWN, SHOWN_WIDTH = 6, 400
"""Photographs of each row on the contact sheet, and their width in pixels."""


def evaluate_photos(request: PhotoRequest, console: Console) -> PhotoEvidence:
    """Look at all photographs, judge, write everything; returns what ``results.json`` holds.

    Raises:
        RunError: photographs or labels cannot be used.
        DetectorError: a detector cannot be used.
    """
    photos = read_labels(request.photos, request.labels, request.label_names)
    eyes = build_eyes(request.detectors)
    parallel.by_first(lambda: _write_manifest(request, photos))
    looked: list[dict[str, list[Detections]]] = []
    with bar(console) as shown:
        numbers = parallel.share(range(len(photos)))
        for number in shown.track(numbers, description="photographs"):
            image, by_eye = read_photo(photos[number]), {}
            for eye in eyes:
                path = request.out / "detections" / eye.folder / f"photo{number:05d}.npz"

                def reported(eye: Eye = eye, image: SrgbImages = image) -> list[Detections]:
                    return look(eye.detector, image)

                by_eye[eye.name] = kept_detections(path, digest(image, eye.key), reported)
            looked.append(by_eye)
    every = parallel.gathered(looked)
    seen = {
        eye.name: Seen([d for by_eye in every for d in by_eye[eye.name]], eye.detector.class_names)
        for eye in eyes
    }
    return parallel.by_first(lambda: _conclude(request, photos, eyes, seen))


def _conclude(
    request: PhotoRequest, photos: Sequence[Photo], eyes: Sequence[Eye], seen: Mapping[str, Seen]
) -> PhotoEvidence:
    results = judge_photos(photos, seen, request.seed)
    sheets = [f"photos_{eye.folder}.png" for eye in eyes]
    for eye, name in zip(eyes, sheets, strict=True):
        write_png(request.out / name, _contact_sheet(photos, seen[eye.name]))
    write_json(request.out / "results.json", as_json(results))
    _write_table2(request, results, sheets)
    return results


def judge_photos(photos: Sequence[Photo], seen: Mapping[str, Seen], seed: int) -> PhotoEvidence:
    """The AP of every group with intervals, and the differences to the first group.

    The group called ``normal``, in whatever case, comes first.
    """
    groups = sorted({photo.group for photo in photos}, key=lambda g: (g.lower() != "normal", g))
    measured, counts = {}, {}
    for number, group in enumerate(groups):
        numbers = [i for i, photo in enumerate(photos) if photo.group == group]
        counts[group] = len(numbers)
        weights = resample([len(numbers)], seed=seed + number)
        measured[group] = _measure([photos[i] for i in numbers], numbers, seen, weights)
    comparisons = []
    for group in groups[1:]:
        fewer = min(counts[group], counts[groups[0]])
        for detector in (*seen, TOTAL):
            first = measured[groups[0]][detector][CAR]["AP_voc"]
            difference = measured[group][detector][CAR]["AP_voc"] - first
            comparisons.append(
                Comparison(
                    **asdict(difference.estimate()),
                    candidate=group,
                    control=groups[0],
                    detector=detector,
                    verdict=word_for(difference, fewer),
                )
            )
    return PhotoEvidence(
        photos=counts,
        interval="95 %, percentile bootstrap over photographs",
        seed=seed,
        rows=groups,
        detectors=list(seen),
        all=estimates(measured),
        comparisons=comparisons,
    )


def read_photo(photo: Photo) -> SrgbImages:
    """The photograph, upright, (1, 3, height, width) in [0, 1].

    Raises RunError where it cannot be read or has another size than its labels say.
    """
    pixels = cv2.imdecode(np.fromfile(photo.path, np.uint8), cv2.IMREAD_COLOR)
    if pixels is None:
        raise RunError(f"{photo.path}: cannot be decoded; is it a picture?")
    height, width = pixels.shape[:2]
    if photo.size not in (None, (width, height)):
        stated = "×".join(map(str, photo.size or ()))
        raise RunError(f"{photo.path}: has {width}×{height} pixels, its labels say {stated}")
    rgb = np.ascontiguousarray(pixels[..., ::-1])
    return SrgbImages(torch.from_numpy(rgb).permute(2, 0, 1)[None].float() / 255)


def _measure(
    photos: Sequence[Photo], numbers: Sequence[int], seen: Mapping[str, Seen], weights: torch.Tensor
) -> dict[str, dict[str, dict[str, Sampled]]]:
    """Detector → column → AP of each kind, for the photographs of these numbers."""
    table: dict[str, dict[str, dict[str, Sampled]]] = {}
    for name, observed in seen.items():
        table[name] = {}
        for column, classes in counted().items():
            truths = [photo.boxes(classes) for photo in photos]
            ignored = [torch.tensor(photo.ignored).reshape(-1, 4) for photo in photos]
            chosen = [observed.detections[i] for i in numbers]
            part = Seen(chosen, observed.class_names).column(column)
            rankings = {kind: rank(part, truths, 0, kind=kind, ignored=ignored) for kind in KINDS}
            table[name][column] = {
                f"AP_{kind}": Sampled(ranking.average_precision(weights))
                for kind, ranking in rankings.items()
            }
    table[TOTAL] = {
        column: {
            f"AP_{kind}": mean([table[name][column][f"AP_{kind}"] for name in seen])
            for kind in KINDS
        }
        for column in counted()
    }
    return table


def _write_table2(request: PhotoRequest, results: PhotoEvidence, pictures: list[str]) -> None:
    detectors = with_total(results.detectors)
    parts = [
        "# Table 2: photographs\n",
        ", ".join(f"{group}: {count} photographs" for group, count in results.photos.items())
        + f". In brackets: {results.interval}.\n",
    ]
    for column, title in column_titles(CAR).items():
        cells = {
            row: [cell(results.all[row][name][column]["AP_voc"]) for name in detectors]
            for row in results.rows
        }
        quoted = TABLE2 if request.paper_figures and column == CAR else {}
        columns = TABLE2_COLUMNS if quoted else ()
        parts += [
            f"## AP@0.5 {title} (Pascal VOC 2010–2012, area)\n",
            quoted_table(tuple(quoted), cells, detectors, quoted, columns),
        ]
    if results.comparisons:
        rows = [
            [c.candidate, c.control, c.detector, cell(c), c.verdict]
            for c in results.comparisons
            if c.detector in detectors
        ]
        head = ["photographs", "against", "detector", "difference of AP@0.5", "verdict"]
        parts += ["## Differences\n", table(head, rows)]
    parts += ["## Pictures\n", *(f"![{name}]({name})\n" for name in pictures)]
    with replacing(request.out / "results.md") as temporary:
        temporary.write_text("\n".join(parts), encoding="utf-8")


def _contact_sheet(photos: Sequence[Photo], seen: Seen) -> SrgbPicture:
    """The first photographs of each row with labels in green and detections of 0.25 in red."""
    tiles, captions = [], []
    for group in dict.fromkeys(photo.group for photo in photos):
        numbers = [i for i, photo in enumerate(photos) if photo.group == group][:SHOWN]
        for i in numbers:
            picture = as_pictures(read_photo(photos[i]))[0]
            scale = SHOWN_WIDTH / picture.shape[1]
            small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            sure = seen.detections[i].above(ALARM)
            scaled = Detections(sure.boxes * scale, sure.scores, sure.labels)
            truth = photos[i].boxes(VEHICLES) * scale
            tiles.append(draw_boxes(small, scaled, seen.class_names, truth))
            captions.append(group)
    return side_by_side(tiles, captions, columns=SHOWN)


def _write_manifest(request: PhotoRequest, photos: Sequence[Photo]) -> None:
    inputs = [request.labels, *(photo.path for photo in photos)]
    for spec in request.detectors:
        inputs += detector_files(named(spec)[1])
    RunFolder(request.out, "evaluate --photos").renew(request, hashes(inputs))
