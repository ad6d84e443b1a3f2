"""Frozen settings of a training run and their defaults per environment (the paper's Table 2, and ours)."""

from dataclasses import dataclass, field, replace
from typing import Literal

import jax
from jaxtyping import Array, Float

Scalar = float | Float[Array, ""]  # an array where it is traced


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Coefficients:
    """The scalars that weigh or shape the loss terms. A pytree: they may be traced, so that a sweep over them is a `vmap`."""

    contrast_coef: Scalar = 0.001  # φ of Eq. 13; Table 2
    minimal_coef: Scalar = 0.001  # κ of the minimal-constraint term, Section 6; Table 2
    cost_budget: Scalar = 0.0  # α of Eq. 10; a constant, so it moves the objective and no gradient
    ratio_clip: Scalar = 1.0  # upper bound of Eq. 12's coefficient π(τ)(1 − D), which is a density and may be e^88
    sampled_coef: Scalar = 0.25  # m: weight of D_S beside D_E as feasible, in the corrected trajectory-level term
    sharpness: Scalar = 6.0  # k of the corrected test
    threshold: Scalar = 0.4  # ϑ of the corrected test: the density ratio below which a step or a trajectory is infeasible
    false_alarms: Scalar = 0.05  # α: share of D_E that each test may reject; ϑ is lowered until it holds
    sequence_ridge: Scalar = 0.0  # η: weight of z² of the corrected trajectory-level term
    icrl_coef: Scalar = 0.6  # weight of ICRL's regulariser E(1 − ζ); the published baseline's value


@dataclass(frozen=True)
class PPOConfig:
    learning_rate: Scalar = 5e-4  # Adam; Table 2
    clip_eps: float = 0.1  # Table 2
    num_epochs: int = 4
    minibatch_size: int = 700  # transitions, rounded to whole trajectories; Table 2's "batch size"
    discount: float = 0.99
    gae_lambda: float = 0.95
    value_coef: float = 0.5
    max_grad_norm: float = 0.5
    log_std_init: float = -0.7
    log_std_min: float = -3.0  # log σ is a parameter, projected into these bounds after each update
    log_std_max: float = 0.0


@dataclass(frozen=True)
class AdversaryConfig:
    learning_rate: Scalar = 5e-4  # Adam; Table 2
    num_steps: int = 4  # gradient steps on the reward and the feasibility per iteration
    minibatch_size: int = 2500  # transitions of each set in a step, rounded to whole trajectories; all where there are fewer
    replay_rate: float = 0.02  # probability per iteration that a replay slot is overwritten
    sampler: Literal["resample", "reject"] = "resample"  # how D_S is drawn from D_P by δ̄
    trajectory_logit: Literal["sum", "mean"] = "sum"  # the literal rows' f(τ) and log π(τ) inside D; the paper's is the sum
    contrast_reward: Literal["sum", "mean"] = "sum"  # f(τ) in Eq. 13; the paper's is the sum


@dataclass(frozen=True)
class TrainConfig:
    iterations: int = 250
    num_trajectories: int = 70  # N: trajectories of D_P a round; Table 2's "sampled trajectory"
    num_demonstrations: int = 70  # trajectories of D_E where the expert is sampled; Table 2's "expert trajectory"
    pool: int = 1  # the rows that draw D_S from a pool collect pool × N trajectories a round
    hidden: tuple[int, ...] = (32, 32)  # every network; Table 2
    step_network: Literal["joint", "additive"] = "joint"  # δ₁'s logit: of all coordinates, or a sum of one network for each
    additive_hidden: tuple[int, ...] = (16, 16)  # of each coordinate's network
    encoder: Literal["attention", "gru"] = "attention"  # of the trajectory-level feasibility: how it sees order
    reward_input: Literal["view", "obs"] = "view"  # f on the environment's smooth coordinates or on the whole observation
    reward_bound: float = 0.0  # B of f = B tanh(net / B), where an unbounded f runs away; 0: none
    constraint_input: Literal["env", "state", "action", "state_action"] = "env"  # of δ̄; env: as the environment says
    warm_start: int = 0  # epochs of cloning D_E before the first iteration; the replay begins with the untrained policy
    warm_minibatch_size: int = 2500  # transitions of the cloning's minibatches, rounded to whole trajectories
    waiting: int = 0  # iterations in which π and V stand still, so that f and δ̄ learn to judge a clone before it moves
    annealing: int = 0  # iterations in which both learning rates fall linearly to 0, where the play would not settle; 0: never
    temperature: float = 1.0  # β of the entropy, where the true reward is known or the judge is centred; the paper's f takes 1
    num_evaluation: int = 500  # fresh episodes at each evaluation
    chunk: int = 25  # iterations between two checkpoints, log flushes and evaluations
    ppo: PPOConfig = field(default_factory=PPOConfig)
    adversary: AdversaryConfig = field(default_factory=AdversaryConfig)
    coefficients: Coefficients = field(default_factory=Coefficients)


_GRID = TrainConfig(num_trajectories=70, num_demonstrations=70, ppo=PPOConfig(discount=1.0, minibatch_size=700))
_ROBOT = TrainConfig(
    iterations=100,
    num_trajectories=50,
    num_demonstrations=50,
    num_evaluation=50,
    chunk=10,
    ppo=PPOConfig(num_epochs=10, minibatch_size=2500),
)
_PENDULUM = replace(
    _ROBOT, iterations=200, ppo=replace(_ROBOT.ppo, minibatch_size=1000), adversary=AdversaryConfig(minibatch_size=1000)
)
_ANIMALS = TrainConfig(
    iterations=200,
    num_trajectories=250,  # of Table 2's 2182 a round, which take nine times as long
    ppo=PPOConfig(minibatch_size=500, discount=0.5),
    adversary=AdversaryConfig(num_steps=20, minibatch_size=500),
)

# The paper's Table 2: what its own rows run with.
PAPER: dict[str, TrainConfig] = {
    "gridworld": _GRID,
    "nonmarkov": _GRID,
    "swimmer": _ROBOT,
    "walker": _ROBOT,
    "pendulum": _PENDULUM,
    "meerkat": _ANIMALS,
    "labyrinth": _ANIMALS,
}

_TUNED_GRID = replace(
    _GRID,
    pool=4,
    ppo=replace(_GRID.ppo, num_epochs=2, learning_rate=1e-3, clip_eps=0.2),
    adversary=AdversaryConfig(learning_rate=1e-3),
    coefficients=Coefficients(sampled_coef=0.5, threshold=0.3),
)
# Only δ_seq can see the constraint there, so the adversary is given more steps for each of the policy's.
_TUNED_NONMARKOV = replace(
    _TUNED_GRID,
    ppo=replace(_TUNED_GRID.ppo, learning_rate=5e-4),
    adversary=replace(_TUNED_GRID.adversary, num_steps=8),
    coefficients=Coefficients(sampled_coef=0.4),
)
# They begin as the clone, which waits until f and δ̄ can judge it, and both rates fall to 0: else rare codes never settle. The
# replay keeps windows of random codes, beside which what is rarely done stands far above what is never done; ϑ lies between.
_TUNED_ANIMALS = replace(
    _ANIMALS,
    warm_start=100,
    waiting=30,
    annealing=200,
    ppo=replace(_ANIMALS.ppo, learning_rate=4e-4, clip_eps=0.2, minibatch_size=2500),
    adversary=replace(_ANIMALS.adversary, num_steps=8, learning_rate=3e-3, minibatch_size=2500, replay_rate=0.0),
    coefficients=Coefficients(threshold=0.03, sharpness=3.0),
)


def _tuned_robot(row: TrainConfig) -> TrainConfig:
    return replace(
        row,
        step_network="additive",
        coefficients=Coefficients(sequence_ridge=0.2),
        ppo=replace(row.ppo, num_epochs=4, learning_rate=1e-3, clip_eps=0.2, log_std_init=-1.2),
        adversary=replace(row.adversary, num_steps=8, learning_rate=2e-3),
    )


# From scratch 100 iterations are too few to walk (returns of 400 of 1241): it begins as the clone of its demonstrations and is
# moved slowly; a closer clone leaves δ̄ too few negatives (docs/equations.md). Six narrow actions make log π too sharp for f to
# follow at β = 1: the judge fell behind, σ rose, and f ran away.
# The clone shows what demonstrations do and hardly anything else, so that no policy of the run says where the torques' limit
# is. The replay does: it keeps the episodes of a policy that knows nothing and whose σ is the whole box, and the feasibility
# sees actions alone, for such episodes fall, which no demonstration does and no constraint forbids.
_WALKER = _tuned_robot(_ROBOT)
_TUNED_WALKER = replace(
    _WALKER,
    warm_start=40,
    warm_minibatch_size=1000,
    temperature=0.1,
    reward_bound=20.0,
    constraint_input="action",
    coefficients=Coefficients(sequence_ridge=1.0),
    ppo=replace(_WALKER.ppo, learning_rate=3e-4, log_std_init=0.0),
    adversary=replace(_WALKER.adversary, num_steps=20, learning_rate=4e-3, replay_rate=0.0),
)

# What the centred and corrected rows run with.
TUNED: dict[str, TrainConfig] = {
    "gridworld": _TUNED_GRID,
    "nonmarkov": _TUNED_NONMARKOV,
    "swimmer": _tuned_robot(_ROBOT),
    "walker": _TUNED_WALKER,
    "pendulum": _tuned_robot(_PENDULUM),
    "meerkat": _TUNED_ANIMALS,
    "labyrinth": _TUNED_ANIMALS,
}


def default_config(env_name: str, settings: Literal["paper", "tuned"]) -> TrainConfig:
    """The settings of an environment for the paper's rows or for ours; those of TrainConfig where it is not in the table."""
    return {"paper": PAPER, "tuned": TUNED}[settings].get(env_name, TrainConfig())
