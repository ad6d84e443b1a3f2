"""The table of methods: each row states what is learned, what tells expert from policy and which equations make up its loss."""

from dataclasses import dataclass, replace
from typing import Literal


@dataclass(frozen=True)
class Method:
    """One row. The fused train step is the same for all; a row chooses its terms (names in `algorithm.terms.table.TERMS`)."""

    reward: Literal["learned", "true"]  # what the policy is driven by: f_θ, or the environment's own reward
    discriminator_of: Literal["trajectory", "step", "feasibility", "none"]  # whose logit says "expert"
    feasibility: Literal["none", "step", "sequence", "step_sequence"]  # the factors of δ̄(τ)
    terms: tuple[str, ...]  # summed to the adversary's loss
    # How a logit z becomes δ: σ(z), per-step factors multiplied over t; or the sharpened test of z as a log density
    # ratio, of which a trajectory takes the minimum over t.
    test: Literal["sigmoid", "ratio"] = "sigmoid"
    sampled_from: Literal["policy", "resampled", "pool"] = "policy"  # D_S: D_P itself; drawn by δ̄ from its N; pool_factor × N
    centred: bool = False  # the logits of D are taken less their mean over both sets, and π is paid f less its mean over D_E
    constrained_policy: bool = False  # log δ enters the policy's reward
    network: Literal["mlp", "linear"] = "mlp"
    # practice: a policy by PPO-Lagrangian in a practice world; twins: two there, one by f alone (docs/equations.md);
    # likelihood: no policy is trained, all is fitted
    learner: Literal["ppo", "cloning", "twins", "practice", "likelihood"] = "ppo"
    state_reward: bool = False  # f(s, a) = g(s) + E[h(s')] − h(s), h linear in where one is; else f(s, a) is any function
    tests_entries: bool = False  # δ₁ is of the state that a step enters and is paid on the way in; else of the step itself
    settings: Literal["paper", "tuned", "contrast", "practice", "likelihood"] = "paper"  # its defaults of `config`

    @property
    def learns_feasibility(self) -> bool:
        return self.feasibility != "none"

    @property
    def tests_steps(self) -> bool:
        """Whether δ̄ has a factor for each step, δ₁."""
        return "step" in self.feasibility

    @property
    def tests_trajectories(self) -> bool:
        """Whether δ̄ has a factor of the whole trajectory, δ_seq."""
        return "sequence" in self.feasibility

    @property
    def is_ratio_test(self) -> bool:
        return self.test == "ratio"

    @property
    def draws(self) -> bool:
        """Whether D_S is drawn by δ̄, so that q is another distribution than π."""
        return self.sampled_from != "policy"

    @property
    def has_pool(self) -> bool:
        """Whether D_S is drawn from more trajectories than it has."""
        return self.sampled_from == "pool"

    @property
    def discriminates(self) -> bool:
        return self.discriminator_of != "none"

    @property
    def clones(self) -> bool:
        return self.learner == "cloning"

    @property
    def has_twin(self) -> bool:
        """Whether θ follows the moments and a policy of f alone says what was tempting: worlds without a table."""
        return self.learner == "twins"

    @property
    def practises(self) -> bool:
        """Whether one policy learns by PPO-Lagrangian beside an adversary: only where actions are of a box."""
        return self.learner == "practice"

    @property
    def is_of_boxes(self) -> bool:
        """Whether π learns in practice, where actions are of a box; δ₁ is then of states or of actions, not of both."""
        return self.has_twin or self.practises

    @property
    def rewards_observations(self) -> bool:
        """Whether f is a function of s̃ alone: a reward of states where no table says what an action leads to."""
        return self.state_reward and self.is_of_boxes

    @property
    def is_fitted(self) -> bool:
        """Whether reward, feasibility and policy are one fit by likelihood to whole recordings (docs/animals.md)."""
        return self.learner == "likelihood"

    @property
    def is_linear(self) -> bool:
        return self.network == "linear"

    @property
    def needs_true_reward(self) -> bool:
        return self.reward == "true"

    @property
    def assumes_no_reward(self) -> bool:
        """Whether it takes r = 0 where nobody knows the true reward (GACL; Section 7.3)."""
        return self.needs_true_reward and self.discriminator_of == "feasibility"

    @property
    def learns_reward(self) -> bool:
        return self.reward == "learned" and not self.clones


_AIRCL = Method(
    reward="learned",
    discriminator_of="trajectory",
    feasibility="sequence",
    terms=("discriminator", "feasibility_gradient", "contrast", "minimal"),
    sampled_from="resampled",
)
_NO_PRIOR = ("discriminator", "feasibility_gradient", "minimal")
_ICRL = Method(
    reward="true",
    discriminator_of="none",
    feasibility="step",
    terms=("icrl",),
    constrained_policy=True,
)
_CORRECTED = Method(
    reward="learned",
    discriminator_of="step",
    centred=True,
    feasibility="step_sequence",
    terms=("discriminator", "step_ratio", "sequence_ratio", "minimal"),
    test="ratio",
    sampled_from="pool",
    constrained_policy=True,
    settings="tuned",
)
_CONTRAST = Method(
    reward="learned",
    discriminator_of="none",
    feasibility="step",
    terms=("exact_likelihood", "reward_ridge", "potential_prior", "entry_ratio"),
    test="ratio",
    constrained_policy=True,
    state_reward=True,
    tests_entries=True,
    settings="contrast",
)
_CONTRAST_OF_ACTIONS = replace(_CONTRAST, terms=(), tests_entries=False, learner="twins")
_AIRL = Method(reward="learned", discriminator_of="step", feasibility="none", terms=("discriminator",))
_GACL = replace(_ICRL, discriminator_of="feasibility", terms=("gacl",))


def _in_practice(row: Method) -> Method:
    """A row with the learner and the settings of the contrast row where actions are of a box."""
    return replace(row, learner="practice", settings="practice")


METHODS: dict[str, Method] = {
    "airl": _AIRL,
    "airl_centred": replace(_AIRL, centred=True, sampled_from="pool", settings="tuned"),
    "gacl": _GACL,
    "icrl": _ICRL,
    "icrl_prior": replace(_ICRL, terms=("icrl", "contrast")),
    "aircl": _AIRCL,
    "aircl_no_prior": replace(_AIRCL, terms=_NO_PRIOR),
    "aircl_linear": replace(_AIRCL, network="linear"),
    "aircl_sa": replace(_AIRCL, feasibility="step"),
    "aircl_corrected": _CORRECTED,
    "aircl_corrected_prior": replace(_CORRECTED, terms=(*_CORRECTED.terms, "contrast")),
    "aircl_corrected_linear": replace(_CORRECTED, network="linear"),
    "aircl_corrected_sa": replace(_CORRECTED, feasibility="step", terms=("discriminator", "step_ratio")),
    "aircl_contrast": _CONTRAST,
    "aircl_contrast_memory": replace(  # of a constraint that what is seen of a state does not decide
        _CONTRAST,
        feasibility="step_sequence",
        terms=("likelihood", "reward_ridge", "step_ratio", "sequence_ratio", "minimal"),
        sampled_from="pool",
        tests_entries=False,
    ),
    "behaviour": Method(
        reward="learned", discriminator_of="none", feasibility="step", terms=(), learner="likelihood", settings="likelihood"
    ),
    "airl_tuned": _in_practice(replace(_AIRL, centred=True, state_reward=True)),
    "gacl_tuned": _in_practice(_GACL),
    "icrl_tuned": _in_practice(_ICRL),
    "bc": replace(_AIRL, discriminator_of="none", terms=(), learner="cloning"),
}


# What a row is where actions are of a box and there is no table: entries cannot be counted, limits of actions can.
OF_BOXES: dict[str, Method] = {"aircl_contrast": _CONTRAST_OF_ACTIONS}


def get_method(name: str, contrast_prior: Literal["method", "on", "off"] = "method", *, of_box: bool = False) -> Method:
    """The row of that name; `contrast_prior` adds Eq. 13 to any row with a feasibility, or takes it away."""
    if name not in METHODS:
        raise ValueError(f"unknown method {name!r}; choose from {', '.join(METHODS)}")
    method = OF_BOXES.get(name, METHODS[name]) if of_box else METHODS[name]
    if contrast_prior == "method":
        return method
    if not method.learns_feasibility:
        raise ValueError(f"contrast_prior={contrast_prior!r}: {name} has no feasibility; choose 'method'")
    if method.is_fitted:
        raise ValueError(f"contrast_prior={contrast_prior!r}: {name} is fitted by likelihood alone; choose 'method'")
    if method.state_reward and contrast_prior == "on":
        raise ValueError(f"contrast_prior='on': {name} has no f(τ) to drive apart from δ̄(τ) as Eq. 13 does; choose 'method'")
    terms = tuple(term for term in method.terms if term != "contrast")
    return replace(method, terms=(*terms, "contrast") if contrast_prior == "on" else terms)
