"""Which learner and which settings an expert is trained by, and what of a reference set is the unconstrained expert's."""

from dataclasses import asdict, replace

import jax.numpy as jnp
import pytest

from aircl_jax.algorithm.learners.scale_free import true_motors
from aircl_jax.experts.config import EXPERTS, RULE, expert_config, read_config
from aircl_jax.experts.selection import free_episodes
from aircl_jax.settings.lagrangian_config import LagrangianConfig
from aircl_jax.settings.learner_config import LearnerConfig, learner_config
from envs import make_env
from tests.worlds import random_trajectories, tiny_grid


@pytest.mark.parametrize(
    ("name", "settings", "falls", "motor_limit"),
    [
        ("halfcheetah", {"constraint": "torque"}, False, 0.5),
        ("halfcheetah", {"constraint": "torque", "limit": 0.3}, False, 0.3),
        ("halfcheetah", {"constraint": "position"}, False, 0.0),
        ("hopper", {"constraint": "torque"}, True, 0.5),
    ],
)
def test_a_task_without_a_row_has_motors_that_stop_at_its_torque_limit_and_early_ends_if_it_can_fall(
    name, settings, falls, motor_limit
):
    world = make_env(name, **settings)
    found = expert_config(world, settings["constraint"])
    assert found == (replace(learner_config(world), multiplier_max=1000.0) if falls else RULE)
    assert isinstance(found, LearnerConfig) and found.restart is falls and found.stops
    motors = true_motors(world)
    assert (0.0 if motors is None else float(motors[1][0])) == pytest.approx(motor_limit)


def test_a_task_with_a_row_keeps_it_and_either_kind_of_settings_is_read_back():
    row, rule = expert_config(make_env("walker"), "torque"), expert_config(make_env("hopper"), "torque")
    assert row == EXPERTS["walker_torque"]
    assert (read_config(asdict(row)), read_config(asdict(rule))) == (row, rule)


def test_a_world_of_another_library_has_the_defaults_of_ppo_lagrangian():
    assert expert_config(replace(make_env("walker"), name="gymnasium"), "torque") == LagrangianConfig()


@pytest.mark.parametrize(("total", "groups", "number"), [(56, 7, 8), (140, 7, 20), (180, 8, 60), (63, 8, 21), (63, 7, 9)])
def test_the_last_episodes_of_a_reference_set_are_the_unconstrained_experts(total, groups, number):
    reference = random_trajectories(tiny_grid(), 0, total)
    kept = free_episodes(reference, groups)
    assert kept.mask.shape[0] == number
    assert jnp.array_equal(kept.reward, reference.reward[total - number :])
