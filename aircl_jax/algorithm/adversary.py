"""Update the adversary's θ and φ on the sum of its loss terms, one per equation (Algorithm 1, lines 5 and 6).

Every term is minimised; where the paper maximises an objective, the term is its negative. No term reads the true cost. Only
the rows that know the true reward read it, through `Scores.f`.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, PRNGKeyArray

from aircl_jax.algorithm.sampler import take
from aircl_jax.algorithm.terms.logits import Batches, StateScores
from aircl_jax.algorithm.terms.table import TERMS
from aircl_jax.methods import Method
from aircl_jax.model.networks import BoundNetworks
from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.types import Metrics, Params


def make_optimiser(method: Method, config: TrainConfig) -> optax.GradientTransformation:
    """Make Adam of (θ, φ); the slopes of a potential go down their own gradient.

    Where D_E hardly tells a slope its gradient is small and noisy. Adam would make whole steps of it, in any direction.
    """
    adam = optax.adam(config.adversary.learning_rate)
    if not method.state_reward:
        return adam
    descent = optax.sgd(config.adversary.potential_rate)
    return optax.partition({"network": adam, "slopes": descent}, _kinds)


def _kinds(trainable: tuple[Any, Any]) -> tuple[Any, Any]:
    reward, feasibility = trainable
    kinds = {
        name: "slopes" if name == "potential" else jax.tree.map(lambda _: "network", part) for name, part in reward.items()
    }
    return kinds, jax.tree.map(lambda _: "network", feasibility)


def score_all(nets: BoundNetworks, batches: Batches) -> Batches:
    """Score the four sets, each [N, …], given as pairs of trajectories and log π of their actions under the present policy."""
    return _each(lambda pair: jax.vmap(nets.scores)(*pair), batches)


def minibatch(batches: Batches, size: int, key: PRNGKeyArray) -> Batches:
    """Draw `size` of each set without replacement; take the whole set where it holds no more."""

    def some(batch: Any, key: PRNGKeyArray) -> Any:
        number = jax.tree.leaves(batch)[0].shape[0]
        return batch if number <= size else take(batch, jax.random.permutation(key, number)[:size])

    keys = iter(jax.random.split(key, len(batches.sets)))
    return _each(lambda batch: some(batch, next(keys)), batches)


def update(
    nets: BoundNetworks,
    opt_state: Any,
    batches: Batches,
    key: PRNGKeyArray,
    of_states: Callable[[BoundNetworks], StateScores] | None = None,
) -> tuple[Params, Any, Metrics]:
    """Take `num_steps` Adam steps on the sum of the method's terms, θ and φ together (lines 5 and 6); ω stays unchanged.

    `of_states` scores the states of a finite world, in rows with a reward of states.
    """
    method, config, params = nets.method, nets.config, nets.params
    if not method.terms:
        return params, opt_state, {}
    optimiser = make_optimiser(method, config)
    size = max(1, config.adversary.minibatch_size // nets.env.horizon)

    pairs = _each(lambda batch: (batch, jax.vmap(nets.log_pi)(batch)), batches)

    def loss(trainable: tuple, batches: Batches) -> tuple[Array, Metrics]:
        reward, feasibility = trainable
        trained = nets.with_params(reward=reward, feasibility=feasibility)
        scores = score_all(trained, batches)._replace(states=of_states(trained) if of_states else None)
        values = {name: TERMS[name](method, config, config.coefficients, scores) for name in method.terms}
        return sum(values.values(), jnp.zeros(())), {f"loss_{name}": value for name, value in values.items()}

    def one_step(carry: tuple, key_step: PRNGKeyArray) -> tuple[tuple, Metrics]:
        trainable, opt_state = carry
        grads, metrics = jax.grad(loss, has_aux=True)(trainable, minibatch(pairs, size, key_step))
        updates, opt_state = optimiser.update(grads, opt_state)
        return (optax.apply_updates(trainable, updates), opt_state), metrics

    start = ((params.reward, params.feasibility), opt_state)
    keys = jax.random.split(key, config.adversary.num_steps)
    ((reward, feasibility), opt_state), metrics = jax.lax.scan(one_step, start, keys)
    last = {name: value[-1] for name, value in metrics.items()}
    return params._replace(reward=reward, feasibility=feasibility), opt_state, last


def _each(of: Callable[[Any], Any], batches: Batches) -> Batches:
    """Apply a function to each of the four sets, in order."""
    expert, sampled, policy, replay = map(of, batches.sets)
    return Batches(expert, sampled, policy, replay)
