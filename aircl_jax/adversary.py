"""The adversary: what the discriminator says, one loss term per equation, and the update of θ and φ (lines 5 and 6).

Every term is minimised; where the paper maximises an objective, the term is its negative. The true cost is never read, and
the true reward only by the rows that know it (through `Scores.f`).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, PRNGKeyArray

from aircl_jax.config import Coefficients, TrainConfig
from aircl_jax.feasibility import log_feasibility, log_sequence_feasibility, log_step_feasibility
from aircl_jax.methods import Method
from aircl_jax.networks import Networks
from aircl_jax.sampler import take
from aircl_jax.types import Metrics, ObsStats, Params, Scores, Trajectory


class Batches(NamedTuple):
    """The four sets of trajectories of one update, or their scores: D_E, D_S, D_P and earlier policies' trajectories."""

    expert: Any
    sampled: Any
    policy: Any
    replay: Any


def mean_over_steps(x: Float[Array, "N T"], mask: Float[Array, "N T"]) -> Float[Array, " N"]:
    """mean_t over the unmasked steps of each trajectory."""
    return (x * mask).sum(axis=-1) / jnp.maximum(mask.sum(axis=-1), 1.0)


def trajectory_logit(scores: Scores, reduction: str) -> Float[Array, " N"]:
    """log exp(f(τ)) / π(τ) = f(τ) − log π(τ), f(τ) = Σ_t f; P(s'|s, a) cancels against the model's (Eq. 7 after Eq. 9)."""
    logit = (scores.f - scores.log_pi) * scores.mask
    return logit.sum(axis=-1) if reduction == "sum" else mean_over_steps(logit, scores.mask)


def judge(method: Method, config: TrainConfig, expert: Scores, sampled: Scores) -> tuple[Array, Array]:
    """Logits [N, K] of "expert is high" for both sets; K is 1 for a judge of trajectories, T for a judge of steps.

    centred: h − b with h = f − β log π and b = ½ (mean_E h + mean_S h), no gradient through b.
    """
    if method.judge == "trajectory":
        reduction = config.adversary.trajectory_logit
        return trajectory_logit(expert, reduction)[:, None], trajectory_logit(sampled, reduction)[:, None]
    if method.judge == "feasibility":
        return expert.step_logit, sampled.step_logit
    temperature = config.temperature if method.judge == "centred" else 1.0
    expert_logit, sampled_logit = (one.f - temperature * one.log_pi for one in (expert, sampled))
    if method.judge == "centred":
        expert_mean = mean_over_steps(expert_logit, expert.mask).mean()
        sampled_mean = mean_over_steps(sampled_logit, sampled.mask).mean()
        centre = jax.lax.stop_gradient(0.5 * (expert_mean + sampled_mean))
        return expert_logit - centre, sampled_logit - centre
    return expert_logit, sampled_logit


def verdict(logit: Float[Array, "N K"], mask: Float[Array, "N T"]) -> Float[Array, " N"]:
    """One number a trajectory, of logits or losses: the mean over its steps. D(τ) > ½ where that of the logits is positive."""
    return logit[:, 0] if logit.shape[-1] == 1 else mean_over_steps(logit, mask)


def discriminator(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """Eq. 8 (Eq. 3 for a judge of steps): −E_E[log D] − E_S[log(1 − D)], whose gradient in θ is Eq. 11."""
    expert_logit, sampled_logit = judge(method, config, scores.expert, scores.sampled)
    expert_loss = verdict(jax.nn.softplus(-expert_logit), scores.expert.mask)
    sampled_loss = verdict(jax.nn.softplus(sampled_logit), scores.sampled.mask)
    return expert_loss.mean() + sampled_loss.mean()


def feasibility_gradient(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """Eq. 12: −E_S[c(τ) δ̄] + E_P[δ̄] − α (Eq. 10 at λ = 1), c = π / (1 + exp(f)/π) held constant and clipped.

    In log space log c = log π + log σ(log π − f). As printed; docs/equations.md says why it collapses.
    """
    logit = trajectory_logit(scores.sampled, config.adversary.trajectory_logit)
    log_pi = (scores.sampled.log_pi * scores.sampled.mask).sum(axis=-1)
    log_coefficient = jnp.minimum(log_pi + jax.nn.log_sigmoid(-logit), jnp.log(coefficients.ratio_clip))
    coefficient = jax.lax.stop_gradient(jnp.exp(log_coefficient))
    delta_sampled = jnp.exp(log_feasibility(method, coefficients, scores.sampled))
    delta_policy = jnp.exp(log_feasibility(method, coefficients, scores.policy))
    return -(coefficient * delta_sampled).mean() + delta_policy.mean() - coefficients.cost_budget


def contrast(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """Eq. 13: −φ · E_{E ∪ S}[(f(τ) − δ̄(τ))²], since the paper maximises it: it drives f and δ̄ apart."""

    def squares(one: Scores) -> Float[Array, " N"]:
        f = (one.f * one.mask).sum(-1) if config.adversary.contrast_reward == "sum" else mean_over_steps(one.f, one.mask)
        return (f - jnp.exp(log_feasibility(method, coefficients, one))) ** 2

    both = jnp.concatenate([squares(scores.expert), squares(scores.sampled)])
    return -coefficients.contrast_coef * both.mean()


def minimal(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """Section 6's minimal-constraint term, κ · E_S|1 − δ̄(τ)|; on δ_seq alone where the per-step factor is a ratio test."""
    logs = log_sequence_feasibility if method.test == "ratio" else log_feasibility
    return coefficients.minimal_coef * (1.0 - jnp.exp(logs(method, coefficients, scores.sampled))).mean()


def step_ratio(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """Corrected, per step: E_E mean_t softplus(−z) + E_{P ∪ replay} mean_t softplus(z), so that z = log p_E/p_P."""
    expert = mean_over_steps(jax.nn.softplus(-scores.expert.step_logit), scores.expert.mask).mean()
    policy, replay = (
        mean_over_steps(jax.nn.softplus(one.step_logit), one.mask).mean() for one in (scores.policy, scores.replay)
    )
    return expert + 0.5 * (policy + replay)


def sequence_ratio(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """Corrected, per trajectory, z of the order-aware encoder: with D_S as feasible with weight m beside D_E,

    (E_E softplus(−z) + m E_S softplus(−z)) / (1 + m) + E_{P ∪ replay} softplus(z) + η E_{E ∪ S ∪ P ∪ replay} z².

    The ridge η bounds what a few demonstrations can say: without it z learns the fifty of a robot by heart.
    """
    m = coefficients.sampled_coef
    expert, sampled = (jax.nn.softplus(-one.sequence_logit).mean() for one in (scores.expert, scores.sampled))
    policy, replay = (jax.nn.softplus(one.sequence_logit).mean() for one in (scores.policy, scores.replay))
    ridge = sum((one.sequence_logit**2).mean() for one in scores) / len(scores)
    return (expert + m * sampled) / (1.0 + m) + 0.5 * (policy + replay) + coefficients.sequence_ridge * ridge


def gacl(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """GACL (Liu et al. 2022): GAIL's discriminator, whose verdict is the feasibility: −E_E[log δ] − E_P[log(1 − δ)]."""
    expert = mean_over_steps(jax.nn.softplus(-scores.expert.step_logit), scores.expert.mask).mean()
    return expert + mean_over_steps(jax.nn.softplus(scores.policy.step_logit), scores.policy.mask).mean()


def icrl(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """ICRL* (Eq. 4 without budget): −E_E[log δ] + E_P[log δ] + w (E_E[1 − δ] + E_P[1 − δ]), means over steps."""

    def mean_log_delta(one: Scores) -> tuple[Array, Array]:
        log_delta = log_step_feasibility(method, coefficients, one)
        return mean_over_steps(log_delta, one.mask).mean(), mean_over_steps(1.0 - jnp.exp(log_delta), one.mask).mean()

    (expert, expert_bound), (policy, policy_bound) = mean_log_delta(scores.expert), mean_log_delta(scores.policy)
    return -expert + policy + coefficients.icrl_coef * (expert_bound + policy_bound)


Term = Callable[[Method, TrainConfig, Coefficients, Batches], Float[Array, ""]]
TERMS: dict[str, Term] = {
    "discriminator": discriminator,
    "feasibility_gradient": feasibility_gradient,
    "contrast": contrast,
    "minimal": minimal,
    "step_ratio": step_ratio,
    "sequence_ratio": sequence_ratio,
    "gacl": gacl,
    "icrl": icrl,
}


def make_optimiser(config: TrainConfig) -> optax.GradientTransformation:
    return optax.adam(config.adversary.learning_rate)


def score_all(nets: Networks, params: Params, stats: ObsStats, batches: Batches) -> Batches:
    """Scores of the four sets, each [N, …]; their `log_prob` is log π of the present policy."""
    return Batches(*(jax.vmap(nets.scores, (None, None, 0, 0))(params, stats, one, one.log_prob) for one in batches))


def minibatch(batches: Batches, size: int, key: PRNGKeyArray) -> Batches:
    """`size` trajectories of each set, drawn without replacement; the set itself where it holds no more."""

    def some(one: Trajectory, key: PRNGKeyArray) -> Trajectory:
        number = one.mask.shape[0]
        return one if number <= size else take(one, jax.random.permutation(key, number)[:size])

    return Batches(*map(some, batches, jax.random.split(key, len(batches))))


def update(
    nets: Networks, params: Params, opt_state: Any, stats: ObsStats, batches: Batches, key: PRNGKeyArray
) -> tuple[Params, Any, Metrics]:
    """Lines 5 and 6: `num_steps` Adam steps on the sum of the method's terms, θ and φ together; ω stands still."""
    method, config = nets.method, nets.config
    if not method.terms:
        return params, opt_state, {}
    optimiser = make_optimiser(config)
    size = max(1, config.adversary.minibatch_size // nets.env.horizon)

    along = jax.vmap(nets.log_pi, (None, None, 0))
    batches = Batches(*(one._replace(log_prob=along(params, stats, one)) for one in batches))

    def loss(trainable: tuple, batches: Batches) -> tuple[Array, Metrics]:
        reward, feasibility = trainable
        scores = score_all(nets, params._replace(reward=reward, feasibility=feasibility), stats, batches)
        values = {name: TERMS[name](method, config, config.coefficients, scores) for name in method.terms}
        return sum(values.values(), jnp.zeros(())), {f"loss_{name}": value for name, value in values.items()}

    def one_step(carry: tuple, key_step: PRNGKeyArray) -> tuple[tuple, Metrics]:
        trainable, opt_state = carry
        grads, metrics = jax.grad(loss, has_aux=True)(trainable, minibatch(batches, size, key_step))
        updates, opt_state = optimiser.update(grads, opt_state)
        return (optax.apply_updates(trainable, updates), opt_state), metrics

    start = ((params.reward, params.feasibility), opt_state)
    keys = jax.random.split(key, config.adversary.num_steps)
    ((reward, feasibility), opt_state), metrics = jax.lax.scan(one_step, start, keys)
    last = {name: value[-1] for name, value in metrics.items()}
    return params._replace(reward=reward, feasibility=feasibility), opt_state, last
