"""results/sweeps: a value's own numbers in its row and at its place in the figure, and the run that made them."""

from types import SimpleNamespace

import matplotlib as mpl
import numpy as np
import pytest

from aircl_jax.figures import sweep as sweep_figure
from aircl_jax.figures.style import STYLE
from experiments import sweeps

FOUND = {
    "method": "aircl_corrected",
    "setting": "slip",
    "values": [0.0, 0.05, 0.2],
    "seeds": 3,
    "metrics": {
        "violation_rate": [[0.01, 0.03, 0.08], [0.1, 0.2, 0.3], [0.3, 0.8, 0.4]],
        "violation_rate_policy": [[0.05] * 3, [0.05] * 3, [0.05, 0.05, 0.08]],
        "reward_correlation": [[-0.5, 0.5, 0.0], [None, 0.4, 0.6], [0.9, 0.9, 0.9]],
        "violation_rate_expert": [[0.0] * 3, [0.001, 0.002, 0.003], [0.5] * 3],
    },
}


def test_a_row_is_a_value_and_a_column_a_measure():
    head, _, *rows = sweeps.table(FOUND).splitlines()
    assert head == "| slip | violation_rate | violation_rate_policy | reward_correlation | violation_rate_expert |"
    assert rows == [
        "| 0 | 0.040 ± 0.036 | 0.050 ± 0.000 | 0.000 ± 0.500 | 0.000 ± 0.000 |",
        "| 0.05 | 0.200 ± 0.100 | 0.050 ± 0.000 | — | 0.002 ± 0.001 |",
        "| 0.2 | 0.500 ± 0.265 | 0.060 ± 0.017 | 0.900 ± 0.000 | 0.500 ± 0.000 |",
    ]


def test_a_panel_has_every_seed_and_the_means_over_seeds_at_its_value():
    with mpl.rc_context(STYLE):
        drawing = sweep_figure.draw("noise", "slip of the world", FOUND)
    rates, policy, correlation = drawing.figure.axes
    assert [axis.get_title(loc="left") for axis in drawing.figure.axes] == [
        *("violations of $q$", r"violations of $\pi$", "corr. of $f$, $r$"),
    ]
    *seeds, means = [np.asarray(line.get_ydata(), float) for line in rates.lines]
    assert np.array(seeds).tolist() == [[0.01, 0.1, 0.3], [0.03, 0.2, 0.8], [0.08, 0.3, 0.4]]
    assert means == pytest.approx([0.04, 0.2, 0.5])
    assert np.asarray(policy.lines[-1].get_ydata()) == pytest.approx([0.05, 0.05, 0.06])
    assert np.asarray(correlation.lines[-1].get_ydata()) == pytest.approx([0.0, 0.5, 0.9])  # of the seeds that have one
    assert [tick.get_text() for tick in rates.get_xticklabels()] == ["0", "0.05", "0.2"]
    assert rates.get_ylim() == pytest.approx((0.0, 0.88))  # a tenth above the greatest seed
    assert correlation.get_ylim() == pytest.approx((-0.55, 1.0))
    assert "at 3 values of `slip`, 3 seeds each" in drawing.caption


@pytest.mark.parametrize("of", ["env", "config"])
def test_a_setting_of_the_world_or_of_training_is_changed_where_it_belongs(of, monkeypatch):
    asked = []

    def train(env, method, **given):
        asked.append((given["env_settings"], given["config"]))
        assert given["first_seed"] == 0
        value = {**given["env_settings"], **given["config"]}["name"]
        return SimpleNamespace(summary={"metrics": {"violation_rate": {"per_seed": [value, None]}}})

    monkeypatch.setattr(sweeps, "train", train)
    found = sweeps.run(sweeps.Sweep("", "aircl", "name", (0.1234567, 0.5), of), sweeps.Settings(seeds=2))
    changed, left = ([one[place] for one in asked] for place in ((0, 1) if of == "env" else (1, 0)))
    assert changed == [{"name": 0.1234567}, {"name": 0.5}]
    assert left == [{}, {}]
    assert found["metrics"] == {"violation_rate": [[0.123457, None], [0.5, None]]}
    assert (found["values"], found["method"], found["setting"], found["seeds"]) == ((0.1234567, 0.5), "aircl", "name", 2)


def test_a_coefficient_is_swept_in_one_program(monkeypatch):
    def swept(spec, name, values):
        assert (spec.method_name, list(spec.seeds), spec.config.iterations) == ("aircl", [0, 1, 2], 7)
        return {"goal_rate": np.array([[len(name), value, np.inf] for value in values])}

    monkeypatch.setattr(sweeps, "sweep", swept)
    one = sweeps.Sweep("", "aircl", "contrast_coef", (0.1, 0.5))
    found = sweeps.run(one, sweeps.Settings(seeds=3, iterations=7))
    assert found["metrics"] == {"goal_rate": [[13, 0.1, None], [13, 0.5, None]]}


@pytest.mark.parametrize(("name", "method"), [("phi_literal", "aircl"), ("phi_corrected", "aircl_corrected_prior")])
def test_phi_is_swept_as_printed_and_as_corrected(name, method):
    assert (sweeps.SWEEPS[name].method, sweeps.SWEEPS[name].name) == (method, "contrast_coef")


def test_the_contrast_row_is_swept_on_its_fresh_seeds_with_its_own_iterations(monkeypatch):
    asked = []

    def train(env, method, **given):
        asked.append((method, given["first_seed"], given["iterations"], given["config"]))
        return SimpleNamespace(summary={"metrics": {}})

    def swept(spec, name, values):
        asked.append((spec.method_name, spec.seeds, spec.config.iterations, name))
        return {}

    monkeypatch.setattr(sweeps, "train", train)
    monkeypatch.setattr(sweeps, "sweep", swept)
    sweeps.run(sweeps.SWEEPS["demonstrations_contrast"], sweeps.Settings(seeds=2))
    assert asked == [("aircl_contrast", 1000, "default", {"num_demonstrations": n}) for n in (5, 10, 20, 50, 100, 200)]
    sweeps.run(sweeps.SWEEPS["threshold_contrast"], sweeps.Settings(seeds=2))
    assert asked[-1] == ("aircl_contrast", (1000, 1001), 300, "threshold")
