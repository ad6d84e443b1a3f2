"""Choose a seed among trained experts, and draw its clean episodes and the reference set."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import PartitionSpec
from jaxtyping import Array, Float, PRNGKeyArray

from aircl_jax.algorithm.learners.lagrangian import Lagrangian, LagrangianState, bound
from aircl_jax.algorithm.rollout import rollouts
from aircl_jax.experts.config import GROUP
from aircl_jax.model.networks import Networks
from aircl_jax.runs.seeds import SEED, over_seeds, seed_keys, spread
from aircl_jax.types import Metrics, Trajectory
from envs import Env

CLEAN_SHARE = 0.5  # of a seed's episodes; with fewer clean ones, dropping the others would change the policy too much
MEASURED = 100  # episodes by which a seed is measured
DRAWN = 64  # episodes drawn in one batch
LEAST_LABEL = 0.2  # share of each label in a reference set


@dataclass(frozen=True)
class Group:
    """Episodes of a reference set from one policy: which seed's, its mean action and its σ multiplied."""

    source: str  # expert or free (unconstrained)
    mean: float = 1.0
    noise: float = 1.0


REFERENCE: dict[str, Group] = {
    "expert, held out": Group("expert"),
    "expert, half the noise": Group("expert", noise=0.5),
    "expert, actions × 0.8": Group("expert", mean=0.8),
    "expert, noise × 1.5": Group("expert", noise=1.5),
    "expert, noise × 3": Group("expert", noise=3.0),
    "expert, actions × 1.3": Group("expert", mean=1.3),
    "unconstrained expert": Group("free"),
}
MORE = 2  # times as many of the unconstrained expert are added where violations are too rare


class Runner(NamedTuple):
    """`init() -> states [S, …]`, of either learner; `run_chunk(states, length) -> (states, {metric: [length, S]})`."""

    init: Callable[[], Any]
    run_chunk: Callable[[Any, int], tuple[Any, Metrics]]


def make_runner(training: Lagrangian, seeds: Sequence[int], constrained: Sequence[bool]) -> Runner:
    """Train all seeds, constrained or not, as one program over shards of seeds on every device."""
    shard, place = spread(len(seeds))
    flags = place(jnp.asarray(constrained, jnp.float32))
    init = jax.jit(shard(over_seeds(training.init), in_specs=SEED))

    @partial(jax.jit, static_argnums=2, donate_argnums=0)
    def run_chunk(states: Any, flags: Array, length: int) -> tuple[Any, Metrics]:
        def on_device(states: Any, flags: Array) -> tuple[Any, Metrics]:
            return jax.lax.scan(lambda states, _: over_seeds(training.step)(states, flags), states, length=length)

        return shard(on_device, in_specs=(SEED, SEED), out_specs=(SEED, PartitionSpec(None, "seed")))(states, flags)

    return Runner(
        init=lambda: init(place(seed_keys(seeds))),
        run_chunk=lambda states, length: run_chunk(place(states), flags, length),
    )


class EpisodeMeasures(NamedTuple):
    """Measures of one policy by fresh episodes."""

    mean: float  # mean return of all episodes
    std: float
    clean_share: float  # share of episodes without a violation
    clean_return: float  # mean return of the clean ones; NaN where there is none
    cost: float  # violating steps an episode

    def as_json(self) -> dict[str, float | None]:
        return {name: round(value, 4) if np.isfinite(value) else None for name, value in self._asdict().items()}


def measure(episodes: Trajectory) -> EpisodeMeasures:
    """Measure returns and violations of episodes [N, T, …]."""
    total, cost = (np.asarray((x * episodes.mask).sum(axis=1)) for x in (episodes.reward, episodes.cost))
    clean = cost == 0
    clean_return = float(total[clean].mean()) if clean.any() else float("nan")
    return EpisodeMeasures(float(total.mean()), float(total.std()), float(clean.mean()), clean_return, float(cost.mean()))


def best_expert(of_seeds: Sequence[EpisodeMeasures]) -> int:
    """Choose the seed with the best mean return of clean episodes, of those clean in at least half. ValueError if none is."""
    able = [i for i, measures in enumerate(of_seeds) if measures.clean_share >= CLEAN_SHARE]
    if not able:
        shares = ", ".join(f"{measures.clean_share:.2f}" for measures in of_seeds)
        raise ValueError(f"no seed is clean in {CLEAN_SHARE:.0%} of its episodes (shares: {shares}); train longer")
    return max(able, key=lambda i: of_seeds[i].clean_return)


def best_free(of_seeds: Sequence[EpisodeMeasures]) -> int:
    """Choose the seed with the greatest mean return, of those that violate in most episodes, or of all where none does."""
    violating = [i for i, measures in enumerate(of_seeds) if measures.clean_share < CLEAN_SHARE]
    return max(violating or range(len(of_seeds)), key=lambda i: of_seeds[i].mean)


def altered(policy: Any, mean: float, noise: float) -> Any:
    """Multiply the policy's mean action and its σ, in its parameters."""
    params = dict(policy["params"])
    network = dict(params["MLP_0"])
    last = max(network, key=lambda name: int(name.rpartition("_")[2]))
    network[last] = jax.tree.map(lambda leaf: mean * leaf, network[last])
    return {"params": params | {"MLP_0": network, "log_std": params["log_std"] + np.log(noise)}}


class Sampler:
    """Draws fresh episodes of one seed's policy, in batches of one compiled size."""

    def __init__(self, env: Env, nets: Networks) -> None:
        self.nets = nets
        self._rollouts = jax.jit(lambda state, key: rollouts(bound(nets, state), key, DRAWN, env))

    def __call__(self, state: LagrangianState, key: PRNGKeyArray, number: int) -> Trajectory:
        """Draw `number` episodes, [N, T, …]."""
        keys = jax.random.split(key, -(-number // DRAWN))
        batches = [self._rollouts(state, key_batch) for key_batch in keys]
        return jax.tree.map(lambda *leaves: jnp.concatenate(leaves)[:number], *batches)


def clean_episodes(draw: Sampler, state: LagrangianState, key: PRNGKeyArray, number: int) -> tuple[Trajectory, float]:
    """Take the first `number` episodes without a violation, and the share of clean ones before the others were dropped."""
    parts, drawn, number_clean = [], 0, 0
    while number_clean < number:
        key, key_draw = jax.random.split(key)
        episodes = draw(state, key_draw, DRAWN)
        clean = np.asarray((episodes.cost * episodes.mask).sum(axis=1) == 0)
        parts.append(jax.tree.map(lambda leaf, clean=clean: leaf[clean], episodes))
        drawn, number_clean = drawn + DRAWN, number_clean + int(clean.sum())
        if drawn >= number / CLEAN_SHARE * 10:
            raise ValueError(f"only {number_clean} of {drawn} episodes are clean; train longer")
    return jax.tree.map(lambda *leaves: jnp.concatenate(leaves)[:number], *parts), number_clean / drawn


def reference_set(
    draw: Sampler, expert: LagrangianState, free: LagrangianState, key: PRNGKeyArray, number: int = GROUP
) -> tuple[Trajectory, dict[str, EpisodeMeasures]]:
    """Draw `number` episodes of each of REFERENCE's groups, in order, [M, T, …]. ValueError where a label is too rare."""
    sources = {"expert": expert, "free": free}

    def episodes(index: int, group: Group, number: int) -> Trajectory:
        source = sources[group.source]
        state = source._replace(policy=altered(source.policy, group.mean, group.noise))
        return draw(state, jax.random.fold_in(key, index), number)

    parts = {name: episodes(i, group, number) for i, (name, group) in enumerate(REFERENCE.items())}
    if measure(_joined(parts.values())).clean_share > 1 - LEAST_LABEL:
        parts[f"unconstrained expert, {MORE * number} more"] = episodes(len(parts), Group("free"), MORE * number)
    whole, of_groups = _joined(parts.values()), {name: measure(part) for name, part in parts.items()}
    clean = measure(whole).clean_share
    if not LEAST_LABEL <= clean <= 1 - LEAST_LABEL:
        raise ValueError(f"{clean:.0%} of the reference set are feasible; at least {LEAST_LABEL:.0%} of each are needed")
    return whole, of_groups


def free_episodes(reference: Trajectory, groups: int) -> Trajectory:
    """Take the unconstrained expert's episodes, the last ones, out of a reference set of that many groups."""
    shares = len(REFERENCE) + (MORE if groups > len(REFERENCE) else 0)
    start = len(reference.mask) // shares * (len(REFERENCE) - 1)
    return jax.tree.map(lambda leaf: leaf[start:], reference)


def _joined(parts: Iterable[Trajectory]) -> Trajectory:
    return jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *parts)


def random_return(env: Env, key: PRNGKeyArray) -> EpisodeMeasures:
    """Draw actions N(0, 1), clipped as the world clips them."""
    shape = env.action_space.shape

    def episode(key: PRNGKeyArray) -> tuple[Float[Array, " T"], Float[Array, " T"]]:
        key_reset, key_steps = jax.random.split(key)

        def one_step(state: Any, key: PRNGKeyArray) -> tuple[Any, tuple[Array, Array]]:
            key_action, key_env = jax.random.split(key)
            state, result = env.step(key_env, state, jax.random.normal(key_action, shape))
            return state, (result.reward, result.cost)

        return jax.lax.scan(one_step, env.reset(key_reset)[0], jax.random.split(key_steps, env.horizon))[1]

    reward, cost = jax.jit(jax.vmap(episode))(jax.random.split(key, MEASURED))
    blank = jnp.zeros_like(reward)
    return measure(Trajectory(blank[..., None], blank, blank, blank, reward, cost, jnp.ones_like(reward), blank[:, 0]))
