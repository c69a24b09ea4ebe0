"""The order of rooms: no module imports from a room below its own, inside functions included."""

import ast
import graphlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

import cnca

PACKAGE = Path(cnca.__file__).parent
ROOMS = (
    "core",
    "scene",
    "vehicle",
    "world",
    "effects",
    "mi_bridge",
    "gen",
    "efr",
    "detect",
    "attack",
    "judge",
    "train",
    "build",
    "report",
    "jobs",
    "cli",
)
"""From the top: a room imports from itself and from those before it."""
TOP = {"__init__.py", "__main__.py", "build.py"}
"""All files that do not stand in a room; the first two name every room's public things."""
RENDERING = {"mitsuba", "drjit"}
FIGHTING = {"torchvision", "timm", "mmdet", "mmcv", "mmengine"}
"""Libraries that fight with the pinned torch."""
BY_NAME_ONLY = {"detect/torchvision_models.py": {"torchvision"}}
"""Where they are imported all the same, once a user has asked for them by name."""
BACKEND_FREE = ("cnca.attack.loop", "cnca.judge.evaluate", "cnca.judge.stage", "cnca.judge.verdict")
"""The loops: they know protocols, never a renderer, a diffusion pipeline or the command line."""
CONCRETE = {"cnca.mi_bridge", "cnca.gen.sampling", "cnca.gen.pipeline", "cnca.efr", "cnca.build"}


def _sources() -> dict[str, str]:
    """Path below the package → source."""
    return {file.relative_to(PACKAGE).as_posix(): file.read_text() for file in _files()}


def _files() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def _module(path: str) -> str:
    names = ["cnca", *Path(path).with_suffix("").parts]
    return ".".join(name for name in names if name != "__init__")


def _imports(source: str, *, whole: bool = True) -> set[str]:
    """Full names that a source imports; only its outermost statements unless ``whole``."""
    tree = ast.parse(source)
    nodes = list(ast.walk(tree)) if whole else list(tree.body)
    if not whole:
        nodes += [inner for node in tree.body if isinstance(node, ast.If) for inner in node.body]
    names = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            names |= {f"{module}.{alias.name}" for alias in node.names}
    return names


def _room(module: str) -> str | None:
    parts = module.split(".")
    return parts[1] if parts[0] == "cnca" and len(parts) > 1 and parts[1] in ROOMS else None


def _upward(sources: dict[str, str]) -> list[str]:
    """Imports against the order, as ``importer -> imported``; also those that name no room."""
    offences = []
    for path, source in sources.items():
        room = _room(_module(path))
        if room is None:
            continue
        for name in sorted(_imports(source)):
            if name.startswith("."):
                offences.append(f"{_module(path)} -> {name}: write it out")
            elif name == "cnca" or name.startswith("cnca."):
                other = _room(name)
                if other is None or ROOMS.index(other) > ROOMS.index(room):
                    offences.append(f"{_module(path)} -> {name}")
    return offences


def test_no_module_imports_from_a_room_below_its_own():
    assert _upward(_sources()) == []


def test_every_file_stands_in_a_room():
    outside = {path for path in _sources() if _room(_module(path)) is None}
    assert outside | {"build.py"} == TOP


def test_every_folder_of_modules_is_a_package():
    """Others run from a checkout, and are missing in a wheel."""
    folders = {file.parent for file in _files()}
    assert [folder for folder in folders if not (folder / "__init__.py").exists()] == []


@pytest.mark.parametrize(
    ("path", "source", "offence"),
    [
        ("scene/rogue.py", "from cnca.vehicle import model", "cnca.vehicle.model"),
        ("gen/rogue.py", "def f():\n    import cnca.jobs.harden", "cnca.jobs.harden"),
        ("attack/rogue.py", "from cnca import build", "cnca.build"),
        ("detect/rogue.py", "if TYPE_CHECKING:\n    from cnca.cli.app import app", "cnca.cli.app"),
        ("core/rogue.py", "from cnca import __version__", "cnca.__version__"),
        ("core/rogue.py", "from ..cli import app", "..cli.app"),
    ],
)
def test_an_upward_import_is_found(path, source, offence):
    assert any(offence in line for line in _upward({path: source}))


def _libraries(source: str, libraries: set[str]) -> set[str]:
    """Those ``libraries`` that the source imports anywhere, even inside a function."""
    return {name.split(".")[0] for name in _imports(source)} & libraries


def test_only_the_variant_names_the_rendering_libraries():
    """The rest of the bridge takes them from there, where the variant is already set."""
    naming = {path for path, source in _sources().items() if _libraries(source, RENDERING)}
    assert naming == {"mi_bridge/variant.py"}


def test_no_file_names_a_library_that_fights_with_torch():
    naming = {path: _libraries(source, FIGHTING) for path, source in _sources().items()}
    assert {path: named for path, named in naming.items() if named} == BY_NAME_ONLY


def test_imports_inside_functions_are_seen():
    assert _libraries("def f():\n    from mitsuba import Float", RENDERING) == {"mitsuba"}


def _loaded_with(modules: list[str], search: Path | None = None) -> set[str]:
    """The names in sys.modules after importing ``modules`` in a fresh process."""
    script = (
        "import importlib, json, sys\n"
        "path, *names = sys.argv[1:]\n"
        "sys.path.insert(0, path)\n"
        "for name in names: importlib.import_module(name)\n"
        "print(json.dumps(sorted(sys.modules)))"
    )
    command = [sys.executable, "-c", script, str(search or PACKAGE.parent), *modules]
    answer = subprocess.run(command, capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr
    return set(json.loads(answer.stdout.splitlines()[-1]))


def _within(names: set[str], modules: set[str]) -> set[str]:
    """Those ``modules`` that are one of ``names`` or lie inside one of them."""
    return {m for m in modules if any(m == name or m.startswith(name + ".") for name in names)}


def test_the_loops_load_no_backend():
    assert _within(CONCRETE | RENDERING | {"diffusers"}, _loaded_with([*BACKEND_FREE])) == set()


def test_the_command_line_loads_neither_torch_nor_mitsuba_for_its_help():
    assert _within({"torch"} | RENDERING, _loaded_with(["cnca.cli"])) == set()


def test_a_backend_that_is_loaded_is_found(tmp_path):
    (tmp_path / "rogue.py").write_text("import cnca.mi_bridge.llvm")
    assert _within(CONCRETE, _loaded_with(["rogue"], tmp_path))


def _circle(sources: dict[str, str]) -> list[str]:
    """Modules that import each other in a circle outside of functions, if only for their types."""
    reached = {}
    for module, source in sources.items():
        names = _imports(source, whole=False)
        names |= {name.rpartition(".")[0] for name in names}
        reached[module] = names & (sources.keys() - {module})
    try:
        graphlib.TopologicalSorter(reached).prepare()
    except graphlib.CycleError as error:
        return error.args[1]
    return []


def test_modules_do_not_import_each_other():
    """Beside ``cnca`` itself, which names its parts for type checkers."""
    modules = {_module(path): source for path, source in _sources().items()}
    assert _circle({name: source for name, source in modules.items() if name != "cnca"}) == []


def test_a_circle_is_found():
    circle = {"a": "from b import f", "b": "import c", "c": "if TYPE_CHECKING:\n    import a"}
    assert set(_circle(circle)) == {"a", "b", "c"}
