"""Count entries into each state of a finite world: those that demonstrations made, and those they would have made."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from aircl_jax.algorithm.learners import exact
from aircl_jax.algorithm.pooling import ALONE, Pool
from aircl_jax.algorithm.terms.logits import StateScores
from aircl_jax.demonstrations.soft_optimal import occupancy
from aircl_jax.methods import Method
from aircl_jax.model.feasibility import log_delta
from aircl_jax.model.networks import BoundNetworks
from aircl_jax.types import Params, Trajectory
from envs import Env, Tabular

PRICE_FLOOR = -6.0  # least log δ₁ that π is paid and bars an entry with: a lower one leaves PPO no gradient to come back
FULL = 1e-6  # distance of a probability from 1 in the odds


class Shown(NamedTuple):
    """What D_E shows of a finite world: where it begins, where it is and when, what it does there, and what it enters."""

    start: Float[Array, " X"]
    visits: Float[Array, "T X"]
    pairs: Float[Array, "X A"]
    entered: Float[Array, " X"]  # n
    demonstrations: Float[Array, ""]  # N


def counted_table(env: Env, method: Method) -> Tabular:
    """Return the table of a world with places. Raises ValueError, in one line, where the row cannot speak of its states."""
    if env.tabular is None or env.position is None:
        raise ValueError(f"env={env.name} is no table of places, of which the row's reward speaks; choose aircl_corrected")
    if method.tests_entries and env.restore is None:
        raise ValueError(f"env={env.name} does not show its whole state, so no entry is counted; choose aircl_contrast_memory")
    return env.tabular


def entering(table: Tabular) -> Float[Array, "X A X"]:
    """Mark the likeliest successor of each action, where it is another state: what bumps or stays enters nothing."""
    aim = jnp.argmax(table.transition, axis=-1)
    away = aim != jnp.arange(len(aim))[:, None]
    return jax.nn.one_hot(aim, len(aim)) * away[..., None]


def shown_by(expert: Trajectory, env: Env, table: Tabular) -> Shown:
    """Count D_E, [N, T, …], over the states of a world that restores each from what is seen of it."""
    if env.restore is None:
        raise TypeError(f"{env.name} does not restore its states")
    states, actions = table.reward.shape
    at = jax.nn.one_hot(jax.vmap(jax.vmap(env.restore))(expert.obs), states)
    taken = jax.nn.one_hot(expert.action, actions)
    pairs = jnp.einsum("nt,ntx,nta->xa", expert.mask, at, taken)
    return Shown(
        start=at[:, 0].mean(axis=0),
        visits=jnp.einsum("nt,ntx->tx", expert.mask, at),
        pairs=pairs,
        entered=jnp.einsum("xa,xay->y", pairs, entering(table)),
        demonstrations=jnp.asarray(expert.mask.shape[0], jnp.float32),
    )


def log_policy(nets: BoundNetworks, table: Tabular) -> Float[Array, "T X A"]:
    """Evaluate log π(a|x, t) on every state and step."""
    actions = jnp.arange(table.reward.shape[1])

    def of(obs: Float[Array, " O"], t: Int[Array, ""]) -> Float[Array, " A"]:
        policy = nets.policy(obs, t)
        return jax.vmap(lambda action: jnp.asarray(policy.log_prob(action)))(actions)

    return jax.vmap(jax.vmap(of, (0, None)), (None, 0))(table.obs, jnp.arange(nets.env.horizon))


def model_policy(nets: BoundNetworks, expert: Trajectory, table: Tabular) -> Float[Array, "T X A"]:
    """log p(a|x, t) of Eq. 6's model, p(τ) ∝ exp(f) δ̄: the soft plan of what π is paid.

    A policy that is trained on it is always somewhat behind it, and f would explain the difference.
    """
    return exact.plan(nets, expert, table).log_policy


def tempted_policy(nets: BoundNetworks, table: Tabular, log_model: Float[Array, "T X A"]) -> Float[Array, "T X A"]:
    """π̃(a|s, t) = σ(logit p(a|s, t) − E[log δ₁(s')] + ḡ − E[g(s')]): of a, were entering s' alone ordinary.

    Ordinary is a successor of the mean reward and without a price; the other actions stay as they are.
    """
    reward = jax.vmap(nets.state_reward)(table.obs)
    gain = reward.mean() - table.transition @ reward - nets.params.entry_price
    odds = log_model - jnp.log1p(-jnp.minimum(jnp.exp(log_model), 1.0 - FULL))
    return jax.nn.sigmoid(odds + gain)


def expected_entries(nets: BoundNetworks, table: Tabular, shown: Shown, log_model: Float[Array, "T X A"]) -> Float[Array, " X"]:
    """M_s = Σ over D_E's (s_t, t) of Σ_{a enters s} π̃(a|s_t, t)."""
    return jnp.einsum("tx,txa,xay->y", shown.visits, tempted_policy(nets, table, log_model), entering(table))


def model_counts(table: Tabular, shown: Shown, log_model: Float[Array, "T X A"]) -> Float[Array, "X A"]:
    """Compute E_p[Σ_t 1[x_t = x, a_t = a]] of episodes that begin where D_E's do, exactly."""
    visits = occupancy(table._replace(start=shown.start), log_model)
    return jnp.einsum("tx,txa->xa", visits, jnp.exp(log_model))


def scorer(
    nets: BoundNetworks, expert: Trajectory, table: Tabular, pool: Pool = ALONE
) -> Callable[[BoundNetworks], StateScores]:
    """Return the function that scores the states of a finite world as θ and φ move; D_E and the model are counted once.

    n and M are sums over the tasks of the pool. No gradient flows through M. Rows that do not test entries score states by
    their reward alone.
    """
    if not nets.method.tests_entries:
        return lambda moved: _rewards_alone(moved, expert.mask.shape[0])
    shown, log_model = shown_by(expert, nets.env, table), model_policy(nets, expert, table)
    model = model_counts(table, shown, log_model)
    actions = jnp.arange(table.reward.shape[1])

    def score(moved: BoundNetworks) -> StateScores:
        f = jax.vmap(jax.vmap(moved.reward, (None, 0)), (0, None))(table.obs, actions)
        return StateScores(
            reward=jax.vmap(moved.state_reward)(table.obs),
            potential=moved.params.reward["potential"],
            step_logit=_step_logits(moved, table.obs),
            entered=pool.total(shown.entered),
            expected=pool.total(jax.lax.stop_gradient(expected_entries(moved, table, shown, log_model))),
            demonstrations=shown.demonstrations,
            expert_f=(shown.pairs * f).sum() / shown.demonstrations,
            model_f=(model * f).sum(),
        )

    return score


def begun(params: Params, states: int, pool: Pool) -> Params:
    """Let the tasks of a pool begin with one feasibility, and with no evidence."""
    if pool.tasks == 1:
        return params
    return params._replace(feasibility=pool.first(params.feasibility), evidence=jnp.zeros((2, states)))


def noted(
    nets: BoundNetworks,
    table: Tabular,
    score: Callable[[BoundNetworks], StateScores],
    step: Int[Array, ""],
    pool: Pool,
) -> Params:
    """Return the parameters with the price of entries, and where tasks share one constraint with their n and M."""
    params = nets.params._replace(entry_price=entry_price(nets, table, step))
    if pool.tasks == 1:
        return params
    states = score(nets)
    return params._replace(evidence=jnp.stack([states.entered, states.expected]))


def entry_price(nets: BoundNetworks, table: Tabular, step: Int[Array, ""]) -> Float[Array, "X A"]:
    """E[max(log δ₁(s'), −6)] of each state and action, once `feasibility_delay` iterations have passed; 0 before."""
    coefficients = nets.config.coefficients
    threshold = jnp.log(jnp.asarray(coefficients.threshold))
    delta = log_delta(nets.method, coefficients, _step_logits(nets, table.obs), threshold)
    paid = (step >= nets.config.feasibility_delay).astype(delta.dtype)
    return jax.lax.stop_gradient(paid * (table.transition @ jnp.maximum(delta, PRICE_FLOOR)))


def _rewards_alone(nets: BoundNetworks, demonstrations: int) -> StateScores:
    reward = jax.vmap(nets.state_reward)(jnp.eye(nets.env.obs_size))
    nothing, zero = jnp.zeros_like(reward), jnp.zeros(())
    number, slopes = jnp.asarray(demonstrations, jnp.float32), nets.params.reward["potential"]
    return StateScores(reward, slopes, nothing, nothing, nothing, number, zero, zero)


def _step_logits(nets: BoundNetworks, obs: Float[Array, "X O"]) -> Float[Array, " X"]:
    """z of entering each state, which does not depend on the action."""
    return jax.vmap(lambda seen: nets.step_logit(seen, jnp.zeros((), jnp.int32)))(obs)
