"""The protocol that every world follows: one episode of one environment, pure functions, no batch axis."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray, Shaped

from envs.views import BY_NUMBER, Activities, Codes, Coordinates, Maze, View


class Step(NamedTuple):
    """What one control step returns: the next observation, the true reward and cost of this step (NaN: unknown), its end."""

    obs: Float[Array, " O"]
    reward: Float[Array, ""]
    cost: Float[Array, ""]
    terminated: Float[Array, ""]
    counts: Float[Array, ""] | float = 1.0  # 0: no step of the task, as when a practice world resets; it is masked


@dataclass(frozen=True)
class Discrete:
    """Actions 0 … n − 1, as integers of shape []."""

    n: int

    @property
    def feature_size(self) -> int:
        return self.n

    @property
    def shape(self) -> tuple[int, ...]:
        return ()

    def features(self, action: Int[Array, ""]) -> Float[Array, " A"]:
        """The action as the networks see it: one-hot."""
        return jax.nn.one_hot(action, self.n)


@dataclass(frozen=True)
class Box:
    """Actions in [low, high]^size, as floats of shape [size]; the environment clips, the trajectory keeps the draw."""

    size: int
    low: float = -1.0
    high: float = 1.0

    @property
    def feature_size(self) -> int:
        return self.size

    @property
    def shape(self) -> tuple[int, ...]:
        return (self.size,)

    def clip(self, action: Float[Array, " A"]) -> Float[Array, " A"]:
        return jnp.clip(action, self.low, self.high)

    @property
    def middle(self) -> float:
        return (self.low + self.high) / 2 if self.is_bounded else 0.0

    @property
    def half_width(self) -> float:
        return (self.high - self.low) / 2 if self.is_bounded else 1.0

    @property
    def is_bounded(self) -> bool:
        return math.isfinite(self.low) and math.isfinite(self.high)

    @property
    def is_unit(self) -> bool:
        """Whether an action is its own number of half-widths from the middle."""
        return self.middle == 0.0 and self.half_width == 1.0

    def in_half_widths(self, action: Float[Array, "*N A"]) -> Float[Array, "*N A"]:
        """The action from the middle of the box in half-widths: ±1 at the bounds."""
        return action if self.is_unit else (action - self.middle) / self.half_width

    def from_half_widths(self, action: Float[Array, "*N A"]) -> Float[Array, "*N A"]:
        """The action of so many half-widths from the middle of the box."""
        return action if self.is_unit else self.middle + self.half_width * action

    def features(self, action: Float[Array, " A"]) -> Float[Array, " A"]:
        """The action as the networks see it: clipped as the environment clips it, so that clipping gives nothing away."""
        return self.in_half_widths(self.clip(action))


class Tabular(NamedTuple):
    """A finite world in full: what exact planning needs. X are its states (Markov, so perhaps more than the cells seen)."""

    transition: Float[Array, "X A X"]  # P(x'|x, a)
    reward: Float[Array, "X A"]  # E[r | x, a], NaN where unknown
    cost: Float[Array, " X"]  # cost of a step taken in x, NaN where unknown
    forbidden: Float[Array, " X"]  # 1 where an expert may not enter
    start: Float[Array, " X"]  # distribution of x_0
    obs: Float[Array, "X O"]  # what is seen in x
    goal: Float[Array, " X"]  # 1 where the episode has succeeded (all 0 in a world without a goal)


class SoftOptimalExpert(NamedTuple):
    """The exact expert of a finite world: a soft-optimal policy that never enters what is forbidden, but where it lapses."""

    table: Tabular
    temperature: float
    lapse: float = 0.0  # share of its actions that are uniformly random


class Recorded(NamedTuple):
    """Demonstrations that come with a world's data: obs [N, T, O], action, mask, reward and cost (NaN: unknown), by name."""

    demonstrations: Callable[[], dict[str, Any]]
    reference: Callable[[], dict[str, Any]] | None  # None: nothing is known by which to score a feasibility
    simulated: bool = False  # stands in for recordings of animals
    account: tuple[str, ...] = ()  # what was read, and what was left out of it and why
    warnings: tuple[str, ...] = ()  # what to know of the data before anything learns from them
    groups: Callable[[], Any] | None = None  # number of the recording of each demonstration, [N]; None: not told


class Shipped(NamedTuple):
    """Demonstrations in envs/demonstrations: NAME.npz, and NAME_reference.npz to score by."""

    name: str


Expert = SoftOptimalExpert | Recorded | Shipped


class Limit(NamedTuple):
    """The line that a constraint draws. Figures read it; nothing that learns does."""

    name: str  # of the constraint
    value: float
    bounds: int | Literal["actions"] | None  # a coordinate of the observation, every |action|, or nothing that is seen
    both_sides: bool = False  # across a coordinate too, at ±value

    @property
    def lines(self) -> tuple[float, ...]:
        """Where to draw it: at ±value across actions and where it has both sides, else at the value."""
        return (-self.value, self.value) if self.both_sides or self.bounds == "actions" else (self.value,)


def _identity(obs: Float[Array, " O"]) -> Float[Array, " R"]:
    return obs


@dataclass(frozen=True, eq=False)
class Env:
    """One world. `reset(key) -> (state, obs)`; `step(key, state, action) -> (state, Step)`; both pure, for one episode."""

    name: str
    horizon: int
    obs_size: int
    action_space: Discrete | Box
    reset: Callable[[PRNGKeyArray], tuple[Any, Float[Array, " O"]]]
    step: Callable[[PRNGKeyArray, Any, Shaped[Array, "*A"]], tuple[Any, Step]]
    finite_horizon: bool = False  # the task ends at the horizon: the policy sees t/T and nothing is worth anything after it
    reward_view: Callable[[Float[Array, " O"]], Float[Array, " R"]] = _identity  # the smooth coordinates that f may see
    reward_view_size: int = 0  # R; 0 stands for obs_size
    position: Callable[[Float[Array, " O"]], Float[Array, " P"]] | None = None  # where one is, of which a potential is linear
    restore: Callable[[Float[Array, " O"]], Any] | None = None  # the state that shows this observation, where one alone does
    constraint_input: Literal["state", "action", "state_action"] = "state"  # what a constraint of this kind of task speaks of
    has_reward: bool = True  # False for animals: there is no true reward to read, and `step` gives NaN
    success_return: float | Float[Array, ""] | None = None  # an episode has reached the goal iff its return reaches this
    tabular: Tabular | None = None  # the world as tables, where it is finite
    expert_temperature: float = 1.0  # of the exact soft-optimal expert, where the world is finite
    expert_lapse: float = 0.0  # share of that expert's actions that are uniformly random
    recorded: Recorded | None = None  # demonstrations of the world's own data, where it has some
    shipped_demonstrations: str | None = None  # name of the shipped D_E and its reference set, where experts are trained
    view: View = BY_NUMBER  # how to draw the world, and what its observations and actions are called
    limit: Limit | None = None  # the line that its constraint draws, where there is one
    fallen: Callable[[Any], Bool[Array, ""]] | None = None  # of a state: whether its body has fallen, where it can fall
    registered: bool = False  # made by the registry, so that its settings are found by its name
    task: str = ""  # of a world of another library, which its name alone does not say

    @property
    def expert(self) -> Expert | None:
        """Where demonstrations come from: the world's own recordings, else its exact expert, else a shipped file."""
        if self.recorded is not None:
            return self.recorded
        if self.tabular is not None:
            return SoftOptimalExpert(self.tabular, self.expert_temperature, self.expert_lapse)
        return None if self.shipped_demonstrations is None else Shipped(self.shipped_demonstrations)

    @property
    def simulated(self) -> bool:
        """Whether the demonstrations stand in for recordings of animals."""
        return self.recorded is not None and self.recorded.simulated

    @property
    def title(self) -> str:
        """What reports and figures call the world."""
        named = f"{self.name} {self.task}" if self.task else self.name
        return f"{named} (simulated)" if self.simulated else named

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """What figures call the coordinates of an observation."""
        named = self.view.names if isinstance(self.view, Coordinates) else ()
        named = self.view.coordinates if isinstance(self.view, Activities) else named
        return named or tuple(f"coordinate {index}" for index in range(self.obs_size))

    @property
    def motor_names(self) -> tuple[str, ...]:
        """What figures call the components of a Box's action."""
        named = self.view.motors if isinstance(self.view, Coordinates) else ()
        return named or tuple(f"action {index}" for index in range(self.action_space.feature_size))

    @property
    def enumerated(self) -> bool:
        """Whether observations are one-hot of few codes or nodes, so that a function of a step is a small table."""
        return isinstance(self.view, Codes | Maze) and not self.finite_horizon
