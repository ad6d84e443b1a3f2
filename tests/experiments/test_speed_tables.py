"""What `benchmark`, `physics` and `frontier` print: each timing under its own name and in its unit, by made-up timings."""

import sys
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import aircl_jax
from experiments import pendulum_lqr, physics
from experiments.benchmark import __main__ as command
from experiments.benchmark import one_env as benchmark
from experiments.benchmark import products
from experiments.benchmark.parts import Part, parts_of


def test_a_benchmark_has_each_measure_under_its_name(monkeypatch):
    speeds = {10: (20_000.0, 12.3), 1: (4_000.0, 45.6)}
    monkeypatch.setattr(benchmark, "throughput", lambda settings, seeds: speeds[seeds])
    monkeypatch.setattr(benchmark, "parts", lambda settings: {"a part": "1"})
    monkeypatch.setattr(benchmark, "second_start", lambda settings: 7.25)
    usage = SimpleNamespace(RUSAGE_SELF=0, getrusage=lambda who: SimpleNamespace(ru_maxrss=3 * 2**20))  # kB
    monkeypatch.setitem(sys.modules, "resource", usage)
    assert benchmark.measure(benchmark.Settings(env="swimmer")) == {
        "whole training, 10 seed(s), env steps/s": "20,000",
        "  tracing and compiling, 10 seed(s), s": "12.3",
        "whole training, 1 seed(s), env steps/s": "4,000",
        "  tracing and compiling, 1 seed(s), s": "45.6",
        "a part": "1",
        "second start until the first iteration is on disk, s": "7.2",
        "peak memory of this process after both trainings, GiB": "3.00",
    }


def test_throughput_is_that_of_a_run_whose_second_chunk_is_timed(monkeypatch):
    asked = {}

    def trained(env, method, **given):
        asked.update(given, env=env, method=method)
        return SimpleNamespace(summary={"env_steps_per_s": 1234.0, "compile_s": 5.0})

    monkeypatch.setattr(aircl_jax, "train", trained)
    settings = benchmark.Settings(env="swimmer", chunk=3, epochs=2, integrator="rk4")
    assert benchmark.throughput(settings, 4) == (1234.0, 5.0)
    assert (asked["env"], asked["seeds"], asked["iterations"]) == ("swimmer", 4, 2 * 3)
    assert (asked["env_settings"], asked["config"]) == (
        {"integrator": "rk4"},
        {"checkpoint_every": 3, "ppo": {"num_epochs": 2}},
    )


def test_a_timing_is_the_median_of_five_after_the_compilation(monkeypatch):
    instants = iter([0, 1, 10, 13, 20, 22, 30, 39, 40, 45])  # 1, 3, 2, 9 and 5 seconds
    monkeypatch.setattr(benchmark, "time", SimpleNamespace(perf_counter=lambda: next(instants)))
    result, seconds = benchmark._timed(lambda x: x + 1, 1)
    assert (int(result), seconds) == (2, 3)


def part(times):
    """A part that multiplies 2 × 3 by 3 × 4 once."""
    return Part(jnp.matmul, (jnp.ones((2, 3)), jnp.ones((3, 4))), times)


def test_the_parts_of_an_iteration_are_in_milliseconds_and_beside_the_whole_step(monkeypatch):
    made = {"bare physics": part(0), "rollout": part(2), "PPO": part(1), "whole step": part(1)}
    timed = iter([0.001, 0.002, 0.007, 0.02])
    monkeypatch.setattr(benchmark, "parts_of", lambda settings: made)
    monkeypatch.setattr(benchmark, "_timed", lambda function, *inputs: (None, next(timed)))
    monkeypatch.setattr(benchmark, "limit", lambda part, seconds, whole: f"{part.times}, {seconds / whole:.2f}")
    found = benchmark.parts(benchmark.Settings())
    assert {name.removeprefix("one seed, one device: "): value for name, value in found.items()} == {
        "bare physics, ms": "1.0",
        "rollout, ms": "2.0",
        "PPO, ms": "7.0",
        "whole step, ms": "20.0",
        "whole step / bare physics": "20.00",
        "whole step / rollout": "10.00",
        "limits of rollout": "2, 0.10",
        "limits of PPO": "1, 0.35",
        "limits of whole step": "1, 1.00",
        "all between the parts, ms": "9.0",  # 20 − 2 × 2 − 7
    }


def test_a_limit_is_the_share_of_the_step_the_arithmetic_and_what_the_products_take_alone(monkeypatch):
    monkeypatch.setattr(products, "AT_ONCE", 480)  # ten of the part's product
    monkeypatch.setattr(benchmark, "_timed", lambda function, *inputs: (None, 5e-6))
    text = benchmark.limit(part(2), 2e-6, 1e-5)
    assert text == "2 × 20% of the step; 0.000 + 0.000 GFLOP, 0.0 GFLOP/s; products alone 0.0 ms (25%), 0.1 GFLOP/s"
    assert benchmark.limit(Part(jnp.add, (1.0, 2.0)), 1e-6, 1e-5).endswith("no products")


def test_arithmetic_counts_a_loop_as_often_as_it_runs_and_the_greater_branch():
    weights, x = jnp.ones((3, 3)), jnp.ones((5, 3))

    def looped(x):
        x = jax.lax.scan(lambda x, _: (x @ weights + 1.0, None), x, length=7)[0]
        return jax.lax.cond(x.sum() > 0, lambda x: x @ weights, lambda x: x, x)

    work = products.arithmetic(looped, x)
    assert {product.operations: times for product, times in work.products.items()} == {2 * 5 * 3 * 3: 7 + 1}
    assert work.others == 7 * 15 + 1 + 1  # additions of the loop; the sum, and the comparison
    assert work.operations == 8 * 90 + work.others


def test_arithmetic_of_a_batch_of_products_is_that_of_xla():
    def multiplied(left, right):
        return jnp.einsum("nij,njk->nik", left, right)

    left, right = jnp.ones((4, 5, 6)), jnp.ones((4, 6, 7))
    by_xla = jax.jit(multiplied).lower(left, right).cost_analysis()
    assert by_xla is not None
    assert products.arithmetic(multiplied, left, right).operations == by_xla["flops"] == 2 * 4 * 5 * 6 * 7


@pytest.mark.parametrize("method", ["gacl_tuned", "bc", "behaviour"])
def test_a_row_of_other_parts_is_refused_before_anything_is_timed(method, capsys, monkeypatch):
    monkeypatch.setattr(benchmark, "measure", lambda settings: pytest.fail("was measured"))
    assert command.main([f"method={method}", "env=pendulum"]) == 2
    assert f"method={method}: its iteration has other parts" in capsys.readouterr().err


@pytest.mark.parametrize(("env", "method"), [("gridworld", "aircl_contrast"), ("pendulum", "aircl_contrast")])
def test_the_parts_of_a_row_have_about_the_arithmetic_of_the_step(env, method):
    made = parts_of(benchmark.Settings(env=env, method=method))
    done = {name: products.arithmetic(each.run, *each.inputs).operations for name, each in made.items() if each.times}
    whole = done.pop("whole step")
    assert 0.5 * whole < sum(made[name].times * done[name] for name in done) < 1.1 * whole
    for name in set(made) - {"whole step"}:
        assert jax.eval_shape(made[name].run, *made[name].inputs) is not None


def test_the_speed_of_physics_is_all_steps_over_the_least_and_the_middle_time(monkeypatch):
    seconds = iter([9.0, 4.0, 2.0, 8.0, 5.0, 10.0])  # the first compiles
    monkeypatch.setattr(physics, "_seconds", lambda run: next(seconds))
    assert physics.speed("pendulum", "planar", "euler") == (500 * 100 / 2.0, 500 * 100 / 5.0, 9.0)


def test_the_table_of_physics_has_best_median_compile_time_and_deviation(monkeypatch, capsys):
    changed = {}
    monkeypatch.setattr(jax.config, "update", changed.__setitem__)
    monkeypatch.setattr(physics, "speed", lambda name, engine, integrator: (34_567.0, 12_345.0, 6.7))
    monkeypatch.setattr(physics, "deviation", lambda name, engine, integrator: {"euler": 2e-3, "rk4": 4e-5}[integrator])
    assert physics.main(["bodies=walker"]) == 0
    assert capsys.readouterr().out.splitlines()[2:] == [
        "| walker | planar | euler | 34,567 (12,345) | 7 | 2.0e-03 |",
        "| walker | planar | rk4 | 34,567 (12,345) | 7 | 4.0e-05 |",
    ]
    assert changed == {"jax_enable_compilation_cache": False}  # else the seconds of compiling would be those of reading


def test_the_deviation_of_physics_is_from_c_mujoco_and_less_by_the_finer_integrator():
    euler, rk4 = (physics.deviation("pendulum", "planar", integrator, episodes=2) for integrator in ("euler", "rk4"))
    assert 0 < rk4 < euler < 5e-3


def test_the_frontier_has_return_share_of_clean_episodes_their_return_and_violating_steps(monkeypatch, capsys):
    def balanced(env, gain, place, settings):
        clean = np.array([10.0, 20.0, 60.0]), np.array([0.0, 0.0, 3.0])
        return clean if place < 0 else (np.array([7.0, 9.0, 11.0]), np.array([1.0, 2.0, 3.0]))

    monkeypatch.setattr(pendulum_lqr, "regulator", lambda env: np.zeros((1, 4)))
    monkeypatch.setattr(pendulum_lqr, "balance", balanced)
    assert pendulum_lqr.main(["episodes=3"]) == 0
    _, first, *_, last = [line.split("|") for line in capsys.readouterr().out.splitlines()]
    assert [float(part) for part in first] == [-0.014, 30.0, 66.7, 15.0, 1.0]
    assert [float(part) for part in last] == pytest.approx([0.0, 9.0, 0.0, np.nan, 2.0], nan_ok=True)
