"""The table of methods: each row states what is learned, what judges it and which equations make up its loss."""

from dataclasses import dataclass, replace
from typing import Literal


@dataclass(frozen=True)
class Method:
    """One row. The fused train step is the same for all; a row chooses its terms (names in `adversary.TERMS`)."""

    reward: Literal["learned", "true"]  # what the policy is driven by: f_θ, or the environment's own reward
    judge: Literal["trajectory", "state_action", "centred", "feasibility", "none"]  # whose logit says "expert"
    feasibility: Literal["none", "step", "sequence", "step_sequence"]  # the factors of δ̄(τ)
    terms: tuple[str, ...]  # summed to the adversary's loss
    # How a logit z becomes δ: σ(z), per-step factors multiplied over t; or the sharpened test of z as a log density
    # ratio, of which a trajectory takes the minimum over t.
    test: Literal["sigmoid", "ratio"] = "sigmoid"
    sampled_from: Literal["policy", "resampled", "pool"] = "policy"  # D_S: D_P itself; drawn by δ̄ from its N; pool_factor × N
    constrained_policy: bool = False  # log δ enters the policy's reward
    network: Literal["mlp", "linear"] = "mlp"
    learner: Literal["ppo", "cloning"] = "ppo"
    settings: Literal["paper", "tuned"] = "paper"  # which defaults of `config` it runs with

    @property
    def needs_true_reward(self) -> bool:
        return self.reward == "true"

    @property
    def assumes_no_reward(self) -> bool:
        """Whether it takes r = 0 where nobody knows the true reward (GACL; Section 7.3)."""
        return self.needs_true_reward and self.judge == "feasibility"

    @property
    def learns_reward(self) -> bool:
        return self.reward == "learned" and self.learner == "ppo"


_AIRCL = Method(
    reward="learned",
    judge="trajectory",
    feasibility="sequence",
    terms=("discriminator", "feasibility_gradient", "contrast", "minimal"),
    sampled_from="resampled",
)
_NO_PRIOR = ("discriminator", "feasibility_gradient", "minimal")
_ICRL = Method(
    reward="true",
    judge="none",
    feasibility="step",
    terms=("icrl",),
    constrained_policy=True,
)
_CORRECTED = Method(
    reward="learned",
    judge="centred",
    feasibility="step_sequence",
    terms=("discriminator", "step_ratio", "sequence_ratio", "minimal"),
    test="ratio",
    sampled_from="pool",
    constrained_policy=True,
    settings="tuned",
)
_AIRL = Method(reward="learned", judge="state_action", feasibility="none", terms=("discriminator",))

METHODS: dict[str, Method] = {
    "airl": _AIRL,
    "airl_centred": replace(_AIRL, judge="centred", sampled_from="pool", settings="tuned"),
    "gacl": replace(_ICRL, judge="feasibility", terms=("gacl",)),
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
    "bc": replace(_AIRL, judge="none", terms=(), learner="cloning"),
}


def get_method(name: str, contrast_prior: Literal["method", "on", "off"] = "method") -> Method:
    """The row of that name; `contrast_prior` adds Eq. 13 to any row with a feasibility, or takes it away."""
    if name not in METHODS:
        raise ValueError(f"unknown method {name!r}; choose from {', '.join(METHODS)}")
    method = METHODS[name]
    if contrast_prior == "method":
        return method
    if method.feasibility == "none":
        raise ValueError(f"contrast_prior={contrast_prior!r}: {name} has no feasibility; choose 'method'")
    terms = tuple(term for term in method.terms if term != "contrast")
    return replace(method, terms=(*terms, "contrast") if contrast_prior == "on" else terms)
