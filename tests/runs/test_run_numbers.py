"""What a run reports of itself beside its metrics: speed and seconds, rows and progress, alarms, statistics over seeds."""

from collections.abc import Sequence
from typing import Any, cast

import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.reports.alarms import ALARMS, alarms
from aircl_jax.reports.summary import statistics, summarise
from aircl_jax.runs import loop
from aircl_jax.runs.recorder import Memory
from aircl_jax.runs.seeds import Runner
from aircl_jax.runs.spec import make_spec
from aircl_jax.types import TrainState
from tests.worlds import random_trajectories, tiny_grid


def timing(first: bool, env_steps: int, seconds: float, compile_s: float) -> dict[str, Any]:
    return {"iteration": 0, "first": first, "env_steps": env_steps, "seconds": seconds, "compile_s": compile_s}


def summary(lines: Sequence[dict[str, Any]]) -> dict[str, Any]:
    given = {"seeds": 3, "first_seed": 4, "iterations": 20, "demonstrations": "default", "contrast_prior": "method"}
    settings = {"size": 3, "goal": [2, 2], "obstacles": [[1, 1]], "horizon": 4}
    config = {"num_trajectories": 5, "pool_factor": 2}
    spec = make_spec("gridworld", "aircl_corrected", env_settings=settings, config=config, **given)
    return summarise(spec, {"return": np.array([1.0, 2.0, 6.0])}, lines)


# Two sessions: the first chunk of each compiles.
LINES = [
    timing(True, 100, 50.0, 30.0),
    timing(False, 200, 12.0, 2.0),
    timing(True, 300, 9.0, 8.0),
    timing(False, 100, 5.0, 0.0),
]


def test_speed_is_that_of_the_chunks_after_each_sessions_first_without_what_compiled():
    assert summary(LINES)["env_steps_per_s"] == (200 + 100) / (10.0 + 5.0)


def test_speed_is_unknown_where_no_chunk_but_first_ones_ran():
    assert summary([LINES[0], LINES[2]])["env_steps_per_s"] is None


def test_wall_and_compile_seconds_are_those_of_all_chunks():
    assert (summary(LINES)["wall_s"], summary(LINES)["compile_s"]) == (76.0, 40.0)


def test_env_steps_are_those_of_every_trajectory_of_the_pool_of_all_seeds_in_all_iterations():
    found = summary(LINES)
    assert (found["seeds"], found["iterations"]) == ([4, 5, 6], 20)
    assert found["env_steps"] == 20 * 3 * (5 * 2) * 4


def test_a_metric_is_summarised_over_the_seeds_of_a_sample():
    found = summary(LINES)["metrics"]["return"]
    assert found == {"mean": 3.0, "std": pytest.approx(7**0.5), "per_seed": [1.0, 2.0, 6.0]}


def test_a_number_that_is_infinite_in_one_seed_is_undefined():
    assert statistics([1.0, np.inf]) == {"mean": None, "std": None, "per_seed": [1.0, None]}


class Clock(loop.Stopwatch):
    """Every lap takes ten seconds, one of which compiles."""

    def __init__(self) -> None:
        pass

    def lap(self) -> dict[str, float]:
        return {"seconds": 10.0, "compile_s": 1.0}


def sit(start: int, iterations: int, chunk: int) -> tuple[Memory, Any]:
    """A session whose state counts the iterations, which are also its only metric; and its evaluation."""

    def run_chunk(state: TrainState, expert: Any, length: int) -> Any:
        at = int(state.step) + 1.0 + np.arange(length)[:, None] * np.ones(2)
        return state._replace(step=state.step + length), {"at": at}

    nothing = cast(Any, None)
    counting = TrainState(nothing, None, None, nothing, nothing, nothing, jnp.asarray(start, jnp.int32))
    memory = Memory()
    _, evaluation = loop.run_session(
        Runner(init=nothing, run_chunk=run_chunk),
        counting,
        random_trajectories(tiny_grid(), 0, 1),
        start=start,
        iterations=iterations,
        chunk=chunk,
        evaluate=lambda state: {"judged_at": int(state.step) + np.array([0.0, 2.0])},
        env_steps=100,
        stopwatch=Clock(),
        recorders=[memory],
    )
    return memory, evaluation


def test_a_chunk_is_timed_by_its_own_steps_and_only_the_first_of_a_session_is_called_so():
    done, _ = sit(start=3, iterations=9, chunk=4)
    lines = [(line["iteration"], line["env_steps"], line["first"]) for line in done.timing()]
    assert lines == [(4, 100, True), (8, 400, False), (9, 100, False)]


def test_the_row_of_each_iteration_is_its_own_and_a_whole_chunks_last_one_has_the_evaluation():
    done, evaluation = sit(start=3, iterations=9, chunk=4)
    assert [row["at"][0] for row in done.rows] == [4, 5, 6, 7, 8, 9]
    judged = [(int(row["at"][0]), row["judged_at"].tolist()) for row in done.rows if "judged_at" in row]
    assert judged == [(4, [4, 6]), (8, [8, 10])]
    assert evaluation["judged_at"].tolist() == [9, 11]


@pytest.mark.parametrize(
    ("metric", "quiet", "rings"),
    [
        ("feasibility_expert", 0.6, [0.049, 0.05, 0.599]),
        ("feasibility_auroc", 0.5, [0.49]),
        ("feasibility_gap", 0.05, [0.049, -0.049]),
        ("effective_sample_size", 0.1, [0.099]),
        ("logit_size", 10.0, [10.1]),
        ("log_std_at_bound", 0.0, [0.01]),
        ("balanced_acc", 0.65, [0.651]),
        ("untested", 0.99, [1.0]),
        ("moment_gap", 0.35, [0.351]),
        ("gap_at_end", 1.0, [1.01]),
        ("strayed", 0.02, [0.021]),
    ],
)
def test_an_alarm_rings_on_its_side_of_its_threshold_and_names_the_seeds(metric, quiet, rings):
    for value in rings:
        (said,) = alarms([7, 8, 9], {metric: {"per_seed": [quiet, value, None]}})
        assert f"({metric} {value:.3g}; seed 8). " in said
    assert alarms([7, 8, 9], {metric: {"per_seed": [quiet, quiet, float("nan")]}}) == []


def test_every_alarm_is_one_of_those_above():
    assert len(ALARMS) == 12
