"""Score sets of trajectories by δ̄, calibrate its thresholds on the demonstrations, and draw D_S by it."""

from typing import Any, NamedTuple

import jax
from jaxtyping import Array, Float, Int, PRNGKeyArray

from aircl_jax.algorithm.pooling import ALONE, Pool
from aircl_jax.algorithm.rollout import rollouts
from aircl_jax.algorithm.sampler import SAMPLERS, take
from aircl_jax.model.feasibility import calibrate, log_feasibility
from aircl_jax.model.networks import BoundNetworks
from aircl_jax.types import Params, Trajectory


class Drawn(NamedTuple):
    """Trajectories of π with their log δ̄, and the indices of the draws of q among them (Eq. 9)."""

    policy: Trajectory  # [P, T, …]
    log_delta: Float[Array, " P"]
    chosen: Int[Array, " N"] | None  # None where q is π: every trajectory, in order

    @property
    def sampled(self) -> Trajectory:
        """Return D_S, [N, T, …]."""
        return self.draws_of(self.policy)

    def draws_of(self, tree: Any) -> Any:
        """Take the draws' rows, [N, …], of a tree with a row for each of the policy's trajectories, [P, …]."""
        return tree if self.chosen is None else take(tree, self.chosen)


def roll_out_and_draw(
    nets: BoundNetworks, key_rollout: PRNGKeyArray, key_sampler: PRNGKeyArray, pool: int, number: int
) -> Drawn:
    """Roll out `pool` episodes of π, score them, and draw `number` of them in proportion to δ̄ (Algorithm 1, lines 3 and 4)."""
    policy = rollouts(nets, key_rollout, pool)
    log_delta = trajectory_feasibility(nets, policy)
    if not nets.method.draws:
        return Drawn(policy, log_delta, None)
    return Drawn(policy, log_delta, SAMPLERS[nets.config.adversary.sampler](log_delta, number, key_sampler))


def trajectory_feasibility(nets: BoundNetworks, trajectories: Trajectory) -> Float[Array, " N"]:
    """Compute log δ̄(τ) of each trajectory."""
    scores = jax.vmap(nets.feasibility_scores)(trajectories)
    return log_feasibility(nets.method, nets.config.coefficients, scores)


def calibrated(nets: BoundNetworks, expert: Trajectory, pool: Pool = ALONE) -> tuple[Params, Float[Array, " N"]]:
    """Set the thresholds of δ̄ by D_E, the lowest that a task asks for; return the parameters, and log δ̄ of D_E under them."""
    method, coefficients, params = nets.method, nets.config.coefficients, nets.params
    scores = jax.vmap(nets.feasibility_scores)(expert)
    if method.is_ratio_test:
        params = params._replace(thresholds=pool.least(calibrate(coefficients, scores)))
        scores = scores._replace(thresholds=params.thresholds)
    return params, log_feasibility(method, coefficients, scores)
