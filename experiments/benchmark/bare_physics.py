"""Time the physics of a robot alone: C MuJoCo's `rollout` on all cores, MJX, and our engine."""

import importlib
import time
from typing import Any

from experiments.benchmark.settings import Effort
from experiments.physics import BODIES, speeds


def measured(world: str, effort: Effort, cores: int) -> dict[str, list[float]]:
    """Measure environment steps per second under random actions, by engine, of each repeat; of a grid there is no physics."""
    if world not in BODIES:
        return {}
    envs, steps = effort.physics
    found = {"mujoco": by_rollout(world, envs, steps, effort.repeats, cores)}
    for engine in ("mjx", "planar"):
        found[engine] = speeds(world, engine, "euler", envs, steps, effort.repeats)[0]
    return {engine: [round(each, 1) for each in values] for engine, values in found.items()}


def by_rollout(world: str, envs: int, steps: int, repeats: int, threads: int) -> list[float]:
    """Measure C MuJoCo on the same model, integrator and solver settings; the first of the rollouts warms up."""
    import numpy as np

    from envs.robots.robot import compile_model
    from envs.robots.tasks import ROBOTS

    mujoco: Any = importlib.import_module("mujoco")
    rollout: Any = importlib.import_module("mujoco.rollout")
    body, model = ROBOTS[world].body, compile_model(ROBOTS[world].body, "euler")
    draws = np.random.default_rng(0)
    start = np.zeros((envs, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    start[:, 1 : 1 + model.nq] = model.qpos0 + draws.uniform(-body.reset_noise, body.reset_noise, (envs, model.nq))
    action = np.repeat(draws.normal(size=(envs, steps, model.nu)), body.frame_skip, axis=1)
    seconds = []
    with rollout.Rollout(nthread=threads) as pool:
        data = [mujoco.MjData(model) for _ in range(threads)]
        for _ in range(1 + repeats):
            begun = time.perf_counter()
            pool.rollout(model, data, start, action)
            seconds.append(time.perf_counter() - begun)
    return [envs * steps / each for each in seconds[1:]]
