"""CONTRIBUTING.md and its neighbours say what is so: the picture of the floors, hooks from .venv alone, one version."""

import re
import tomllib
from pathlib import Path

import yaml

from tests.test_layers import FLOORS, FULLEST, LONGEST

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "CONTRIBUTING.md").read_text()


def test_the_picture_shows_the_floors_from_the_top():
    blocks = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)
    picture = next(block for language, block in blocks if not language)
    shown = [re.split(r" {2,}", line)[0].split() for line in picture.splitlines()]
    assert shown == [list(floor) for floor in reversed(FLOORS)]


def test_the_page_names_the_limits_of_files_and_folders():
    assert f"at most {LONGEST} lines" in PAGE
    assert f"at most {FULLEST} files" in PAGE


def test_every_file_that_the_page_names_exists():
    named = re.findall(r"`((?:aircl_jax|envs|experiments|tests)/[\w/.]*)`", PAGE)
    assert named
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_hooks_are_local_and_run_from_the_environment():
    repos = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"]
    assert [repo["repo"] for repo in repos] == ["local"]
    assert all(hook["entry"].startswith(".venv/bin/") for repo in repos for hook in repo["hooks"])


def test_the_citation_is_of_the_projects_version_and_the_readmes_paper():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert citation["version"] == project["version"]
    assert " AND ".join(citation["license"]) == project["license"]
    assert citation["preferred-citation"]["title"] in (ROOT / "README.md").read_text()


def test_no_file_names_an_address_of_a_registry():
    addresses = re.compile(r"--(?:extra-)?index-url|--find-links|(?:pypi|pythonhosted|npmjs|anaconda)\.(?:org|com)")
    texts = [
        path for kind in ("*.toml", "*.lock", "*.yaml", "*.cff", "*.md", "Makefile", ".ci/run") for path in ROOT.glob(kind)
    ]
    assert len(texts) > 6
    assert [path.name for path in texts if addresses.search(path.read_text())] == []
