"""List the loss terms, one function per equation; a method's row names those that are summed."""

from collections.abc import Callable

from jaxtyping import Array, Float

from aircl_jax.algorithm.terms.baselines import gacl, icrl
from aircl_jax.algorithm.terms.contrast import entry_ratio, exact_likelihood, likelihood, reward_ridge
from aircl_jax.algorithm.terms.corrected import sequence_ratio, step_ratio
from aircl_jax.algorithm.terms.logits import Batches
from aircl_jax.algorithm.terms.printed import contrast, discriminator, feasibility_gradient, minimal
from aircl_jax.methods import Method
from aircl_jax.settings.train_config import Coefficients, TrainConfig

Term = Callable[[Method, TrainConfig, Coefficients, Batches], Float[Array, ""]]


TERMS: dict[str, Term] = {
    "discriminator": discriminator,
    "feasibility_gradient": feasibility_gradient,
    "contrast": contrast,
    "minimal": minimal,
    "step_ratio": step_ratio,
    "sequence_ratio": sequence_ratio,
    "likelihood": likelihood,
    "exact_likelihood": exact_likelihood,
    "reward_ridge": reward_ridge,
    "entry_ratio": entry_ratio,
    "gacl": gacl,
    "icrl": icrl,
}
