"""The shield's command: what it measures, and what it refuses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.transfer.shield import Decision
from aircl_jax.types import Trajectory
from envs import Box
from experiments.shield.__main__ import main
from experiments.shield.controllers import unconstrained
from experiments.shield.episodes import Measures, measured, unshielded
from experiments.shield.report import as_markdown
from tests.worlds import one_state_env


def test_violations_and_replacements_are_shares_of_the_steps_that_count():
    reward, mask = jnp.array([[1.0, 2.0], [3.0, 9.0]]), jnp.array([[1.0, 1.0], [1.0, 0.0]])
    cost, replaced = jnp.array([[0.0, 1.0], [0.0, 1.0]]), jnp.array([[True, False], [True, True]])
    feasible = jnp.array([[True, True], [False, False]])
    found = Measures.of(reward, cost, mask, replaced, feasible)
    np.testing.assert_allclose(found, [1 / 3, 0.5, 3.0, 0.0, 2 / 3, 1 / 3], rtol=1e-6)


def test_episodes_follow_what_was_decided():
    env = one_state_env(lambda t, action: action.sum(), horizon=3, action_space=Box(1))
    alone = measured(env, unshielded(lambda obs, key: jnp.ones(1)), 4)
    assert alone == (0.0, 0.0, 3.0, 0.0, 0.0, 0.0)
    halved = measured(env, lambda obs, key: Decision(jnp.full(1, 0.5), jnp.array(True), jnp.array(False)), 2)
    assert halved == (0.0, 0.0, 1.5, 0.0, 1.0, 1.0)


def test_the_page_has_a_row_a_controller():
    row = dict(zip(Measures._fields, (0.9, 1.0, 150.0, 2.0, 0.0, 0.0), strict=True)) | {"microseconds": 80.4}
    found = {
        "env": "swimmer",
        "method": "aircl_corrected",
        "command": "python -m experiments.shield run_dir=R",
        "controller": "a clone",
        "judged_by": {"behind": "recovered limits"},
        "episodes": 5,
        "rows": {"alone": row, "behind": row | {"violating_steps": 0.0, "replaced": 0.5}},
    }
    text = as_markdown(found)
    assert "| alone      | 90.00%          | 100%               | 150.0 ± 2.0 | 0.0%     | 0.0%        | 80        |" in text
    assert "Judged by recovered limits. 5 fresh episodes" in text


def test_the_unconstrained_episodes_of_a_reference_set_are_its_last(monkeypatch):
    with np.load("envs/demonstrations/swimmer_torque_reference.npz") as file:
        cost, mask = file["cost"], file["mask"]
    zeros, shown = jnp.zeros((*cost.shape, 1)), jnp.asarray(mask)
    given = Trajectory(zeros, zeros, shown, shown, shown, jnp.asarray(cost), shown, shown[:, 0])
    kept = unconstrained(given, 7)
    assert kept.cost.shape == (20, 500)
    assert jax.device_get(kept.cost.sum(axis=1)).min() > 400
    with pytest.raises(ValueError, match="no episode that violates"):
        unconstrained(given._replace(cost=0 * given.cost), 7)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "run_dir is missing"),
        (["run_dir=nowhere"], "nowhere"),
        (["run_dir=nowhere", "episodes=0"], "episodes=0"),
        (["run_dir=nowhere", "by=magic"], "by"),
    ],
)
def test_what_does_not_fit_is_one_line(words, says, capsys):
    assert main(words) == 2
    said = capsys.readouterr().err
    assert says in said
    assert said.count("\n") == 1
