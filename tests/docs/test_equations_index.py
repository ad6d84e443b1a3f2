"""docs/equations.md names only what exists."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
INDEX = (ROOT / "docs" / "equations.md").read_text()
TESTS = sorted(set(re.findall(r"`((?:\w+/)?test_\w+\.py)::(\w+)`", INDEX)))
FUNCTIONS = sorted(set(re.findall(r"`((?:aircl_jax|envs)/[\w/]+\.py):(\w+)`", INDEX)))


def defined(path: Path) -> set[str]:
    return {node.name for node in ast.parse(path.read_text()).body if isinstance(node, ast.FunctionDef | ast.ClassDef)}


def test_every_test_in_the_index_exists():
    assert TESTS
    assert [(file, name) for file, name in TESTS if name not in defined(ROOT / "tests" / file)] == []


def test_every_function_in_the_index_exists():
    assert FUNCTIONS
    assert [(file, name) for file, name in FUNCTIONS if name not in defined(ROOT / file)] == []


def test_every_numbered_equation_is_in_the_index():
    rows = re.findall(r"^\| (\d+) ", INDEX, flags=re.MULTILINE)
    assert [int(row) for row in rows] == list(range(1, 14))


def test_every_term_of_the_adversary_is_in_the_index():
    from aircl_jax import TERMS

    named = {name for file, name in FUNCTIONS if file.startswith("aircl_jax/algorithm/terms/")}
    assert set(TERMS) <= named


def test_every_deviation_that_is_cited_is_listed():
    listed = set(re.findall(r"^- \*\*(D\d+)\.", INDEX, flags=re.MULTILINE))
    assert set(re.findall(r"\b(D\d+)\b", INDEX)) == listed
