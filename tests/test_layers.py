import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
STAGES = ["types", "networks", "rollout", "sampler", "adversary", "ppo", "train"]


def imported_modules(path: Path) -> set[str]:
    """Every module that a file imports anywhere, `from a import b` counted as a and as a.b."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def packages(path: Path) -> set[str]:
    return {name.split(".")[0] for name in imported_modules(path)}


def files(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_imports_no_later_stage(stage):
    later = STAGES[STAGES.index(stage) + 1 :]
    path = ROOT / "aircl_jax" / f"{stage}.py"
    assert imported_modules(path).isdisjoint(f"aircl_jax.{name}" for name in later)


@pytest.mark.parametrize("path", files("envs"), ids=lambda path: path.name)
def test_worlds_import_nothing_of_the_library(path):
    assert packages(path).isdisjoint({"aircl_jax", "experiments", "hydra", "omegaconf"})


@pytest.mark.parametrize("path", files("aircl_jax"), ids=lambda path: path.name)
def test_the_library_knows_neither_hydra_nor_experiments(path):
    assert packages(path).isdisjoint({"experiments", "hydra", "omegaconf"})


@pytest.mark.parametrize("path", files("aircl_jax"), ids=lambda path: path.name)
def test_only_causal_knows_tigramite_and_nothing_in_the_library_imports_causal(path):
    if path.name != "causal.py":
        assert "tigramite" not in packages(path)
        assert "aircl_jax.causal" not in imported_modules(path)


def test_only_networks_knows_distrax():
    assert [path.name for path in files("aircl_jax") if "distrax" in packages(path)] == ["networks.py"]
