"""Update the adversary's θ and φ on the sum of its loss terms, one per equation (Algorithm 1, lines 5 and 6).

Every term is minimised; where the paper maximises an objective, the term is its negative. No term reads the true cost. Only
the rows that know the true reward read it, through `Scores.f`.
"""

from typing import Any

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, PRNGKeyArray

from aircl_jax.algorithm.sampler import take
from aircl_jax.algorithm.terms.logits import Batches
from aircl_jax.algorithm.terms.table import TERMS
from aircl_jax.model.networks import BoundNetworks
from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.types import Metrics, Params


def make_optimiser(config: TrainConfig) -> optax.GradientTransformation:
    return optax.adam(config.adversary.learning_rate)


def score_all(nets: BoundNetworks, batches: Batches) -> Batches:
    """Score the four sets, each [N, …], given as pairs of trajectories and log π of their actions under the present policy."""
    return Batches(*(jax.vmap(nets.scores)(*pair) for pair in batches))


def minibatch(batches: Batches, size: int, key: PRNGKeyArray) -> Batches:
    """Draw `size` of each set without replacement; take the whole set where it holds no more."""

    def some(batch: Any, key: PRNGKeyArray) -> Any:
        number = jax.tree.leaves(batch)[0].shape[0]
        return batch if number <= size else take(batch, jax.random.permutation(key, number)[:size])

    return Batches(*map(some, batches, jax.random.split(key, len(batches))))


def update(nets: BoundNetworks, opt_state: Any, batches: Batches, key: PRNGKeyArray) -> tuple[Params, Any, Metrics]:
    """Take `num_steps` Adam steps on the sum of the method's terms, θ and φ together (lines 5 and 6); ω stays unchanged."""
    method, config, params = nets.method, nets.config, nets.params
    if not method.terms:
        return params, opt_state, {}
    optimiser = make_optimiser(config)
    size = max(1, config.adversary.minibatch_size // nets.env.horizon)

    pairs = Batches(*((batch, jax.vmap(nets.log_pi)(batch)) for batch in batches))

    def loss(trainable: tuple, batches: Batches) -> tuple[Array, Metrics]:
        reward, feasibility = trainable
        scores = score_all(nets.with_params(reward=reward, feasibility=feasibility), batches)
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
