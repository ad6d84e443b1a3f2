"""Frozen settings of a training run and their defaults per environment (the paper's Table 2, and ours)."""

from dataclasses import dataclass, field
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
    ratio_clip: Scalar = 1.0  # upper bound of Eq. 12's coefficient π(τ)(1 − D), which is a density and may be e^88
    sampled_coef: Scalar = 0.25  # m: weight of D_S beside D_E as feasible, in the corrected trajectory-level term
    sharpness: Scalar = 6.0  # k of the corrected test
    threshold: Scalar = 0.4  # ϑ of the corrected test: the density ratio below which a step or a trajectory is infeasible
    false_alarms: Scalar = 0.05  # α: share of D_E that each test may reject; ϑ is lowered until it holds
    sequence_ridge: Scalar = 0.0  # η: weight of z² of the corrected trajectory-level term
    reward_scatter: Scalar = 0.7  # σ of g(s) about its mean, in units of β: the prior of a reward of states
    potential_scatter: Scalar = 0.1  # σ_h of the slopes of h, likewise, a coordinate's step: of a prior with heavy tails
    pseudo_count: Scalar = 0.25  # ε: added to what was made and to what is expected, in the tests of entries and of actions
    least_expected: Scalar = 200.0  # M: actions that must have been expected beyond a limit of the test of actions
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
    log_std_max: Scalar = 0.0


@dataclass(frozen=True)
class AdversaryConfig:
    learning_rate: Scalar = 5e-4  # Adam; Table 2
    potential_rate: Scalar = 0.03  # of plain gradient descent on the potential's slopes, in rows with a reward of states
    num_steps: int = 4  # gradient steps on the reward and the feasibility per iteration
    minibatch_size: int = 2500  # transitions of each set in a step, rounded to whole trajectories; all where there are fewer
    replay_rate: float = 0.02  # probability per iteration that a replay slot is overwritten
    sampler: Literal["resample", "reject"] = "resample"  # how D_S is drawn from D_P by δ̄
    trajectory_logit: Literal["sum", "mean"] = "sum"  # the literal rows' f(τ) and log π(τ) inside D; the paper's is the sum
    contrast_reward: Literal["sum", "mean"] = "sum"  # f(τ) in Eq. 13; the paper's is the sum


@dataclass(frozen=True)
class MomentConfig:
    """The reward of a world without a table: θ by the gap of the feature means, E_E φ − E_π φ."""

    rate: Scalar = 0.05  # α of plain gradient descent
    sparsity: Scalar = 0.2  # λ of the soft threshold of each feature
    norm: Scalar = 0.5  # B: greatest ‖θ‖, and its only one from `sphere` on
    sphere: int = 40  # iterations
    selection: Scalar = 0.2  # of ‖θ‖₁ where features are chosen, as a share of the least that leaves none
    margin: Scalar = 1.0  # how far beyond the demonstrations' range π may stray, in its widths, before it starts anew
    stray_cost: Scalar = 250.0  # what that costs, in standard deviations of f
    stray_cost_later: Scalar = 1000.0  # the same once f is chosen: by velocity alone a fall forward may pay
    multiplier_init: Scalar = 0.3  # λ when the constraint begins
    multiplier_rate: Scalar = 0.03  # of log λ an iteration; the greatest and d are the learner's
    near: Scalar = 0.175  # root mean square of the gap under which the means have nearly met: constraint and twin begin
    far: Scalar = 1.0  # the same above which π, paid by the chosen f, is far from the demonstrations
    patience: int = 25  # iterations in a row of that after which f is chosen anew


@dataclass(frozen=True)
class TrainConfig:
    iterations: int = 250
    num_trajectories: int = 70  # N: trajectories of D_P a round; Table 2's "sampled trajectory"
    num_demonstrations: int = 70  # trajectories of D_E where the expert is sampled; Table 2's "expert trajectory"
    pool_factor: int = 1  # the rows that draw D_S from a pool collect pool_factor × N trajectories a round
    learner: Literal["ppo", "exact"] = "ppo"  # of the policy; exact: planned, where the world is a table whose states are seen
    hidden: tuple[int, ...] = (32, 32)  # every network; Table 2
    step_network: Literal["joint", "additive"] = "joint"  # δ₁'s logit: of all coordinates, or a sum of one network for each
    additive_hidden: tuple[int, ...] = (16, 16)  # of each coordinate's network
    encoder: Literal["attention", "gru"] = "attention"  # of the trajectory-level feasibility: how it sees order
    reward_input: Literal["view", "obs"] = "view"  # f on the environment's smooth coordinates or on the whole observation
    reward_bound: float = 0.0  # B of f = B tanh(net / B), where an unbounded f runs away; 0: none
    constraint_input: Literal["env", "state", "action", "state_action"] = "env"  # of δ̄; env: as the environment says
    clone_epochs: int = 0  # epochs of cloning D_E before the first iteration; the replay begins with the untrained policy
    clone_minibatch_size: int = 2500  # transitions of the cloning's minibatches, rounded to whole trajectories
    clone_learning_rate: float = 3e-3  # Adam's, of the cloning
    policy_delay: int = 0  # iterations in which π and V stand still, so that f and δ̄ learn of a clone before it moves
    feasibility_delay: int = 0  # iterations before δ₁ of entries is paid and h moves, so that g says first what it can
    lr_decay_iterations: int = 0  # iterations in which both learning rates fall linearly to 0; 0: they never do
    temperature: float = 1.0  # β of the entropy, where the reward is known or D is centred; the paper's f takes 1
    num_evaluation: int = 500  # fresh episodes at each evaluation
    checkpoint_every: int = 25  # iterations between two checkpoints, log flushes and evaluations
    ppo: PPOConfig = field(default_factory=PPOConfig)
    adversary: AdversaryConfig = field(default_factory=AdversaryConfig)
    moments: MomentConfig = field(default_factory=MomentConfig)
    coefficients: Coefficients = field(default_factory=Coefficients)
