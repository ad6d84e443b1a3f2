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
    ("runtime", "storage", "defects"),
    ("envs",),
    ("types", "methods", "settings", "gym"),
    ("model", "demonstrations"),
    ("algorithm", "animals"),
    ("runs", "recorders"),
    ("experts",),
    ("analysis",),
    ("transfer",),
    ("reports",),
    ("figures",),
    ("api",),
    ("experiments",),
)
FLOOR = {shelf: floor for floor, shelves in enumerate(FLOORS) for shelf in shelves}
LONGEST, FULLEST = 270, 14  # lines of a file, Python files of a folder beside `__init__` and `__main__`
FILES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
EVERY_FILE = [*FILES, *sorted((ROOT / "tests").rglob("*.py"))]
# What one file alone may import: of third parties, and of the library.
ALONE = {"tigramite": "aircl_jax/analysis/causal.py", "distrax": "aircl_jax/model"}


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


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_a_file_imports_from_lower_floors_only(path):
    own = shelf_of(module_of(path))
    assert own is not None
    for module in imported(path):
        shelf = shelf_of(module)
        if shelf is not None and shelf != own:
            assert FLOOR[shelf] < FLOOR[own], module


def test_no_imports_go_round_in_a_circle():
    graph = {module: {other for other in imported(path) if other in MODULES} for module, path in MODULES.items()}
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as circle:
        pytest.fail(" → ".join(circle.args[1]))


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_a_package_that_one_place_keeps_is_imported_nowhere_else(path):
    for package, place in ALONE.items():
        if not name_of(path).startswith(place):
            assert package not in {module.split(".")[0] for module in imported(path)}


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_hydra_is_known_to_the_command_line_alone(path):
    if not name_of(path).startswith("experiments/cli/"):
        assert {"hydra", "omegaconf"}.isdisjoint(module.split(".")[0] for module in imported(path))


@pytest.mark.parametrize("path", [path for path in FILES if name_of(path).startswith("aircl_jax/")], ids=name_of)
def test_nothing_in_the_library_imports_the_file_under_the_gpl(path):
    assert "aircl_jax.analysis.causal" not in set(imported(path))


@pytest.mark.parametrize("path", [path for path in FILES if name_of(path).startswith("aircl_jax/figures/")], ids=name_of)
def test_figures_compute_nothing_of_the_algorithm(path):
    assert {"algorithm", "model"}.isdisjoint(shelf_of(module) for module in imported(path))


@pytest.mark.parametrize("path", [path for path in FILES if name_of(path).startswith("aircl_jax/analysis/")], ids=name_of)
def test_analysis_draws_nothing(path):
    assert "matplotlib" not in {module.split(".")[0] for module in imported(path)}


@pytest.mark.parametrize("path", EVERY_FILE, ids=name_of)
def test_no_file_is_long(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= LONGEST


def test_no_folder_is_full():
    files: dict[str, int] = {}
    for path in EVERY_FILE:
        if path.stem not in ("__init__", "__main__"):
            files[name_of(path.parent)] = files.get(name_of(path.parent), 0) + 1
    assert {folder: number for folder, number in files.items() if number > FULLEST} == {}
