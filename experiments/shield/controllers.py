"""Provide controllers that know nothing of the constraint: an expert's unconstrained seed, or a clone of its episodes."""

import tempfile
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from aircl_jax import train
from aircl_jax.algorithm.learners.lagrangian import bound
from aircl_jax.demonstrations import files
from aircl_jax.demonstrations.sources import load_shipped
from aircl_jax.experts.config import read_config
from aircl_jax.experts.selection import MEASURED, Sampler, best_free, free_episodes, make_runner, measure
from aircl_jax.experts.training import make_training, settled
from aircl_jax.runs.opening import open_saved
from aircl_jax.types import Trajectory
from envs import Env

CLONE = "clone"
FREE = "unconstrained expert"  # of the reference set's groups
CLONING = {"num_trajectories": 2, "num_evaluation": 2, "checkpoint_every": 50, "num_demonstrations": 20}
CLONE_ITERATIONS = 100
CHOICE_SEED = 2_147_483_643  # of the key by which an expert's unconstrained seed is chosen: no run's seed

Controller = Callable[[Array, Array], Array]


def controller_of(expert: str, env: Env) -> tuple[Controller, str]:
    """Return a controller, and a sentence on it. `expert` is the folder of a run of `experiments.expert`, or `clone`."""
    return clone(env) if expert == CLONE else trained(Path(expert), env)


def clone(env: Env) -> tuple[Controller, str]:
    """Clone the unconstrained expert's episodes of the reference set that the world ships."""
    name = env.shipped_demonstrations
    if name is None:
        raise ValueError(f"env={env.name} ships no reference set of these settings; give expert=DIR of experiments.expert")
    with resources.as_file(resources.files("envs") / "demonstrations" / f"{name}_reference.npz") as path:
        groups = len(files.metadata(path)["groups"])
    episodes = unconstrained(load_shipped(f"{name}_reference", env), groups)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "unconstrained.npz"
        files.save(path, episodes, {"source": f"{name}_reference.npz, {FREE}"})
        result = train(
            env, "bc", seeds=1, iterations=CLONE_ITERATIONS, demonstrations=path, config={**CLONING, "ppo": {"num_epochs": 10}}
        )
    return (
        lambda obs, key: result.policy(obs).sample(seed=key),
        f"a clone of the {len(episodes.mask)} episodes of the unconstrained expert in {name}_reference.npz",
    )


def unconstrained(reference: Trajectory, groups: int) -> Trajectory:
    """Take the unconstrained expert's episodes out of a reference set of that many groups."""
    kept = free_episodes(reference, groups)
    if not np.asarray(kept.cost).any():
        raise ValueError("the reference set has no episode that violates; give expert=DIR of experiments.expert")
    return kept


def trained(folder: Path, env: Env) -> tuple[Controller, str]:
    """Load the unconstrained seed that a run of `experiments.expert` would choose, from its newest checkpoint."""
    directory = open_saved(folder)
    settings: Any = directory.settings
    name = settings["env"].get("name")
    if name != env.name or "free_seeds" not in settings:
        raise ValueError(f"expert={folder} is no run of experiments.expert on {env.name}; choose one")
    config = read_config({**settings["train"], "iterations": settings["iterations"]})
    training, total = make_training(env, config), settings["seeds"] + settings["free_seeds"]
    seeds = range(settings["first_seed"], settings["first_seed"] + total)
    runner = make_runner(training, seeds, [place < settings["seeds"] for place in range(total)])
    states = settled(directory.load(jax.eval_shape(runner.init)))
    free = [jax.tree.map(lambda leaf, i=i: leaf[i], jax.device_get(states)) for i in range(settings["seeds"], total)]
    draw, key = Sampler(env, training.nets), jax.random.key(CHOICE_SEED)
    best = best_free([measure(draw(state, jax.random.fold_in(key, i), MEASURED)) for i, state in enumerate(free)])
    nets = bound(training.nets, free[best])
    return (
        lambda obs, key: nets.policy(obs, jnp.asarray(0)).sample(seed=key),  # pyright: ignore[reportReturnType]
        f"the unconstrained expert, seed {seeds[settings['seeds'] + best]} of {folder}",
    )
