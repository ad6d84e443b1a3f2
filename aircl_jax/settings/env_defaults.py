"""Default settings by environment: the paper's Table 2 for its own rows, and ours."""

from dataclasses import asdict, replace
from typing import Any, Literal

from aircl_jax.settings.learner_config import LearnerConfig
from aircl_jax.settings.train_config import AdversaryConfig, Coefficients, PPOConfig, TrainConfig
from envs import ENVS, Box, Env
from envs.settings import flatten

Settings = Literal["paper", "tuned", "contrast", "practice", "likelihood"]

_GRID = TrainConfig(num_trajectories=70, num_demonstrations=70, ppo=PPOConfig(discount=1.0, minibatch_size=700))


_ROBOT = TrainConfig(
    iterations=100,
    num_trajectories=50,
    num_demonstrations=50,
    num_evaluation=50,
    checkpoint_every=10,
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


# Worlds of other libraries have the shipped robots' settings, which nobody has tuned for them.
GUESTS = ("brax", "playground", "gymnasium")


# The paper's Table 2: what its own rows run with.
PAPER: dict[str, TrainConfig] = {
    "gridworld": _GRID,
    "nonmarkov": _GRID,
    "swimmer": _ROBOT,
    "walker": _ROBOT,
    "halfcheetah": _ROBOT,
    "hopper": _ROBOT,
    "pendulum": _PENDULUM,
    "meerkat": _ANIMALS,
    "labyrinth": _ANIMALS,
    **dict.fromkeys(GUESTS, _ROBOT),
}


_TUNED_GRID = replace(
    _GRID,
    pool_factor=4,
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
    clone_epochs=100,
    policy_delay=30,
    lr_decay_iterations=200,
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
# follow at β = 1: the discriminator fell behind, σ rose, and f ran away.
# The clone shows what demonstrations do and hardly anything else, so that no policy of the run says where the torques' limit
# is. The replay does: it keeps the episodes of a policy that knows nothing and whose σ is the whole box, and the feasibility
# sees actions alone, for such episodes fall, which no demonstration does and no constraint forbids.
_WALKER = _tuned_robot(_ROBOT)


_TUNED_WALKER = replace(
    _WALKER,
    clone_epochs=40,
    clone_minibatch_size=1000,
    temperature=0.1,
    reward_bound=20.0,
    constraint_input="action",
    coefficients=Coefficients(sequence_ridge=1.0),
    ppo=replace(_WALKER.ppo, learning_rate=3e-4, log_std_init=0.0),
    adversary=replace(_WALKER.adversary, num_steps=20, learning_rate=4e-3, replay_rate=0.0),
)


# f is slower than π, which follows it, and both rates fall to 0. δ₁ and h wait for a fifth of the run: what is not done is
# first explained by what is wanted, and that by places. ϑ lies below e^−1.5: a step into mud is rare too.
_CONTRAST_GRID = replace(
    _GRID,
    iterations=300,
    num_trajectories=140,
    feasibility_delay=60,
    lr_decay_iterations=315,
    ppo=replace(_GRID.ppo, learning_rate=2e-3, clip_eps=0.2),
    adversary=AdversaryConfig(learning_rate=5e-3, potential_rate=0.2),
    coefficients=Coefficients(threshold=0.15),
)


# The learner of docs/learner.md; π's rate would be 0 a few iterations after the last one.
_CONTRAST_BOX = replace(
    _ROBOT,
    checkpoint_every=30,
    ppo=LearnerConfig().ppo,
    coefficients=Coefficients(threshold=0.05, pseudo_count=0.5),
)
STEPS = 8_000  # of π in an iteration


def contrast_of_box(horizon: int, actions: int) -> TrainConfig:
    """The one configuration of the contrast row for a box of this many actions: more of them are learned for longer."""
    iterations = 300 + 50 * max(0, actions - 2)
    return replace(
        _CONTRAST_BOX,
        iterations=iterations,
        num_trajectories=max(1, -(-STEPS // horizon)),
        feasibility_delay=2 * iterations // 5,
        lr_decay_iterations=21 * iterations // 20,
    )


# Horizon and number of actions where no other are given; a world of another library may have others.
BOXES = {
    "swimmer": (500, 2),
    "walker": (500, 6),
    "halfcheetah": (500, 6),
    "hopper": (500, 3),
    "pendulum": (100, 1),
    **dict.fromkeys(GUESTS, (500, 2)),
    "gymnasium": (200, 1),
}


# What the contrast rows run with: between robots horizon and number of actions are all that differs. On the non-Markov grid
# the feasibility is the corrected row's.
CONTRAST: dict[str, TrainConfig] = {
    "gridworld": _CONTRAST_GRID,
    "nonmarkov": _TUNED_NONMARKOV,
    **{name: contrast_of_box(*shape) for name, shape in BOXES.items()},
}


def practice_of_box(horizon: int, actions: int) -> TrainConfig:
    """What the baselines with the contrast row's learner run with, in any world of a box."""
    shared = contrast_of_box(horizon, actions)
    return replace(
        shared,
        feasibility_delay=0,
        step_network="additive",
        temperature=0.1,
        adversary=AdversaryConfig(num_steps=16, learning_rate=4e-3),
    )


PRACTICE = {name: practice_of_box(*shape) for name, shape in BOXES.items()}


# What is fitted by likelihood runs with, in any world: one fit.
LIKELIHOOD = TrainConfig(iterations=1, checkpoint_every=1)


# What the centred and corrected rows run with. Half-cheetah and hopper have the walker's settings: none was chosen on them.
TUNED: dict[str, TrainConfig] = {
    "gridworld": _TUNED_GRID,
    "nonmarkov": _TUNED_NONMARKOV,
    "swimmer": _tuned_robot(_ROBOT),
    "walker": _TUNED_WALKER,
    "halfcheetah": _TUNED_WALKER,
    "hopper": _TUNED_WALKER,
    "pendulum": _tuned_robot(_PENDULUM),
    "meerkat": _TUNED_ANIMALS,
    "labyrinth": _TUNED_ANIMALS,
    **dict.fromkeys(GUESTS, _tuned_robot(_ROBOT)),
}


def corrected_of_box(horizon: int) -> TrainConfig:
    """What the centred and corrected rows run with in a world of one's own whose actions are of a box.

    π gets ten minibatches of whole episodes (of 50 rollouts) however short these are, and β is small: with fewer updates, or
    at β = 1, its σ stays far wider than that of demonstrations that are hardly random (docs/research.md).
    """
    row = _tuned_robot(_ROBOT)
    return replace(
        row,
        iterations=150,
        num_evaluation=100,
        checkpoint_every=25,
        step_network="joint",
        temperature=0.1,
        ppo=replace(row.ppo, num_epochs=10, minibatch_size=max(1, row.num_trajectories // 10) * horizon),
    )


# The row that a world runs with where none is named; any other world runs with CORRECTED.
DEFAULT_METHODS: dict[str, str] = dict.fromkeys(("gridworld", "swimmer", "walker", "halfcheetah"), "aircl_contrast")
CORRECTED = "aircl_corrected"


def default_method(env_name: str) -> str:
    """Return the row that an environment runs with where none is named."""
    return DEFAULT_METHODS.get(env_name, CORRECTED)


def has_own_settings(env: Env) -> bool:
    """Whether an environment of the registry has settings that were chosen for it."""
    return env.registered and env.name in PAPER and env.name in TUNED and env.name not in GUESTS


def default_config(env_name: str, settings: Settings) -> TrainConfig:
    """The settings of an environment for the paper's rows or for ours; those of TrainConfig where it is not in the table."""
    if settings == "likelihood":
        return LIKELIHOOD
    tables = {"paper": PAPER, "tuned": TUNED, "contrast": CONTRAST, "practice": PRACTICE}
    return tables[settings].get(env_name, TrainConfig())


def config_of(env: Env, settings: Settings) -> TrainConfig:
    """The settings of an environment; an Env of one's own takes none by its name."""
    if env.registered or settings == "likelihood":
        return default_config(env.name, settings)
    if settings == "paper" or not isinstance(env.action_space, Box):
        return TrainConfig()
    if settings == "tuned":
        return corrected_of_box(env.horizon)
    of_boxes = {"contrast": contrast_of_box, "practice": practice_of_box}
    return of_boxes[settings](env.horizon, env.action_space.feature_size)


def unnamed_settings(env_name: str) -> dict[str, Any]:
    """What a run did where its settings do not name one, being older than it: {"env.…", "train.…": default}."""
    options = {"env": asdict(ENVS[env_name].options().resolved())} if env_name in ENVS else {}
    return flatten({**options, "train": asdict(TrainConfig())})
