"""Who may import whom: each part is imported in a process of its own, then sys.modules is read."""

import ast
import graphlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

import cnca

PACKAGE = Path(cnca.__file__).parent
LEAVES = {
    f"cnca.{name}" for name in ("errors", "files", "types", "color", "boxes", "scores", "progress")
}
"""Records and plain functions without any part's concerns."""
PROTOCOLS = {"cnca.protocols", "cnca.pictures", "cnca.scene.cameras", "cnca.scene.weather"}
"""The four exchangeable parts, the records that they exchange, and pictures of them."""
RENDERING = {"mitsuba", "drjit"}
CONCRETE = {"cnca.mi_bridge", "cnca.gen.sampling", "cnca.gen.pipeline", "diffusers"}
CONCRETE |= {"cnca.efr", "cnca.build", "cnca.cli"}
"""What the loops do without; F_adv and κ (``cnca.gen.feature``) belong to the method itself."""

MAY_LOAD = {
    "cnca.errors": set(),
    "cnca.files": {"cnca.errors"},
    "cnca.color": set(),
    "cnca.types": {"cnca.errors"},
    "cnca.protocols": LEAVES | PROTOCOLS,
    "cnca.scene": {"cnca.errors", "cnca.files"},
    "cnca.mi_bridge": LEAVES | PROTOCOLS | {"cnca.scene"},
    "cnca.gen": LEAVES | PROTOCOLS | {"cnca.parallel"},
    "cnca.efr": LEAVES | PROTOCOLS | {"cnca.parallel"},
    "cnca.detect": LEAVES | PROTOCOLS,
    "cnca.cli": {"cnca.errors"},
}
"""Part → what it may load of the package beside itself."""

MAY_NOT_LOAD = {
    "cnca.scene": {"torch"},
    "cnca.optimize": CONCRETE | RENDERING,
    "cnca.evaluate": CONCRETE | RENDERING,
    "cnca.evidence.stage": CONCRETE | RENDERING,
    "cnca.evidence.verdict": CONCRETE | RENDERING,
    "cnca.build": {"cnca.cli"},
}
NOWHERE = {"torchvision", "timm", "mmdet", "mmcv", "mmengine"}
"""Libraries that fight with the pinned torch."""
OPTIONAL = {"torchvision_models.py": {"torchvision"}}
"""Where they are imported all the same, once a user has asked for them by name."""


def _modules(part: str) -> list[str]:
    """A package with all its modules, or one module."""
    path = PACKAGE.parent / part.replace(".", "/")
    files = sorted(path.rglob("*.py")) or [path.with_suffix(".py")]
    relative = [file.relative_to(PACKAGE.parent).with_suffix("").parts for file in files]
    return [".".join(name for name in names if name != "__init__") for names in relative]


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


def _offences(part: str, loaded: set[str]) -> set[str]:
    """What ``part`` has loaded although the table forbids it."""
    forbidden = NOWHERE | MAY_NOT_LOAD.get(part, set())
    if part in MAY_LOAD and part != "cnca.mi_bridge":
        forbidden |= RENDERING
    offences = {name for name in loaded if _covers(forbidden, name)}
    if part in MAY_LOAD:
        others = {n for n in loaded if n.startswith("cnca.") and not _covers({part}, n)}
        packages = {name.rpartition(".")[0] for name in MAY_LOAD[part]}
        offences |= {n for n in others - packages if not _covers(MAY_LOAD[part], n)}
    return offences


def _covers(names: set[str], module: str) -> bool:
    """Whether ``module`` is one of ``names`` or lies inside one of them."""
    return any(module == name or module.startswith(name + ".") for name in names)


@pytest.mark.parametrize("part", sorted(MAY_LOAD | MAY_NOT_LOAD))
def test_each_part_loads_only_what_the_table_allows(part):
    assert _offences(part, _loaded_with(_modules(part))) == set()


def _named(source: str, libraries: set[str]) -> set[str]:
    """Those ``libraries`` that the source imports anywhere, even inside a function."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.split(".")[0])
    return found & libraries


def test_only_the_variant_names_the_rendering_libraries():
    """The rest of the bridge takes them from there, where the variant is already set."""
    sources = {f.relative_to(PACKAGE).as_posix(): f.read_text() for f in PACKAGE.rglob("*.py")}
    naming = {name for name, source in sources.items() if _named(source, RENDERING)}
    assert naming == {"mi_bridge/variant.py"}


def test_no_file_names_a_library_that_fights_with_torch():
    naming = {file.name: _named(file.read_text(), NOWHERE) for file in PACKAGE.rglob("*.py")}
    assert {name: named for name, named in naming.items() if named} == OPTIONAL


@pytest.mark.parametrize(
    ("part", "source", "offence"),
    [
        ("cnca.scene", "import torch", "torch"),
        ("cnca.scene", "from cnca import types", "cnca.types"),
        ("cnca.gen", "import cnca.scene.sedan", "cnca.scene.sedan"),
        ("cnca.detect", "import drjit", "drjit"),
        ("cnca.optimize", "import cnca.mi_bridge.llvm", "cnca.mi_bridge.llvm"),
    ],
)
def test_the_check_can_fail(tmp_path, part, source, offence):
    (tmp_path / "rogue.py").write_text(source)
    assert offence in _offences(part, _loaded_with(["rogue"], tmp_path))


def _circle(sources: dict[str, str]) -> list[str]:
    """Modules that import each other in a circle outside of functions, if only for their types."""
    reached = {}
    for module, source in sources.items():
        body = ast.parse(source).body
        body += [inner for node in body if isinstance(node, ast.If) for inner in node.body]
        names = set()
        for node in body:
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        reached[module] = names & (sources.keys() - {module})
    try:
        graphlib.TopologicalSorter(reached).prepare()
    except graphlib.CycleError as error:
        return error.args[1]
    return []


def test_modules_do_not_import_each_other():
    """Beside ``cnca`` itself, which names its parts for type checkers."""
    modules = [name for name in _modules("cnca") if name != "cnca"]
    paths = {name: PACKAGE.parent / name.replace(".", "/") for name in modules}
    files = {n: p / "__init__.py" if p.is_dir() else p.with_suffix(".py") for n, p in paths.items()}
    assert _circle({name: file.read_text() for name, file in files.items()}) == []


def test_a_circle_is_found():
    circle = {"a": "from b import f", "b": "import c", "c": "if TYPE_CHECKING:\n    import a"}
    assert set(_circle(circle)) == {"a", "b", "c"}


def test_imports_inside_functions_are_seen():
    assert _named("def f():\n    from mitsuba import Float", RENDERING) == {"mitsuba"}
