"""The check of an accelerator: what it compares and says, and on a CPU the program that an accelerator would run."""

import json
import re
from dataclasses import replace

import jax
import numpy as np
import pytest

from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.methods import METHODS
from aircl_jax.runs.seeds import make_runner
from experiments import accelerator
from tests.worlds import TINY, random_trajectories, tiny_grid

NUMBERS = {"devices": "1 × abacus", "env_steps_per_s": 100.0, "memory": 2e9, "compile_s": 3.0, "first": {"return": [1.0, 3.0]}}


def of_backend(monkeypatch, backend):
    """What trains two seeds on that backend, and their D_E."""
    monkeypatch.setattr(jax, "default_backend", lambda: backend)
    trainer = make_trainer(tiny_grid(), METHODS["airl"], replace(TINY, hidden=(4,)))
    one = random_trajectories(tiny_grid(), 0, TINY.num_demonstrations)
    return make_runner(trainer, [0, 1]), jax.tree.map(lambda leaf: np.broadcast_to(leaf, (2, *leaf.shape)), one)


def program(runner, expert):
    return str(jax.make_jaxpr(lambda states: runner.run_chunk(states, expert, 1))(jax.eval_shape(runner.init, expert)))


def test_an_accelerators_program_is_a_vmap_of_single_precision_without_calls_to_the_host(monkeypatch):
    of_cpu, of_gpu = (program(*of_backend(monkeypatch, backend)) for backend in ("cpu", "gpu"))
    assert of_cpu.count("scan[") > of_gpu.count("scan[")
    assert not re.search(r"f64|callback", of_gpu)


@pytest.mark.slow
def test_an_accelerators_program_gives_the_cpus_numbers(monkeypatch):
    found = []
    for backend in ("cpu", "gpu"):
        runner, expert = of_backend(monkeypatch, backend)
        found.append(jax.tree.map(np.asarray, runner.run_chunk(runner.init(expert), expert, 1)[0].params))
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-5, atol=5e-6), *found)


def test_a_difference_is_of_means_in_tolerances_over_the_seeds_that_both_have():
    off, metric = accelerator.difference({"a": [1.0, 1.1, 9.0], "b": [0.0]}, {"a": [1.0, 1.0], "b": [0.005], "c": [1.0]})
    assert metric == "a" and off == pytest.approx(0.05 / 0.03)


def test_rows_refusals_and_the_faster_engine_are_said(monkeypatch, capsys):
    slow = NUMBERS | {"env_steps_per_s": 50.0, "first": {"return": [1.0, 9.0]}}
    monkeypatch.setattr(accelerator, "in_a_process", lambda case, *_: slow if case == "swimmer_mjx" else NUMBERS)
    assert accelerator.main(["cases=swimmer,swimmer_mjx", "seeds=2"]) == 0
    said = capsys.readouterr().out
    assert "| swimmer | 2 | 1 × abacus | 100 | 2.00 | 3 | 0 (return) | the CPU |" in said
    assert "swimmer, 2 seeds: planar is faster, 2.0 times" in said

    by_platform = {"cpu": NUMBERS, None: slow}
    monkeypatch.setattr(accelerator, "in_a_process", lambda *args: by_platform[args[-1].get("JAX_PLATFORMS")])
    assert accelerator.main(["cases=swimmer", "seeds=2"]) == 1
    monkeypatch.setattr(accelerator, "in_a_process", lambda *_: None)
    assert accelerator.main(["cases=gridworld"]) == 1


@pytest.mark.parametrize(
    ("word", "said"),
    [("cases=horse", "unknown case 'horse'; choose from gridworld"), ("seeds=10,x", "choose some as in 10,1000")],
)
def test_a_mistake_is_one_line_and_2(word, said, capsys):
    assert accelerator.main([word]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.slow
def test_a_case_alone_prints_its_numbers(capsys):
    assert accelerator.main(["alone=gridworld", "seeds=2", "scale=smoke"]) == 0
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert found["memory"] > 1e8 and found["compile_s"] >= 0 and found["env_steps_per_s"] > 0
    assert len(found["first"]["return"]) == 2
