"""On the guide's own world a search without the truth finds settings that are no worse in the true measures."""

import numpy as np
import pytest

from tests.worlds import guides_world

pytest.importorskip("optuna", reason="the extra `search` is not installed")

# Chosen before any search had ended: the two learning rates and the judge's steps, the defaults among them.
RANGES = {
    "train.ppo.learning_rate": (0.0003, 0.003, "log"),
    "train.adversary.learning_rate": (0.0003, 0.003, "log"),
    "train.adversary.num_steps": (2, 12),
}
METHOD = "aircl_corrected_sa"  # a factor of each step alone: the disc has no memory
BUDGET, ITERATIONS = 6, 60
SEEDS, FIRST = 3, 100  # of the comparison
COMPARED = ("violation_rate_policy", "return", "feasibility_auroc", "occupancy_tv")


@pytest.mark.slow
def test_what_a_search_finds_on_ones_own_world_is_no_worse_than_the_defaults(tmp_path, monkeypatch):
    from aircl_jax import search, train

    monkeypatch.chdir(tmp_path)
    own = guides_world()
    found = search(own, METHOD, ranges=RANGES, budget=BUDGET, iterations=ITERATIONS, run_dir="search")
    print(f"\n{found.table}\n")
    assert found.has_defaults
    measures = {}
    for name, config in (("defaults", None), ("found", found.config)):
        summary = train(own, METHOD, config=config, iterations=ITERATIONS, seeds=SEEDS, first_seed=FIRST).summary["metrics"]
        measures[name] = {measure: np.array(summary[measure]["per_seed"], float) for measure in COMPARED}
        print(name, {measure: f"{x.mean():.3f} ± {x.std(ddof=1):.3f}" for measure, x in measures[name].items()})
    defaults, best = measures["defaults"], measures["found"]
    assert best["violation_rate_policy"].mean() <= defaults["violation_rate_policy"].mean() + 0.01
    assert best["return"].mean() >= defaults["return"].mean() - 0.02
