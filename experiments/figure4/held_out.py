"""Score held-out recordings: the likelihood of their next code under a policy trained on the others, and a Markov chain."""

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from jaxtyping import Float, Int

from aircl_jax import train
from aircl_jax.analysis.causal import markov_chain
from aircl_jax.analysis.recovered import recover
from envs import Tabular
from envs.animals.meerkat import demonstrations, held_out_recordings
from envs.options import MeerkatOptions
from experiments.figure4.cells import Settings, Study

METHODS = ("aircl_corrected", "airl", "bc")
SMOOTHINGS = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0)  # pseudo-counts that cross-validation chooses from


def held_out_cell(settings: Settings, study: Study, method: str, fold: int) -> dict[str, Any]:
    """Compute mean log P(next code) of two recordings under a policy trained on the others, and under a Markov chain."""
    where = {"data": settings.data, "mapping": settings.mapping, "split": "train", "fold": fold}
    result = train(
        "meerkat",
        method,
        seeds=1,
        iterations=settings.iterations,
        env_settings=where,
        config=settings.training,
    )
    table = cast(Tabular, result.spec.env.tabular)
    options = MeerkatOptions(data=settings.data, mapping=settings.mapping, fold=fold)
    now, after = _transitions(options)
    log_policy = recover(result, table).log_policy[0]
    smoothing, chain = smoothed_chain(study, held_out_recordings(options))
    return {
        "fold": fold,
        "recordings": held_out_recordings(options),
        "transitions": now.size,
        "policy": float(log_policy[now, after].mean()),
        "chain": float(np.log(chain)[now, after].mean()),
        "smoothing": smoothing,
        "commit": study.commit,
    }


def _transitions(options: MeerkatOptions) -> tuple[Int[np.ndarray, "N T"], Int[np.ndarray, "N T"]]:
    arrays = demonstrations(options, "held_out")
    return arrays["obs"].argmax(axis=-1), arrays["action"]


def smoothed_chain(study: Study, held_out: Sequence[str]) -> tuple[float, Float[np.ndarray, "C C"]]:
    """Fit the first-order chain to the other recordings; leaving out one of them at a time chooses its pseudo-count."""
    windows = study.herd.windows
    names = [name for name in np.unique(windows.recording).tolist() if name not in held_out]

    def score(smoothing: float) -> float:
        total = 0.0
        for name in names:
            fitted = np.isin(windows.recording, [other for other in names if other != name])
            log_chain = np.log(markov_chain(windows.code[fitted], study.num_codes, smoothing)[1])
            left_out = windows.code[windows.recording == name]
            total += log_chain[left_out[:, :-1], left_out[:, 1:]].sum()
        return total

    best = max(SMOOTHINGS, key=score)
    return best, markov_chain(windows.code[np.isin(windows.recording, names)], study.num_codes, best)[1]
