"""Train by imitation's AIRL in as many processes as there are cores, and judge what its policies do by our own measures."""

import json
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from experiments.benchmark.settings import PEER_PYTHON, Effort

GYMNASIUM = {"swimmer": "Swimmer-v4", "pendulum": "InvertedPendulum-v4", "walker": "Walker2d-v4"}
# Its own settings: those of its examples, with a minibatch at which it is faster than at its default of 64.
OWN = {"epochs": 10, "minibatch": 500, "steps": 8, "judged": 1024}
OWN_ON_GRIDS = {**OWN, "minibatch": 350}
SHORT = 100  # steps: a shorter episode says so little that ten times as many are played


def own_settings(world: str) -> dict[str, int]:
    """Return the settings that imitation has of its own: as many trajectories a round as the paper's rows have."""
    from aircl_jax.settings.env_defaults import default_config

    chosen = OWN if world in GYMNASIUM else OWN_ON_GRIDS
    return {**chosen, "trajectories": default_config(world, "paper").num_trajectories}


def equal_settings(spec: Any) -> dict[str, int]:
    """Return the settings with which imitation does what a run of ours does.

    A row whose reward follows the moments moves it once an iteration, and so the discriminator does.
    """
    config, method = spec.config, spec.method
    pool = config.pool_factor if method.has_pool else 1
    return {
        "epochs": config.ppo.num_epochs,
        "minibatch": config.ppo.minibatch_size,
        "steps": config.adversary.num_steps if method.terms else 1,
        "judged": config.adversary.minibatch_size if method.terms else OWN["judged"],
        "trajectories": config.num_trajectories * pool,
    }


def trained(spec: Any, chosen: Mapping[str, int], effort: Effort, processes: int, judge: bool) -> dict[str, Any]:
    """Train in several processes at once, each its own seed, and judge their policies after each round if asked to."""
    env = spec.env
    episodes = effort.episodes * (10 if env.horizon < SHORT else 1) if judge else 0
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        words = {
            **chosen,
            **written(spec, folder),
            "env": GYMNASIUM.get(env.name, env.name),
            "horizon": env.horizon,
            "hidden": spec.config.hidden,
            "rounds": effort.repeats,
            "seconds": effort.search_s if judge else 0.0,
            "episodes": episodes,
        }
        each = [{**words, "seed": seed, "played": str(folder / f"played_{seed}.npz")} for seed in range(processes)]
        ran = at_once(each)
        judged = [measures(env, np.load(one["played"])) for one in each] if episodes else []
    rounds = min(len(one["round_s"]) for one in ran)
    return {
        "settings": dict(chosen),
        "processes": processes,
        "steps_a_round": chosen["trajectories"] * env.horizon,
        "start_s": [round(one["start_s"], 2) for one in ran],
        "round_s": [[round(seconds, 4) for seconds in one["round_s"][: effort.repeats]] for one in ran],
        "rounds": rounds + 1,  # the first one warms up
        "return": averaged([found[0][:rounds] for found in judged], 4),
        "violation_rate": averaged([found[1][:rounds] for found in judged], 6),
    }


def averaged(each: Sequence[np.ndarray], digits: int) -> list[float]:
    """Average what was measured of each process, round by round; nothing where nothing was."""
    return np.mean(np.asarray(each, np.float64), axis=0).round(digits).tolist() if each else []


def written(spec: Any, folder: Path) -> dict[str, str]:
    """Write the demonstrations of the first seed and, of a finite world, its tables, for a Python that has not this project."""
    from aircl_jax.outcome import demonstrations_of

    expert = demonstrations_of(spec)[0]
    np.savez(folder / "demonstrations.npz", obs=np.asarray(expert.obs[0]), action=np.asarray(expert.action[0]))
    files = {"demonstrations": str(folder / "demonstrations.npz"), "tables": ""}
    if (table := spec.env.tabular) is not None:
        arrays = {name: np.asarray(getattr(table, name), np.float64) for name in ("transition", "start", "obs")}
        np.savez(folder / "tables.npz", allow_pickle=False, **arrays)
        files["tables"] = str(folder / "tables.npz")
    return files


def at_once(each: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Run a process for each of the settings, timed while all of them train. Raises ValueError where one fails."""
    script = Path(__file__).with_name("peer_airl.py")
    with ExitStack() as until_done:
        running, said = [], []
        for words in each:
            said.append(until_done.enter_context(tempfile.TemporaryFile("w+")))
            process = subprocess.Popen(
                [PEER_PYTHON, "-W", "ignore", script, json.dumps({**words, "started": time.time()})],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=said[-1],
                text=True,
            )
            until_done.enter_context(process)
            until_done.callback(process.kill)
            running.append(process)
        for process, errors in zip(running, said, strict=True):
            if process.stdout.readline() != "ready\n":
                raise ValueError(failure(script.name, errors))
        for process in running:
            process.stdin.write("go\n")
            process.stdin.flush()
        lines = [process.stdout.read() for process in running]
        for process, errors in zip(running, said, strict=True):
            if process.wait():
                raise ValueError(failure(script.name, errors))
    return [json.loads(line) for line in lines]


def failure(name: str, errors: Any) -> str:
    """Say in one line what ended a process."""
    errors.seek(0)
    last = (errors.read().strip().splitlines() or ["without a word"])[-1]
    return f"peer=true: {name} failed: {last}"


def measures(env: Any, played: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Measure mean return and violation rate of each round, [R], of states [R, N, T + 1, S] and actions [R, N, T, …]."""
    states, actions = played["states"], played["actions"]
    if env.tabular is not None:
        cell = states[..., :-1, 0].astype(int)
        reward, cost = np.asarray(env.tabular.reward)[cell, actions], np.asarray(env.tabular.cost)[cell]
    else:
        reward, cost = of_body(env.name, states, actions)
    return reward.sum(-1).mean(-1), cost.mean((-2, -1))


def of_body(name: str, states: np.ndarray, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute reward and cost of each step of a body's default task."""
    import jax
    import jax.numpy as jnp

    from envs import ENVS
    from envs.robots.constraints import find_rule
    from envs.robots.robot import compile_model
    from envs.robots.tasks import ROBOTS, RobotState

    robot, options = ROBOTS[name], ENVS[name].options()
    model = compile_model(robot.body, options.integrator)
    rule, dt = find_rule(name, options, model), float(model.opt.timestep) * robot.body.frame_skip

    def of_step(before: Any, after: Any, action: Any) -> tuple[Any, Any]:
        clipped = robot.action_space.clip(action)
        now, later = (RobotState(state[: model.nq], state[model.nq :]) for state in (before, after))
        reward = robot.tasks[rule.task].reward(now, later, clipped, dt)
        return reward, rule.violated(later, clipped).astype(jnp.float32)

    flat = [np.asarray(part, np.float32) for part in (states[..., :-1, :], states[..., 1:, :], actions)]
    reward, cost = jax.jit(jax.vmap(of_step))(*(part.reshape(-1, part.shape[-1]) for part in flat))
    return np.asarray(reward).reshape(actions.shape[:-1]), np.asarray(cost).reshape(actions.shape[:-1])
