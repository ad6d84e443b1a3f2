"""Say which limits a contrast row draws where there is none, where large actions cost, and where demonstrators lapse."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PRNGKeyArray

from aircl_jax import make_env, train
from aircl_jax.algorithm.learners.scale_free import bound
from aircl_jax.analysis.recovered_limits import recovered_limits
from aircl_jax.demonstrations import files
from aircl_jax.messages import say
from aircl_jax.runs.result import Result
from aircl_jax.settings.learner_config import learner_config
from aircl_jax.transfer import objectives
from aircl_jax.transfer.fresh import Fresh
from aircl_jax.transfer.swap import recombine
from envs import Box
from experiments.shared.commits import current_commit
from experiments.shared.kept_files import keep, read_kept
from experiments.swap.playing import played, uniform
from experiments.swap.robot_cells import Study

Cell = Mapping[str, Any]
Cells = Mapping[tuple[str, str, str], Cell]
WORLDS = ("swimmer",)
EPISODES = 50  # demonstrations, as many as are shipped
DRAW_SEED = 2_147_483_640  # of the demonstrations' key: no run's seed
FIRST_EXPERT = 9601  # seed of the experts: no fresh policy's, and 9600 had served to mend what lapses hid (docs/research.md)
FIRST_SEED = 113  # of what is learned: 110 to 112 had served with it


@dataclass(frozen=True)
class Control:
    """An expert by the learner of the swap tests, on the true reward less w‖a‖², and how it demonstrates."""

    about: str
    constrained: bool
    action_cost: float = 0.0
    lapse: float = 0.0  # share of the actions that are uniformly random


CONTROLS: Mapping[str, Control] = {
    "no constraint": Control("an expert without a constraint", constrained=False),
    "action cost .1": Control("no constraint, and each step costs .1‖a‖²", constrained=False, action_cost=0.1),
    "lapses of 1 %": Control("the constraint, and 1 % of the actions at random", constrained=True, lapse=0.01),
    "lapses of 5 %": Control("the constraint, and 5 % of the actions at random", constrained=True, lapse=0.05),
}
HEAD = (
    "control",
    "demonstrations: return; violations; outermost actions",
    "limits drawn",
    "seeds with one",
    "π: return; violations",
)


def cell(study: Study, env: str, method: str, name: str) -> Cell:
    """Return the finished cell, trained now where it is missing."""
    path = study.path(env, method, f"control {name}")
    if path.exists():
        return read_kept(path, "env", "row", "test")
    control, commit = CONTROLS[name], current_commit()
    say(f"{method} on {env}, {name}: {control.about}")
    seeds = range(FIRST_SEED, FIRST_SEED + study.seeds)
    folder = study.runs / env / f"{method}_{path.stem}"
    demonstrations = study.runs / env / f"{path.stem}.npz"
    if not demonstrations.exists():
        demonstrations.parent.mkdir(parents=True, exist_ok=True)
        demonstrate(env, control, demonstrations)
    result = train(
        env, method, seeds=len(seeds), first_seed=seeds[0], demonstrations=demonstrations, run_dir=folder, resume=True
    )
    made = {
        "env": env,
        "row": method,
        "test": name,
        "about": control.about,
        "commit": commit,
        "seeds": list(seeds),
        "demonstrated": files.metadata(demonstrations)["measured"],
        **drawn(result),
    }
    keep(path, made)
    return made


def demonstrate(env: str, control: Control, path: Path) -> None:
    """Train one expert and write its episodes, all of them."""
    world = make_env(env, action_cost=control.action_cost)
    if not isinstance(world.action_space, Box):
        raise TypeError(f"env={env} has no box of actions")
    config = learner_config(world, constrained=control.constrained)
    objective = objectives.objective(objectives.world_reward(), objectives.world_cost())
    expert = recombine(world, objective, range(FIRST_EXPERT, FIRST_EXPERT + 1), config, control.constrained)
    if not isinstance(expert.made, Fresh):
        raise TypeError(f"env={env} is planned; controls are of robots")
    acting, at_random = bound(expert.made.nets, jax.tree.map(lambda leaf: leaf[0], expert.made.states)), uniform(world)

    def act(obs: Array, t: Array, key: PRNGKeyArray) -> Array:
        key_action, key_lapse, key_random = jax.random.split(key, 3)
        action = jnp.asarray(acting.policy(obs, t).sample(seed=key_action))
        return jnp.where(jax.random.bernoulli(key_lapse, control.lapse), at_random(obs, t, key_random), action)

    shown = jax.tree.map(lambda leaf: leaf[0], played(make_env(env), act, 1, EPISODES, DRAW_SEED))
    taken = np.clip(np.asarray(shown.action), world.action_space.low, world.action_space.high)
    measured = {
        "return": float((shown.reward * shown.mask).sum(axis=1).mean()),
        "violation_rate": float((shown.cost * shown.mask).sum() / shown.mask.sum()),
        "least": taken.min((0, 1)).tolist(),
        "greatest": taken.max((0, 1)).tolist(),
    }
    files.save(path, shown, {"source": f"experiments.swap, {control.about}", "measured": measured})


def drawn(result: Result) -> Cell:
    """Return the limits of every seed, None where there is none, and what π earns."""
    limits = recovered_limits(result)
    if limits is None:
        raise TypeError(f"{result.spec.method_name} draws no limits")
    sides = {"lower": limits.lower, "upper": limits.upper}
    kept = {
        side: [[None if not np.isfinite(x) else float(x) for x in seed] for seed in values] for side, values in sides.items()
    }
    metrics = result.summary["metrics"]
    return {
        "actions": list(limits.names),
        **kept,
        "metrics": {name: metrics[name]["per_seed"] for name in ("return", "violation_rate_policy", "step_feasibility_auroc")},
    }


def lines(cells: Cells, env: str, rows: Sequence[str]) -> list[tuple[str, ...]]:
    """Make a line for each control that is there."""
    found = (cells.get((env, name, row)) for row in rows for name in CONTROLS)
    return [_line(cell) for cell in found if cell is not None]


def _line(cell: Cell) -> tuple[str, ...]:
    shown = cell["demonstrated"]
    ends = ", ".join(f"{low:.2f} to {high:.2f}" for low, high in zip(shown["least"], shown["greatest"], strict=True))
    drawn, some = [], set()
    for index, name in enumerate(cell["actions"]):
        for side in ("lower", "upper"):
            known = [(seed, values[index]) for seed, values in enumerate(cell[side]) if values[index] is not None]
            some.update(seed for seed, _ in known)
            if known:
                drawn.append(f"{name} {np.mean([value for _, value in known]):+.2f} ({len(known)})")
    metrics = {name: float(np.mean(values)) for name, values in cell["metrics"].items()}
    return (
        cell["test"],
        f"{shown['return']:.1f}; {100 * shown['violation_rate']:.2f} %; {ends}",
        ", ".join(drawn) or "none",
        f"{len(some)} of {len(cell['seeds'])}",
        f"{metrics['return']:.1f}; {100 * metrics['violation_rate_policy']:.2f} %",
    )
