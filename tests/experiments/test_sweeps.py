import json

import numpy as np
import pytest

from aircl_jax import train
from aircl_jax.runs.spec import make_spec
from aircl_jax.runs.sweep import sweep
from experiments import sweeps
from tests.tiny_runs import CHUNK, FAST, WHOLE

OF_SPEC = {"contrast_prior": "method", "first_seed": 0, "demonstrations": "default"}


def test_every_value_of_a_sweep_is_the_run_with_that_coefficient():
    spec = make_spec(**WHOLE, **OF_SPEC, iterations=CHUNK)
    default = float(spec.config.coefficients.threshold)
    found = sweep(spec, "threshold", [0.9, default])
    assert found["violation_rate_policy"].shape == (2, 2)
    alone = train(**WHOLE, iterations=CHUNK).summary["metrics"]
    for name in ("feasibility_gap", "feasibility_policy", "return", "entropy"):
        np.testing.assert_allclose(found[name][1], np.array(alone[name]["per_seed"], float), rtol=1e-3, atol=1e-4)
    assert np.abs(found["feasibility_policy"][0] - found["feasibility_policy"][1]).max() > 1e-4


def test_unknown_coefficients_and_no_values_are_refused():
    spec = make_spec(**FAST, **OF_SPEC, iterations=CHUNK)
    with pytest.raises(ValueError, match="coefficient=phi is unknown; choose from contrast_coef"):
        sweep(spec, "phi", [0.1])
    with pytest.raises(ValueError, match="values is empty"):
        sweep(spec, "threshold", [])
    with pytest.raises(ValueError, match=r"threshold=0\.0 is not above 0"):
        sweep(spec, "threshold", [0.3, 0.0])


def test_a_finished_sweep_is_written_and_not_trained_again(tmp_path, capsys):
    metrics = {name: [[0.1, 0.2], [0.3, None]] for name in ("violation_rate", "goal_rate")}
    found = {"command": "c", "commit": "x", "method": "m", "setting": "sampled_coef", "values": [0, 1], "seeds": 2}
    (tmp_path / "m.json").write_text(json.dumps(found | {"metrics": metrics}))
    assert sweeps.main(["sweep=m", "seeds=2", f"out={tmp_path}"]) == 0
    report = (tmp_path / "report.md").read_text()
    assert "| 0 | 0.150 ± 0.071 | 0.150 ± 0.071 |" in report
    assert "| 1 | — | — |" in report
    assert "Not trained yet: `python -m experiments.sweeps sweep=noise`" in report
    assert (tmp_path / "m.png").exists()
    assert "training" not in capsys.readouterr().out


def test_fewer_seeds_are_no_results(capsys):
    assert sweeps.main(["seeds=2"]) == 2
    assert "choose out=DIR" in capsys.readouterr().err
