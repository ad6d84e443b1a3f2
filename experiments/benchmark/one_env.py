"""Report the speed of one environment: steps per second, start-up, memory, and the time of each part of an iteration."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from aircl_jax.messages import say
from experiments.benchmark.settings import Settings
from experiments.physics import BODIES
from experiments.shared.memory import most_memory

REPEATS = 5  # repeats of each timing; the median is printed
CHUNKS = 2  # chunks of a timed run; the first one compiles and is left out


def report(settings: Settings) -> None:
    """Measure and print the report."""
    rows = measure(settings)
    import jax

    say(f"{settings.world}, {settings.method}, {len(jax.devices())} devices on {os.cpu_count()} cores, jax {jax.__version__}")
    for name, value in rows.items():
        say(f"  {name:<58} {value}")


def measure(settings: Settings) -> dict[str, str]:
    """Measure each line of the report and return {line: value as text}."""
    rows = {}
    for seeds in dict.fromkeys((settings.seeds, 1)):
        steps, compiling = throughput(settings, seeds)
        rows[f"whole training, {seeds} seed(s), env steps/s"] = f"{steps:,.0f}"
        rows[f"  tracing and compiling, {seeds} seed(s), s"] = f"{compiling:.1f}"
    memory = peak_memory()
    rows |= parts(settings)
    rows["second start until the first iteration is on disk, s"] = f"{second_start(settings):.1f}"
    rows["peak memory of this process after both trainings, GiB"] = memory
    return rows


def peak_memory() -> str:
    """Return the most memory that this process held, in GiB; unknown on systems that do not say."""
    most = most_memory()
    return f"{most / 2**30:.2f}" if most else "unknown"


def throughput(settings: Settings, seeds: int) -> tuple[float, float]:
    """Run with checkpoints and metrics; return `env_steps_per_s` and `compile_s` of the summary."""
    from aircl_jax import train
    from aircl_jax.methods import get_method
    from aircl_jax.settings.env_defaults import default_config

    chunk = settings.chunk or default_config(settings.world, get_method(settings.method).settings).checkpoint_every
    with tempfile.TemporaryDirectory() as place:
        result = train(
            settings.world,
            settings.method,
            seeds=seeds,
            iterations=CHUNKS * chunk,
            run_dir=Path(place) / "run",
            env_settings=settings.env_settings,
            config=settings.training,
        )
    return result.summary["env_steps_per_s"], result.summary["compile_s"]


def parts(settings: Settings) -> dict[str, str]:
    """Time one iteration's parts in milliseconds, for one seed on one device, each compiled alone.

    The ratios divide the whole step's time by a part's.
    """
    import jax

    from aircl_jax.algorithm import adversary
    from aircl_jax.algorithm.learners import ppo
    from aircl_jax.algorithm.policy_reward import policy_reward
    from aircl_jax.algorithm.rollout import rollouts
    from aircl_jax.algorithm.terms.logits import Batches
    from aircl_jax.algorithm.trainer import make_trainer
    from aircl_jax.demonstrations.sources import demonstrations
    from aircl_jax.methods import get_method
    from aircl_jax.settings.env_defaults import default_config
    from envs import make_env
    from envs.settings import updated

    env, method = make_env(settings.world, **settings.env_settings), get_method(settings.method)
    config = updated(default_config(settings.world, method.settings), settings.training)
    trainer = make_trainer(env, method, config)
    expert = jax.tree.map(lambda leaf: leaf[0], demonstrations(env, [0], config)[0])
    state = jax.jit(trainer.init)(jax.random.key(0), expert)
    nets, number = trainer.networks.bind(state.params, state.obs_stats), config.num_trajectories * config.pool_factor

    policy, rolling = _timed(lambda key: rollouts(nets, key, number), state.key)
    head = jax.tree.map(lambda leaf: leaf[: config.num_trajectories], policy)
    (reward, bonus), relabelling = _timed(lambda batch: policy_reward(nets, expert, batch), policy)
    _, discriminating = _timed(
        lambda batch: adversary.update(
            nets, state.adversary_opt, Batches(expert, batch, state.replay, state.replay), state.key
        ),
        head,
    )
    _, acting = _timed(lambda batch: ppo.update(nets, state.ppo_opt, batch, reward, bonus, state.key, config.ppo), policy)
    _, whole = _timed(trainer.step, state, expert)
    actions = policy.action.swapaxes(0, 1)
    _, bare = _timed(partial(physics, env), state.key, actions)
    times = {
        "bare physics": bare,
        "rollout": rolling,
        "relabelling": relabelling,
        "adversary": discriminating,
        "PPO": acting,
        "whole step": whole,
    }
    ratios = {"bare physics": whole / bare, "rollout": whole / rolling}
    if settings.world in BODIES:
        by_mjx = make_env(settings.world, **settings.env_settings, engine="mjx")
        _, tenth = _timed(partial(physics, by_mjx), state.key, actions[: len(actions) // 10])
        times["a tenth of the steps by engine mjx"] = tenth
        ratios["bare physics by engine mjx"] = whole / (10 * tenth)
    rows = {f"one seed, one device: {name}, ms": f"{1e3 * seconds:.1f}" for name, seconds in times.items()}
    return rows | {f"one seed, one device: whole step / {name}": f"{ratio:.2f}" for name, ratio in ratios.items()}


def physics(env: Any, key: Any, actions: Any) -> Any:
    """Step each environment through `actions`, [T, N, A], from a reset on, and return the rewards, [T, N]."""
    import jax

    keys = jax.random.split(key, actions.shape[1])

    def one_step(states: Any, now: Any) -> Any:
        states, result = jax.vmap(env.step)(keys, states, now)
        return states, result.reward

    return jax.lax.scan(one_step, jax.vmap(env.reset)(keys)[0], actions)[1]


def _timed(function: Callable[..., Any], *inputs: Any) -> tuple[Any, float]:
    import jax

    compiled = jax.jit(function)
    result = jax.block_until_ready(compiled(*inputs))
    seconds = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        jax.block_until_ready(compiled(*inputs))
        seconds.append(time.perf_counter() - start)
    return result, median(seconds)


def second_start(settings: Settings) -> float:
    """Measure the seconds from the command to its first iteration's metrics on disk, with a warm compilation cache."""
    seconds = 0.0
    for _ in range(2):
        with tempfile.TemporaryDirectory() as place:
            metrics = Path(place) / "run" / "metrics.jsonl"
            words = [
                f"env={settings.world}",
                f"method={settings.method}",
                f"seeds={settings.seeds}",
                "iterations=1",
                "train.checkpoint_every=1",
            ]
            command = [sys.executable, "-m", "experiments.run", *words, f"run_dir={metrics.parent}"]
            start = time.perf_counter()
            with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
                while process.poll() is None and not (metrics.exists() and _has_line(metrics)):
                    time.sleep(0.05)
                seconds = time.perf_counter() - start
                process.kill()
    return seconds


def _has_line(path: Path) -> bool:
    text = path.read_text(encoding="utf-8")
    return text.endswith("\n") and bool(json.loads(text.splitlines()[0]))
