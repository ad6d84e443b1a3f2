"""List the loss terms, one function per equation; a method's row names those that are summed."""

from collections.abc import Callable
from typing import Literal, get_args, get_origin, get_type_hints

from jaxtyping import Array, Float

from aircl_jax.algorithm.terms.baselines import gacl, icrl
from aircl_jax.algorithm.terms.contrast import entry_ratio, exact_likelihood, likelihood, potential_prior, reward_ridge
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
    "potential_prior": potential_prior,
    "entry_ratio": entry_ratio,
    "gacl": gacl,
    "icrl": icrl,
}


def check_method(name: str, method: Method) -> None:
    """Raise ValueError for a row that names an unknown term, or a choice that there is not."""
    for field, annotation in get_type_hints(Method).items():
        choices, value = get_args(annotation), getattr(method, field)
        if get_origin(annotation) is Literal and value not in choices:
            raise ValueError(f"method={name}: {field}={value!r}; choose from {', '.join(choices)}")
    for term in method.terms:
        if term not in TERMS:
            raise ValueError(f"method={name}: unknown term {term!r}; choose from {', '.join(TERMS)}")
