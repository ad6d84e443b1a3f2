"""Hundreds of random command lines: each setting is what was asked for, or the command ends with 2 and one line."""

from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

from experiments import run
from experiments.cli.command import run_command
from experiments.figure2.analysis import Settings as Figure2
from experiments.figure4.cells import Settings as Figure4
from experiments.table1.__main__ import Settings as Table1

RUNS, COMMANDS = 250, 1000
BAD = object()  # a word that must be refused
# Words of `experiments.run`, and what they set.
WORDS: tuple[tuple[str, Any], ...] = (
    *((f"seeds={value}", value) for value in (1, 2, 7)),
    *((f"seeds={value}", BAD) for value in ("", "0", "-1", "1.5", "two", "[1]", "null", "true", "99999999999999999999", "1e3")),
    *((f"iterations={value}", value) for value in (1, 30)),
    *((f"iterations={value}", BAD) for value in ("0", "x", "{a:1}", "'3'")),
    *((f"env.slip={value}", value) for value in (0.5, 1e-3, 0)),
    *((f"env.slip={value}", BAD) for value in ("nan", "inf", "-0.1", "2", "a", "[0.1]", "1_0.5x")),
    *((f"env.horizon={value}", value) for value in (10, 11)),
    *((f"env.horizon={value}", BAD) for value in ("4294967296", "0", "-3", "9.5", "long")),
    *((f"train.hidden={value}", value) for value in ([4], [8, 8])),
    *((f"train.hidden={value}", BAD) for value in ("[]", "4", "[0]", "[a]", "[4.5]", "[[4]]", "[4")),
    *((f"train.ppo.learning_rate={value}", value) for value in (0.001, 1)),
    *((f"train.ppo.learning_rate={value}", BAD) for value in ("nan", "-1", "fast", "", "[1]")),
    *((f"method={value}", value) for value in ("airl", "bc", "aircl_corrected")),
    *((f"method={value}", BAD) for value in ("", "AIRL", "airl,bc", "3", "airl bc", "../airl")),
    *((f"contrast_prior={value}", BAD) for value in ("yes", "1", "")),
    *((word, BAD) for word in ("env=", "env=maze", "env=1", "demonstrations=", "demonstrations=none.npz", "demonstrations=.")),
    *(
        (word, BAD)
        for word in ("seeds", "=3", "a=b=c", "run_dir=a=b", "env.=1", ".env=1", "train=1", "env.slip.x=1", "seeds=[1")
    ),
    *(
        (word, BAD)
        for word in ("env.obstacles=[[0,0]]", "env.obstacles=x", "env.goal=[1]", "env.goal=[9,9]", "colour=red", "${x}")
    ),
    *((word, BAD) for word in ("env.slip=${seeds", "env.slip='", 'env.slip="', "env.slip=(", "seeds=\\", "seeds=é", "env.é=1")),
)
GOOD_TEXT = ("a", "a b", "no", "1e3", "2024-01-01", "[", "x=y", "ä", "")
COMMAND_WORDS: dict[str, tuple[Any, tuple[tuple[str, Any], ...]]] = {
    "table1": (
        Table1,
        (
            *((f"out={text}", text) for text in GOOD_TEXT),
            *(("seeds=3", 3), ("seeds=010", 10), ("train=false", False), ("train=True", True), ("scale=smoke", "smoke")),
            *(
                (word, BAD)
                for word in ("seeds=1:30", "seeds=0x10", "seeds=1_0", "seeds=", "seeds=[", "seeds=1.0", "scale=[", "train=1")
            ),
            *((word, BAD) for word in ("env", "speed=1", "train=yes", "train=[", "seeds={a", "seeds=!!int", "=1", "seeds=&a")),
        ),
    ),
    "figure4": (
        Figure4,
        (
            *((f"mapping={text}", text) for text in GOOD_TEXT),
            *(("tau_max=5", 5), ("tau_max=1", 1)),
            *(
                (word, BAD)
                for word in ("tau_max=2", "tau_max=5.0", "tau_max=", "tau_max=[5]", "tau_max=true", "folds=all", "--seeds")
            ),
        ),
    ),
    "figure2": (
        Figure2,
        (
            *((f"data={text}", text) for text in GOOD_TEXT),
            *(("draws=5", 5), ("coding=step", "step"), ("seed=0", 0)),
            *((word, BAD) for word in ("draws=0", "seed=-1", "coding=none", "draws=1e1", "draws=five", "draws=[[", "coding=")),
        ),
    ),
}


def chosen(random: np.random.Generator, words: tuple[tuple[str, Any], ...]) -> list[tuple[str, Any]]:
    """Some words of different settings."""
    picked = [words[place] for place in random.permutation(len(words))[: random.integers(1, 5)]]
    return list({word.partition("=")[0]: (word, value) for word, value in picked}.values())


def at(settings: dict[str, Any], word: str) -> Any:
    """The value of the setting that a word names."""
    for name in word.partition("=")[0].split("."):
        settings = settings[name]
    return settings


@pytest.mark.slow
def test_a_random_command_line_of_a_run_is_understood_as_it_was_meant_or_refused_in_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    found: list[dict[str, Any]] = []

    def stopped(spec: Any, *_: Any) -> None:
        found.append(spec.settings)
        raise KeyboardInterrupt

    understood = 0
    with mock.patch("aircl_jax.api._train", stopped):
        for case in range(RUNS):
            words_of_case = WORDS if case % 2 else tuple(word for word in WORDS if word[1] is not BAD)
            picked = chosen(np.random.default_rng(case), words_of_case)
            words = [word for word, _ in picked]
            code, printed = run.main(["env=gridworld", *words] if "env" not in words[0][:4] else words), capsys.readouterr()
            if any(value is BAD for _, value in picked):
                assert code == 2 and printed.err.count("\n") == 1 and printed.err.startswith("error: "), (case, words, printed)
                continue
            assert code == 130, (case, words, printed)
            assert all(at(found[-1], word) == value for word, value in picked), (case, words)
            understood += 1
    assert not list(Path().iterdir())
    print(f"{understood} of {RUNS} understood")
    assert understood >= RUNS // 2


@pytest.mark.slow
def test_a_random_command_line_of_another_command_is_understood_as_it_was_meant_or_refused_in_one_line(capsys):
    for case in range(COMMANDS):
        random = np.random.default_rng(case)
        settings, words = COMMAND_WORDS[str(random.choice(list(COMMAND_WORDS)))]
        picked, found = chosen(random, words), []
        argv = [word for word, _ in picked]
        code = run_command(lambda parsed, _, found=found: found.append(parsed), argv, settings(), None)
        printed = capsys.readouterr()
        if any(value is BAD for _, value in picked):
            assert code == 2 and printed.err.count("\n") == 1 and printed.err.startswith("error: "), (case, argv, printed)
        else:
            assert code == 0, (case, argv, printed)
            assert all(at(vars(found[0]), word) == value for word, value in picked), (case, argv)
