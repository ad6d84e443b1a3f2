"""Provide demonstrations: from exact soft-optimal experts of tabular worlds, and from shipped files for the robots."""

from collections.abc import Sequence
from importlib import resources

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from aircl_jax.demonstrations.files import from_arrays, load
from aircl_jax.demonstrations.soft_optimal import lapsing, plan_expert, sample_table, soft_value_iteration
from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.types import Trajectory
from envs import Env, Recorded, Shipped, SoftOptimalExpert

REFERENCE_SIZE = 500  # trajectories of a tabular world's reference set
REFERENCE_SEED = 2_147_483_646  # of its key; no run has this seed
PERTURBATION = 0.1  # share of uniform actions in the reference set's perturbed experts


def demonstrations(env: Env, seeds: Sequence[int], config: TrainConfig, task: int = 0) -> tuple[Trajectory, Trajectory]:
    """Provide D_E of every seed, [S, N, T, …], and the environment's reference set, [M, T, …].

    A grid's D_E is drawn from its exact expert, anew for each seed and for each number of a task; an animal's is its recorded
    data and a robot's is shipped, the same for all seeds. Where nothing is known to score by, D_E itself stands for the
    reference set.
    """
    match env.expert:
        case Recorded() as data:
            recorded = from_arrays(data.demonstrations(), env)
            known = data.reference
            return _for_all(recorded, len(seeds)), recorded if known is None else from_arrays(known(), env)
        case SoftOptimalExpert() as planner:
            expert = plan_expert(env, planner)
            keys = jax.vmap(lambda seed: jax.random.fold_in(jax.random.key(seed), 1 + task))(jnp.asarray(seeds, jnp.uint32))
            draw = jax.jit(jax.vmap(lambda key: sample_table(env, expert, key, config.num_demonstrations)))
            return draw(keys), tabular_reference(env, planner, expert)
        case Shipped(name):
            shipped = load_shipped(name, env)
            if config.num_demonstrations > len(shipped.mask):
                asked = f"train.num_demonstrations={config.num_demonstrations}"
                raise ValueError(f"{asked}: env={env.name} ships {len(shipped.mask)}; choose at most that")
            expert = _first(shipped, config.num_demonstrations)
            return _for_all(expert, len(seeds)), load_shipped(f"{name}_reference", env)
        case None:
            raise ValueError(f"env={env.name} ships no demonstrations of these settings; give some with demonstrations=FILE")


def tabular_reference(env: Env, planner: SoftOptimalExpert, expert: Float[Array, "T X A"]) -> Trajectory:
    """Draw half from the unconstrained soft-optimal policy, half from the expert with a tenth of its actions uniform."""
    table, half = planner.table, REFERENCE_SIZE // 2
    free = soft_value_iteration(table, table.reward, env.horizon, planner.temperature, forbid=False)
    perturbed = lapsing(expert, PERTURBATION)
    key_free, key_perturbed = jax.random.split(jax.random.key(REFERENCE_SEED))
    halves = (
        sample_table(env, free.log_policy, key_free, half),
        sample_table(env, perturbed, key_perturbed, REFERENCE_SIZE - half),
    )
    return jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *halves)


def load_shipped(name: str, env: Env) -> Trajectory:
    """Read a set of trajectories that the package ships, envs/demonstrations/NAME.npz."""
    with resources.as_file(resources.files("envs") / "demonstrations" / f"{name}.npz") as path:
        return load(path, env)


def _for_all(trajectories: Trajectory, num_seeds: int) -> Trajectory:
    return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (num_seeds, *leaf.shape)), trajectories)


def _first(trajectories: Trajectory, number: int) -> Trajectory:
    return jax.tree.map(lambda leaf: leaf[:number], trajectories)
