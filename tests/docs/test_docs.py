"""README.md and the pages of docs/ hold what they say: commands are understood, Python runs, links lead somewhere."""

import ast
import importlib
import importlib.util
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from experiments.cli.hydra_cli import Composed
from tests.worlds import command_module

ROOT = Path(__file__).parents[2]
PAGES = ("README.md", "CONTRIBUTING.md", *sorted(str(path.relative_to(ROOT)) for path in (ROOT / "docs").rglob("*.md")))


def blocks(page: str, language: str) -> list[str]:
    """The fenced blocks of a page in that language."""
    found = re.findall(r"^```(\w*)\n(.*?)^```$", (ROOT / page).read_text(), flags=re.MULTILINE | re.DOTALL)
    return [block for of, block in found if of == language]


def commands() -> list[str]:
    """Every `python -m experiments.…` of a shell block, without its comment, or in the text, where it is one to copy."""
    lines = [line for page in PAGES for block in blocks(page, "sh") for line in block.splitlines()]
    in_text = [span for page in PAGES for span in re.findall(r"`([^`\n]+)`", (ROOT / page).read_text())]
    lines += [span for span in in_text if not re.search(r"…|=[A-Z]+\b", span.partition("python")[2])]
    return sorted({shlex.join(shlex.split(line, comments=True)) for line in lines if "python -m experiments." in line})


def of_a_run(composed: Composed) -> int:
    """What a run checks of its settings before it makes anything."""
    from aircl_jax.methods import get_method
    from aircl_jax.settings.env_defaults import default_config
    from envs import ENVS
    from envs.settings import updated
    from experiments.cli.hydra_settings import RunSettings

    env, values = composed.env, dict(composed.values)
    env_values, train_values = values.pop("env"), values.pop("train")
    run = updated(RunSettings(), values)
    updated(ENVS[env].options(), env_values, "env")
    updated(default_config(env, get_method(run.method).settings), train_values, "train")
    return 0


def parsed_by_run(words: list[str]) -> int:
    from experiments import run

    with mock.patch.object(run, "run", of_a_run):
        return run.main(words)


def parsed_by_expert(words: list[str]) -> int:
    from experiments.expert import __main__ as expert

    with mock.patch.object(expert, "train", return_value=0):
        return expert.main(words)


def parsed_by_search(words: list[str]) -> int:
    from aircl_jax.settings.train_config import TrainConfig
    from aircl_jax.tuning.ranges import read_ranges
    from experiments import search

    def understood(composed: Composed, ranges: Any) -> int:
        return bool(read_ranges(ranges, TrainConfig())) - 1

    with mock.patch.object(search, "run", understood):
        return search.main(words)


def parsed_by(module: str) -> Callable[[list[str]], int]:
    """For a command without Hydra: its words against its `Settings`."""

    def understood(words: list[str]) -> int:
        from experiments.cli.words import parse

        parse(words, command_module(module).Settings(), None)
        return 0

    return understood


UNDERSTOOD = {
    "experiments.run": parsed_by_run,
    "experiments.expert": parsed_by_expert,
    "experiments.search": parsed_by_search,
    "experiments.recovery": parsed_by("experiments.recovery"),
    "experiments.table1": parsed_by("experiments.table1"),
    "experiments.accelerator": parsed_by("experiments.accelerator"),
    "experiments.benchmark": parsed_by("experiments.benchmark"),
    "experiments.watch": parsed_by("experiments.watch"),
    "experiments.sweeps": parsed_by("experiments.sweeps"),
    "experiments.figure2": parsed_by("experiments.figure2"),
    "experiments.figure3": parsed_by("experiments.figure3"),
    "experiments.figure4": parsed_by("experiments.figure4"),
    "experiments.pendulum_lqr": parsed_by("experiments.pendulum_lqr"),
    "experiments.physics": parsed_by("experiments.physics"),
    "experiments.swap": parsed_by("experiments.swap"),
    "experiments.learner": parsed_by("experiments.learner"),
    "experiments.behaviour": parsed_by("experiments.behaviour"),
    "experiments.minari": parsed_by("experiments.minari"),
    "experiments.export": parsed_by("experiments.export"),
    "experiments.shield": parsed_by("experiments.shield"),
    "experiments.herd": parsed_by("experiments.herd"),
    "experiments.bodies": parsed_by("experiments.bodies"),
    "experiments.tasks": parsed_by("experiments.tasks"),
}


@pytest.mark.parametrize("command", commands())
def test_a_documented_command_is_understood_and_writes_nothing(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # A launcher is a plugin that need not be installed; its folder is written to.
    words = [
        word for word in shlex.split(command) if not word.startswith(("hydra/launcher=", "hydra.launcher.", "hydra.sweep.dir="))
    ]
    start = words.index("-m")
    assert UNDERSTOOD[words[start + 1]](words[start + 2 :]) == 0
    assert list(tmp_path.iterdir()) == []


def test_a_command_that_is_wrong_would_be_noticed():
    assert parsed_by_run(["env=gridworld", "env.slipp=0.1"]) == 2
    assert parsed_by_run(["env=gridworld", "seeds=abc"]) == 2


BESIDE = ("stable_baselines3",)  # what a page uses beside this project; tests/test_gym.py runs it where it is installed


@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_imports_exists(page):
    for block in blocks(page, "python"):
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.ImportFrom) and node.module not in BESIDE:
                module = importlib.import_module(node.module or "")
                assert [alias.name for alias in node.names if not found(module, alias.name)] == []


def found(module: Any, name: str) -> bool:
    return hasattr(module, name) or importlib.util.find_spec(f"{module.__name__}.{name}") is not None


@pytest.mark.parametrize("page", PAGES)
def test_every_link_within_the_project_leads_to_a_file_and_a_heading(page):
    for target in re.findall(r"\]\((?!https?:)([^)]+)\)", (ROOT / page).read_text()):
        path, _, anchor = target.partition("#")
        file = (ROOT / page).parent / path if path else ROOT / page
        assert file.exists(), target
        assert not anchor or anchor in headings(file), target


@pytest.mark.parametrize("page", PAGES)
def test_every_file_and_folder_of_the_tree_that_a_page_names_exists(page):
    named = re.findall(r"`((?:aircl_jax|envs|experiments|tests|results)/[\w/.]*?(?:\.py|/))(?=[`:])", (ROOT / page).read_text())
    assert [path for path in named if not (ROOT / path).exists()] == []


def headings(page: Path) -> list[str]:
    """The anchors of a page's headings, as GitHub makes them."""
    titles = re.findall(r"^#+ (.+)$", page.read_text(), flags=re.MULTILINE)
    return [re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles]


@pytest.mark.parametrize("page", PAGES)
def test_every_make_target_of_a_page_exists(page):
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
    assert set(re.findall(r"^make ([\w-]+)", (ROOT / page).read_text(), flags=re.MULTILINE)) <= set(targets)


def test_the_readme_is_one_screen_and_links():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 90


def test_every_method_of_the_table_is_in_the_overview():
    from aircl_jax.methods import METHODS

    named = set(re.findall(r"`(\w+)`", (ROOT / "docs" / "overview.md").read_text()))
    assert set(METHODS) <= named


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Brax System")
def test_the_python_of_the_guide_runs_from_top_to_bottom(tmp_path, monkeypatch):
    from aircl_jax.algorithm.terms.table import TERMS
    from aircl_jax.methods import METHODS
    from envs.robots.constraints import CONSTRAINTS

    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    with mock.patch.dict(METHODS), mock.patch.dict(TERMS), mock.patch.dict(CONSTRAINTS):
        for block in blocks("docs/guide.md", "python"):
            exec(compile(block, "docs/guide.md", "exec"), names)
    assert names["reference"]()["cost"].any(axis=1).mean() == pytest.approx(0.5)
    assert not names["np"].load("mine.npz")["cost"].any()
    assert names["result"].reward(*names["jnp"].zeros((2, 2))).shape == ()
    assert names["curves"]["violation_rate_policy"].shape == (2, 1)
    assert names["small"].summary["metrics"]["feasibility_auroc"]["mean"] is not None
    assert "loss_reward_decay" in names["small"].history
    assert 0 < names["unconstrained"] < 1
    assert len(names["found"].trials) == 2 and names["found"].has_defaults
