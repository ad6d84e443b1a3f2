"""Choose features and ridges on the other folds alone, so that the fold that judges has no part in the choice."""

from collections.abc import Callable, Mapping
from typing import NamedTuple, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int

Variant = TypeVar("Variant")
Predict = Callable[[Variant, Bool[np.ndarray, " R"]], Float[np.ndarray, " N"]]


class Nested(NamedTuple):
    """Every step's log-probability under the variant that the other folds chose, and what each fold's others chose."""

    nats: Float[np.ndarray, " N"]
    chosen: tuple[str, ...]


def nested_selection(
    variants: Mapping[str, Variant],
    predict: Predict[Variant],
    fold_of: Int[np.ndarray, " R"],
    recording: Int[np.ndarray, " N"],
) -> Nested:
    """Choose, for every fold k, the variant of most nats on the other folds j, each fitted without both j and k.

    `predict(variant, trained)` fits to the trained recordings and returns each step's log-probability.
    """
    folds = int(fold_of.max()) + 1
    step_fold = fold_of[recording]
    score = {name: np.zeros((folds, folds)) for name in variants}  # [k left out, j judged]
    for name, variant in variants.items():
        for one in range(folds):
            for other in range(one):
                nats = predict(variant, (fold_of != one) & (fold_of != other))
                score[name][one, other] = nats[step_fold == other].sum()
                score[name][other, one] = nats[step_fold == one].sum()
    chosen = tuple(max(variants, key=lambda name: score[name][fold].sum()) for fold in range(folds))
    result = np.zeros(len(recording))
    for fold, name in enumerate(chosen):
        here = step_fold == fold
        result[here] = predict(variants[name], fold_of != fold)[here]
    return Nested(result, chosen)
