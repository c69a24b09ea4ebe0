"""The key of kept pictures: nothing that a scene says, or is drawn by, can be forgotten in it."""

import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import get_args

import pytest
from pydantic import BaseModel

from cnca import build
from cnca.core import manifest
from cnca.core.manifest import DRAWING, hashes, program
from cnca.judge.gallery import digest
from cnca.judge.stage import scene_key
from cnca.scene.schema import Scene
from cnca.vehicle.builtin.sedan import build_sedan

ELSEWHERE = {"base"}
"""Fields that say where files lie: these count by their contents."""


def key(scene: Scene, *drawn: object, samples: int | None = 4) -> str:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # pydantic's, of values of another type
        return scene_key(scene, *drawn, files={}, backend="mitsuba", samples=samples)


def sections(annotation: object) -> list[type[BaseModel]]:
    """All kinds of section that a field may hold, alone, in a union or in a tuple."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [kind for part in get_args(annotation) for kind in sections(part)]


def filled(kind: type[BaseModel]) -> BaseModel:
    """A section with something in every field that has no default."""
    needed = [name for name, field in kind.model_fields.items() if field.is_required()]
    return kind.model_construct(**dict.fromkeys(needed, "needed"))


def with_one_change(model: BaseModel) -> Iterator[tuple[str, BaseModel, BaseModel]]:
    """For every field below ``model``: its path, and ``model`` before and after it changes."""
    for name, field in type(model).model_fields.items():
        yield name, model, model.model_copy(update={name: "another"})
        for kind in sections(field.annotation):
            inner, many = filled(kind), isinstance(getattr(model, name), tuple)
            for path, before, after in with_one_change(inner):
                pair = [
                    model.model_copy(update={name: (part,) if many else part})
                    for part in (before, after)
                ]
                yield f"{name}.{kind.__name__}.{path}", *pair


CHANGES = list(with_one_change(Scene()))


def test_the_walk_reaches_all_of_the_schema():
    paths = {path for path, *_ in CHANGES}
    assert {"vehicle", "vehicle.VehicleSection.finish.FinishSection.roughness"} <= paths
    assert {"fog.FogSection.asymmetry", "image.ImageSection.exposure"} <= paths
    assert {"cameras.OrbitCamera.fov", "cameras.CarlaCamera.lift"} <= paths
    assert len(paths) == len(CHANGES) > 50


@pytest.mark.parametrize(("path", "before", "after"), CHANGES, ids=[path for path, *_ in CHANGES])
def test_every_field_of_the_scene_changes_the_key(path, before, after):
    assert key(before) == key(before.model_copy())
    if path in ELSEWHERE:
        assert key(before) == key(after)
    else:
        assert key(before) != key(after)


def test_what_is_made_of_the_scene_and_how_it_is_drawn_change_the_key():
    scene, vehicle = Scene(), build_sedan()
    moved = vehicle.parts[0].vertices.copy()
    moved[-1, -1] += 1e-6
    first = replace(vehicle.parts[0], vertices=moved)
    keys = {
        key(scene, vehicle),
        key(scene, replace(vehicle, parts=(first, *vehicle.parts[1:]))),
        key(scene, replace(vehicle, paint=replace(vehicle.paint, roughness=0.123))),
        key(scene, vehicle, samples=5),
        scene_key(scene, vehicle, files={}, backend="raster", samples=4),
        scene_key(scene, vehicle, files={"a": "1"}, backend="mitsuba", samples=4),
    }
    assert len(keys) == 6
    assert key(scene, vehicle) == key(scene, build_sedan())


def test_files_count_by_their_contents(tmp_path):
    for folder, content in (("a", "1"), ("b", "1"), ("c", "2")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "mask.png").write_text(content)

    def files(folder: str) -> dict[str, str]:
        vehicle = {"paint_mask": "mask.png"}
        scene = Scene.model_validate({"vehicle": vehicle, "base": tmp_path / folder})
        assert build.files_behind(scene) == [tmp_path / folder / "mask.png"]
        return hashes(build.files_behind(scene))

    a, b, c = (
        scene_key(Scene(), files=files(folder), backend="mitsuba", samples=4) for folder in "abc"
    )
    assert a == b != c


def test_the_program_that_draws_counts_by_its_sources(tmp_path, monkeypatch):
    """A copy of the package, of which one line of the renderer is changed."""
    import shutil

    copy = shutil.copytree(
        manifest.PACKAGE, tmp_path / "cnca", ignore=shutil.ignore_patterns("*.safetensors")
    )
    monkeypatch.setattr(manifest, "PACKAGE", copy)
    program.cache_clear()
    before = program(*DRAWING)
    with (copy / "mi_bridge" / "integrator.py").open("a") as source:
        source.write("# another line\n")
    program.cache_clear()
    after = program(*DRAWING)
    program.cache_clear()
    monkeypatch.undo()
    assert before == program(*DRAWING) != after


def test_a_thing_without_content_is_refused():
    with pytest.raises(TypeError, match="a function has no content"):
        digest({"draw": lambda: None})
    assert digest([1, 2], [3]) != digest([1], [2, 3])
    assert digest("1") != digest(1) != digest(1.0)
