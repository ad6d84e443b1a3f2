"""Measure speed and deviation from C MuJoCo of every body, the table of docs/physics.md: `python -m experiments.physics`.

Settings, as NAME=VALUE (bad input prints one line on standard error and exits with 2):

bodies  all, or some of swimmer, walker, halfcheetah, hopper and pendulum, with commas between
mjx     true adds the engine mjx, which compiles for minutes
"""

import importlib
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from aircl_jax.messages import say
from aircl_jax.reports import markdown
from experiments.cli.command import run_command
from experiments.cli.words import listed

BODIES = ("swimmer", "walker", "halfcheetah", "hopper", "pendulum")
ENVS_AT_ONCE, STEPS, REPEATS = 500, 100, 5
OPEN_LOOP = 50  # control steps
HEAD = ("body", "engine", "integrator", "env steps/s, best (median)", "compile s", "|Δqpos| from fine RK4 after 50 steps")
FINE = 10  # substeps of the reference per substep of the model


@dataclass(frozen=True)
class Settings:
    bodies: str = "all"
    mjx: bool = False


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(print_table, argv, Settings(), __doc__)


def print_table(settings: Settings, _: Sequence[str]) -> None:
    """Print the table, each row as soon as it is measured."""
    bodies = listed("body", settings.bodies, BODIES)
    import jax

    jax.config.update("jax_enable_compilation_cache", False)  # so that compiling is timed
    say(markdown.table(HEAD, []))
    for name in bodies:
        for engine in ("planar", "mjx") if settings.mjx else ("planar",):
            for integrator in ("euler", "rk4"):
                say(markdown.row(measured(name, engine, integrator)))


def measured(name: str, engine: str, integrator: str) -> tuple[str, ...]:
    """Measure one row of the table."""
    best, median, compiling = speed(name, engine, integrator)
    off = f"{deviation(name, engine, integrator):.1e}"
    return name, engine, integrator, f"{best:,.0f} ({median:,.0f})", f"{compiling:.0f}", off


def speed(name: str, engine: str, integrator: str) -> tuple[float, float, float]:
    """Measure environment steps per second under random actions, best and median of the repeats, and seconds to compile."""
    per_second, compiling = speeds(name, engine, integrator)
    return max(per_second), sorted(per_second)[REPEATS // 2], compiling


def speeds(
    name: str, engine: str, integrator: str, envs: int = ENVS_AT_ONCE, steps: int = STEPS, repeats: int = REPEATS
) -> tuple[list[float], float]:
    """Measure environment steps per second under random actions, of each repeat, and seconds to compile."""
    import jax

    from envs import make_env

    env = make_env(name, engine=engine, integrator=integrator)

    def episode(key: Any) -> Any:
        key_reset, key_steps = jax.random.split(key)

        def one(state: Any, key: Any) -> Any:
            action = jax.random.normal(key, env.action_space.shape)
            state, step = env.step(key, state, action)
            return state, step.reward

        return jax.lax.scan(one, env.reset(key_reset)[0], jax.random.split(key_steps, steps))[1].sum()

    mesh = jax.make_mesh((len(jax.devices()),), ("env",), axis_types=(jax.sharding.AxisType.Auto,))
    spec = jax.sharding.PartitionSpec("env")
    run = jax.jit(jax.shard_map(jax.vmap(episode), mesh=mesh, in_specs=spec, out_specs=spec, check_vma=False))
    keys = jax.random.split(jax.random.key(0), envs)
    compiling = _seconds(partial(run, keys))
    return [envs * steps / _seconds(partial(run, keys)) for _ in range(repeats)], compiling


def _seconds(run: Any) -> float:
    import jax

    start = time.perf_counter()
    jax.block_until_ready(run())
    return time.perf_counter() - start


def deviation(name: str, engine: str, integrator: str, episodes: int = 20) -> float:
    """Compute the largest |Δqpos| (m, rad) from RK4 at a tenth of the timestep under smooth torques; the median of episodes."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    from envs.robots.robot import ENGINES, compile_model
    from envs.robots.tasks import ROBOTS

    mujoco: Any = importlib.import_module("mujoco")
    robot, generator = ROBOTS[name], np.random.default_rng(0)
    body, fine = robot.body, compile_model(robot.body, "rk4")
    fine.opt.timestep, fine.opt.iterations, fine.opt.ls_iterations = fine.opt.timestep / FINE, 100, 50
    step = jax.jit(jax.vmap(ENGINES[engine](compile_model(body, integrator), body, integrator)))
    phase = generator.uniform(0, 2 * np.pi, (episodes, fine.nu))
    waves = [0.2 * np.sin(0.3 * t + phase) for t in range(OPEN_LOOP)]
    qpos = fine.qpos0 + generator.uniform(-body.reset_noise, body.reset_noise, (episodes, fine.nq))
    ours = jnp.float32(qpos), jnp.zeros((episodes, fine.nv))
    for action in waves:
        ours = step(*ours, jnp.float32(action))
    off = []
    for episode in range(episodes):
        data = mujoco.MjData(fine)
        data.qpos = qpos[episode]
        for action in waves:
            data.ctrl = action[episode]
            mujoco.mj_step(fine, data, nstep=body.frame_skip * FINE)
        off.append(np.abs(np.asarray(ours[0][episode]) - data.qpos).max())
    return float(np.median(off))


if __name__ == "__main__":
    sys.exit(main())
