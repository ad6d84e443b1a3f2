"""δ̄ of whole sets of trajectories, and its thresholds from the demonstrations."""

import jax
from jaxtyping import Array, Float

from aircl_jax.model.feasibility import calibrate, log_feasibility
from aircl_jax.model.networks import Networks
from aircl_jax.types import ObsStats, Params, Trajectory


def trajectory_feasibility(nets: Networks, params: Params, stats: ObsStats, policy: Trajectory) -> Float[Array, " N"]:
    """log δ̄(τ) of each trajectory."""
    scores = jax.vmap(nets.scores, (None, None, 0, 0))(params, stats, policy, policy.log_prob)
    return log_feasibility(nets.method, nets.config.coefficients, scores)


def calibrated(nets: Networks, params: Params, stats: ObsStats, expert: Trajectory) -> tuple[Params, Float[Array, " N"]]:
    """The parameters with the thresholds of δ̄ that D_E asks for, and log δ̄ of D_E under these."""
    method, coefficients = nets.method, nets.config.coefficients
    scores = jax.vmap(nets.scores, (None, None, 0, 0))(params, stats, expert, expert.log_prob)
    if method.test != "sigmoid":
        params = params._replace(thresholds=calibrate(coefficients, scores))
        scores = scores._replace(thresholds=params.thresholds)
    return params, log_feasibility(method, coefficients, scores)
