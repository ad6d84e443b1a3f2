"""The learner beside Brax's PPO: the same world, the true reward, no constraint, as many steps."""

import shlex
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np

from aircl_jax import make_env
from aircl_jax.messages import say
from aircl_jax.reports import markdown
from aircl_jax.settings.learner_config import LearnerConfig, learner_config
from aircl_jax.transfer.objectives import no_cost, objective, world_reward
from aircl_jax.transfer.swap import EPISODE_SEED, EPISODES, recombine
from envs import Env
from envs.robots.practice_worlds import ending
from experiments.cli.words import listed
from experiments.learner.brax_ppo import EIGHTH, NOTEBOOK, brax_ppo, returns_of, train_ppo
from experiments.shared.commits import current_commit
from experiments.shared.kept_files import keep, read_kept

BODIES = ("halfcheetah", "hopper")
OURS = "ours"
PEERS: Mapping[str, Mapping[str, Any]] = {"brax": NOTEBOOK, "brax_eighth": EIGHTH}
ABOUT = {
    OURS: "ours (docs/learner.md)",
    "brax": "Brax's PPO, settings of its notebook",
    "brax_eighth": "the same, an eighth of environments and batch",
}
ITERATIONS = 240  # of ours, which sets the steps of all


@dataclass(frozen=True)
class Budget:
    """What every learner gets."""

    seeds: range
    iterations: int
    out: Path


def compare(bodies: str, budget: Budget, words: Sequence[str]) -> None:
    """Train the cells that are missing, then write the table of all that are there."""
    chosen = listed("task", bodies, BODIES)
    brax_ppo()  # before ours trains
    for body in chosen:
        for learner in ABOUT:
            _cell(body, learner, budget)
    cells = [read_kept(path) for path in sorted(budget.out.glob("*.json"))]
    written = budget.out.with_suffix(".md")
    written.write_text(table(cells, shlex.join(["python", "-m", "experiments.learner", *words])), encoding="utf-8")
    say(f"wrote {written}")


def budget_of(world: Env, iterations: int) -> LearnerConfig:
    """Return our settings without a constraint, for so many iterations, or for `ITERATIONS` where they are 0."""
    return replace(learner_config(world, constrained=False), iterations=iterations or ITERATIONS)


def steps_of(config: LearnerConfig, horizon: int) -> int:
    """Count the steps of one seed, those of the candidate that was dropped among them."""
    tried = 1.0 + (config.candidates - 1) * config.trial
    return int(config.iterations * config.num_trajectories * horizon * tried)


def _cell(body: str, learner: str, budget: Budget) -> None:
    path = budget.out / f"{body}_{learner}.json"
    if path.exists():
        return
    say(f"{body}: {ABOUT[learner]}")
    world, commit = make_env(body, constraint="none"), current_commit()
    config = budget_of(world, budget.iterations)
    steps, started, busy = steps_of(config, world.horizon), time.perf_counter(), time.process_time()
    if learner == OURS:
        returns, taken = _ours(world, config, budget.seeds), steps
    else:
        returns, taken = _peer(world, steps, budget.seeds, PEERS[learner])
    made = {
        "task": body,
        "learner": learner,
        "seeds": list(budget.seeds),
        "commit": commit,
        "env_steps_per_seed": taken,
        "wall_s": round(time.perf_counter() - started, 1),
        "cpu_s_per_seed": round((time.process_time() - busy) / len(budget.seeds), 1),
        "return": returns,
    }
    keep(path, made)


def _ours(world: Env, config: LearnerConfig, seeds: range) -> list[float]:
    paid = objective(world_reward(), no_cost())
    return list(recombine(world, paid, seeds, config, constrained=False).metrics["return"])


def _peer(world: Env, steps: int, seeds: range, settings: Mapping[str, Any]) -> tuple[list[float], int]:
    """Train a policy a seed and judge it by as many episodes as ours, which draw their actions too."""
    returns, taken, practice = [], 0, ending(world)
    for seed in seeds:
        act, taken = train_ppo(practice, steps, seed, settings)
        played = returns_of(world, act, EPISODES, jax.random.key(EPISODE_SEED))
        returns.append(float(np.asarray(played).mean()))
    return returns, taken


def table(cells: Sequence[Mapping[str, Any]], command: str) -> str:
    """Write one line a cell: what its policies earn, seed by seed."""
    order = list(ABOUT)
    rows = [
        (
            cell["task"],
            ABOUT[cell["learner"]],
            f"{cell['env_steps_per_seed']:,}",
            f"{np.mean(cell['return']):.0f}",
            " ".join(f"{value:.0f}" for value in cell["return"]),
            f"{cell['cpu_s_per_seed']:.0f}",
            cell["commit"],
        )
        for cell in sorted(cells, key=lambda cell: (cell["task"], order.index(cell["learner"])))
    ]
    head = ("body", "learner", "steps a seed", "mean return", "every seed", "CPU s a seed", "commit")
    return markdown.paragraphs(
        "# The learner beside Brax's PPO",
        f"`{command}`: the same worlds without a constraint, the true reward, 500 steps an episode. In practice a fall ends an "
        "episode of Brax's, and ours gets up. "
        f"Each policy is judged by {EPISODES} fresh episodes of fixed length, with its actions drawn. "
        "Brax's own settings are for 50 million steps.",
        markdown.table(head, rows),
    )
