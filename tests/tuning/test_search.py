"""A search trains on a part of the demonstrations, scores on the other, and ends with a command that is understood."""

import re
import shlex
import sys
from unittest import mock

import numpy as np
import pytest

from experiments import search as command
from tests.docs.test_docs import parsed_by_run
from tests.tiny_runs import CONFIG, GRID, SMALL

pytest.importorskip("optuna", reason="the extra `search` is not installed")

RATES = "train.ppo.learning_rate=0.0001:0.01:log"
WORDS = ("env=gridworld", "method=airl_centred", "iterations=2", *SMALL, RATES)


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """Five walks on the 3×3 grid, so that none has to be drawn."""
    random, file = np.random.default_rng(0), tmp_path_factory.mktemp("own") / "mine.npz"
    np.savez(file, obs=np.eye(9)[random.integers(9, size=(5, 4))], action=random.integers(4, size=(5, 4)))
    return f"demonstrations={file}"


def stub(seen):
    """Stands for training and measuring: the greater the rate, the better."""

    def train(*_, **given):
        seen.append(given)
        return given["config"].ppo.learning_rate

    def measure(rate, held_out):
        return {"likelihood": 100 * rate, "moments": 0.0, "passing": 1.0}

    return train, measure


@pytest.fixture
def trained(monkeypatch):
    from aircl_jax.tuning import search

    seen = []
    for name, made in zip(("train", "measure"), stub(seen), strict=True):
        monkeypatch.setattr(search, name, made)
    return seen


def test_a_search_prints_a_line_a_trial_a_table_and_a_command_that_trains_with_the_best(trained, own, tmp_path, capsys):
    folder = tmp_path / "out"
    assert command.main([*WORDS, own, "budget=4", "first_seed=3", f"run_dir={folder}"]) == 0
    said = capsys.readouterr().out
    lines = [line for line in said.splitlines() if re.match(r"trial \d/4  score", line)]
    assert len(lines) == 4 and all(re.search(r"best \S+ \(trial \d\)  \d+:\d\d left$", line) for line in lines)
    assert "| 1, the defaults |" in said
    rates = [given["config"].ppo.learning_rate for given in trained]
    [found] = [shlex.split(line.strip()) for line in said.splitlines() if line.startswith("    python -m experiments.run")]
    assert f"train.ppo.learning_rate={max(rates)}" in found and "first_seed=4" in found
    assert not any(word.startswith("budget") for word in found)
    assert parsed_by_run(found[3:]) == 0
    assert said.partition("\n\n\n")[2].partition("Written to")[0].strip() in (folder / "search.md").read_text()
    assert sorted(path.name for path in folder.iterdir()) == ["held_out.npz", "search.md", "study.journal", "training.npz"]


def test_each_trial_trains_on_the_part_that_is_not_held_out(trained, own, tmp_path):
    assert command.main([*WORDS, own, "budget=2", "held_out=0.4", f"run_dir={tmp_path}"]) == 0
    assert {given["demonstrations"] for given in trained} == {tmp_path / "training.npz"}
    training, out = (np.load(tmp_path / f"{name}.npz")["obs"] for name in ("training", "held_out"))
    assert (len(training), len(out)) == (3, 2)


def test_a_folder_that_holds_a_search_goes_on_begins_again_or_is_refused(trained, own, tmp_path):
    from aircl_jax import search

    given = {"method": "airl_centred", "env_settings": GRID, "config": CONFIG, "demonstrations": own.partition("=")[2]}
    given |= {"ranges": {"train.ppo.learning_rate": (1e-4, 1e-2, "log")}, "run_dir": tmp_path}
    assert len(search(**given, budget=2).trials) == 2
    with pytest.raises(ValueError, match="already holds a search; choose resume=true, overwrite=true"):
        search(**given, budget=3)
    assert len(search(**given, budget=3, resume=True).trials) == 3 and len(trained) == 3
    with pytest.raises(ValueError, match="seeds is 1 there and 2 here"):
        search(**given, budget=3, resume=True, seeds=2)
    assert len(search(**given, budget=3, overwrite=True).trials) == 3 and len(trained) == 6
    (tmp_path / "study.journal").unlink()
    (tmp_path / "mine.txt").touch()
    with pytest.raises(ValueError, match=r"holds files \(mine.txt, …\) and no study.journal"):
        search(**given, budget=3)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (WORDS[:-1], "there is nothing to search; give a range"),
        ([*WORDS, "train.ppo.rate=1:2"], r"unknown setting train\.ppo\.rate; choose from learning_rate"),
        ([*WORDS, "bdget=3"], "unknown setting bdget; choose from method, contrast_prior, budget"),
        ([*WORDS, "budget=0"], "budget=0 is not an integer of at least 1"),
        ([*WORDS, "held_out=1.5"], r"held_out=1\.5 of 5 demonstrations leaves a part empty"),
        ([*WORDS, "weights.moments=much"], r"weights\.moments=much is not a number"),
        (["env=meerkat", "method=behaviour", RATES], "method=behaviour is fitted at once and has nothing to search"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(words, said, own, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert command.main([*words, *([] if "env=meerkat" in words else [own])]) == 2
    error = capsys.readouterr().err
    assert re.search(said, error) and error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_without_optuna_one_line_names_the_extra(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with mock.patch.dict(sys.modules, optuna=None):
        assert command.main(list(WORDS)) == 2
    assert capsys.readouterr().err.rstrip().endswith("which is not installed; install aircl-jax[search]")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_search_of_three_trials_trains_scores_and_names_the_greatest(tmp_path, capsys):
    assert command.main([*WORDS, "budget=3", f"run_dir={tmp_path}"]) == 0
    said = capsys.readouterr().out
    scores = [float(number) for number in re.findall(r"trial \d/3  score (\S+)", said)]
    assert f"best {max(scores):.3f} (trial {scores.index(max(scores)) + 1})" in said
    parts = [re.search(r"score (\S+)  likelihood (\S+)  moments (\S+)  passing (\S+)", line) for line in said.splitlines()]
    for found in filter(None, parts):
        score, likelihood, moments, passing = map(float, found.groups())
        assert score == pytest.approx(likelihood - moments + passing, abs=2e-3)
