"""The house: a file imports from lower floors only, within a shelf nothing goes round, and files and folders stay small."""

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("aircl_jax", "envs", "experiments")
# From the ground up; the shelves of one floor know nothing of each other.
FLOORS = (
    ("messages",),
    ("console",),
    ("runtime", "storage", "defects"),
    ("envs",),
    ("types", "methods", "settings", "gym"),
    ("animals",),
    ("model", "demonstrations"),
    ("algorithm",),
    ("runs", "recorders"),
    ("experts",),
    ("analysis",),
    ("transfer",),
    ("reports",),
    ("figures",),
    ("outcome",),
    ("api",),
    ("tuning", "tasks"),
    ("experiments",),
)
FLOOR = {shelf: floor for floor, shelves in enumerate(FLOORS) for shelf in shelves}
LONGEST, FULLEST = 270, 14  # lines of a file, Python files of a folder beside `__init__` and `__main__`
FILES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
EVERY_FILE = [*FILES, *sorted((ROOT / "tests").rglob("*.py"))]
# What one file alone may import: of third parties, and of the library.
ALONE = {
    "tigramite": "aircl_jax/analysis/causal.py",
    "distrax": "aircl_jax/model",
    "hydra": "experiments/cli/",
    "omegaconf": "experiments/cli/",
}


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


MODULES = {module_of(path): path for path in FILES}


def imported(path: Path) -> Iterator[str]:
    """Every module that a file imports anywhere but for type checking; `from a import b` is a.b where that is a module."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    typing_only = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if id(node) in typing_only:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert not node.level, f"{name_of(path)} imports relatively"
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield full if full in MODULES else node.module


def shelf_of(module: str) -> str | None:
    """The first-level folder or file of the library; `envs` and `experiments` are one shelf each; None for third parties."""
    package, *rest = module.split(".")
    if package != "aircl_jax":
        return package if package in PACKAGES else None
    return rest[0] if rest else "api"  # `aircl_jax` itself hands on what `api` and lower floors have


IMPORTED = {name_of(path): set(imported(path)) for path in FILES}
PACKAGES_OF = {file: {module.partition(".")[0] for module in modules} for file, modules in IMPORTED.items()}


def test_a_file_imports_from_lower_floors_only():
    for path in FILES:
        own = shelf_of(module_of(path))
        assert own is not None
        for module in IMPORTED[name_of(path)]:
            shelf = shelf_of(module)
            assert shelf in (None, own) or FLOOR[shelf] < FLOOR[own], f"{name_of(path)}: {module}"


def test_no_imports_go_round_in_a_circle():
    graph = {module: {other for other in IMPORTED[name_of(path)] if other in MODULES} for module, path in MODULES.items()}
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as circle:
        pytest.fail(" → ".join(circle.args[1]))


@pytest.mark.parametrize(("package", "place"), ALONE.items())
def test_a_package_that_one_place_keeps_is_imported_nowhere_else(package, place):
    found = {file for file, packages in PACKAGES_OF.items() if package in packages}
    assert found
    assert {file for file in found if not file.startswith(place)} == set()


def test_nothing_in_the_library_imports_the_file_under_the_gpl():
    of_library = {file: modules for file, modules in IMPORTED.items() if file.startswith("aircl_jax/")}
    assert {file for file, modules in of_library.items() if "aircl_jax.analysis.causal" in modules} == set()


def test_figures_compute_nothing_of_the_algorithm():
    shelves = {
        file: {shelf_of(module) for module in IMPORTED[file]} for file in IMPORTED if file.startswith("aircl_jax/figures/")
    }
    assert {file for file, found in shelves.items() if found & {"algorithm", "model"}} == set()


def test_analysis_draws_nothing():
    drawing = {file for file, packages in PACKAGES_OF.items() if "matplotlib" in packages}
    assert {file for file in drawing if file.startswith("aircl_jax/analysis/")} == set()


def test_no_file_is_long():
    lines = {name_of(path): len(path.read_text(encoding="utf-8").splitlines()) for path in EVERY_FILE}
    assert {file: number for file, number in lines.items() if number > LONGEST} == {}


def test_no_folder_is_full():
    files: dict[str, int] = {}
    for path in EVERY_FILE:
        if path.stem not in ("__init__", "__main__"):
            files[name_of(path.parent)] = files.get(name_of(path.parent), 0) + 1
    assert {folder: number for folder, number in files.items() if number > FULLEST} == {}
