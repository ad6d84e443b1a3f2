"""Both gains over the chain are read from kept results, and nothing is said where there are none."""

import json

import numpy as np
from scipy import stats

from experiments.shared.kept_gains import FOLDS, STUDY, gains_over_the_chain


def test_both_gains_are_those_of_the_kept_files(tmp_path):
    gains = [0.02, -0.01, 0.05]
    (tmp_path / FOLDS).mkdir(parents=True)
    for fold, gain in enumerate(gains):
        cell = {"policy": -0.3 + gain, "chain": -0.3}
        (tmp_path / FOLDS / f"bc_{fold}.json").write_text(json.dumps(cell))
        (tmp_path / FOLDS / f"bc_other_{fold}.json").write_text(json.dumps({"policy": 9, "chain": 0}))
    assert gains_over_the_chain("bc", tmp_path) == ()  # the study is missing
    (tmp_path / STUDY).parent.mkdir(parents=True)
    study = {"comparisons": {"windows": {"per_step": {"mean": 0.0456, "low": 0.0314, "high": 0.0599}}}}
    (tmp_path / STUDY).write_text(json.dumps(study))
    (line,) = gains_over_the_chain("bc", tmp_path)
    low, high = stats.t.interval(0.95, 2, loc=np.mean(gains), scale=stats.sem(gains))
    assert f"bc +0.0200 [{low:+.4f}, {high:+.4f}]" in line
    assert "3 folds" in line
    assert "the behaviour model +0.0456 [+0.0314, +0.0599] (`python -m experiments.behaviour`" in line
    assert gains_over_the_chain("airl", tmp_path) == ()


def test_the_projects_own_results_have_both_gains():
    (line,) = gains_over_the_chain("aircl_corrected")
    assert "aircl_corrected -0.0078" in line
    assert "9 folds" in line
