"""Define the loss terms of the baselines that know the true reward: GACL and ICRL."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from aircl_jax.algorithm.masks import mean_over_steps
from aircl_jax.algorithm.terms.logits import Batches
from aircl_jax.methods import Method
from aircl_jax.model.feasibility import log_step_feasibility
from aircl_jax.settings.train_config import Coefficients, TrainConfig
from aircl_jax.types import Scores


def gacl(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """GACL (Liu et al. 2022): GAIL's discriminator as the feasibility: −E_E[log δ] − E_P[log(1 − δ)]."""
    expert = mean_over_steps(jax.nn.softplus(-scores.expert.step_logit), scores.expert.mask).mean()
    return expert + mean_over_steps(jax.nn.softplus(scores.policy.step_logit), scores.policy.mask).mean()


def icrl(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """ICRL* (Eq. 4 without budget): −E_E[log δ] + E_P[log δ] + w (E_E[1 − δ] + E_P[1 − δ]), means over steps."""

    def mean_log_delta(batch: Scores) -> tuple[Array, Array]:
        log_delta = log_step_feasibility(method, coefficients, batch)
        return mean_over_steps(log_delta, batch.mask).mean(), mean_over_steps(1.0 - jnp.exp(log_delta), batch.mask).mean()

    (expert, expert_bound), (policy, policy_bound) = mean_log_delta(scores.expert), mean_log_delta(scores.policy)
    return -expert + policy + coefficients.icrl_coef * (expert_bound + policy_bound)
