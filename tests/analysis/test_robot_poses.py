"""A robot's poses: from observations to links in their plane."""

from pathlib import Path

import numpy as np
import pytest

from aircl_jax.analysis import robot_poses

TORQUE = {"constraint": "torque", "integrator": "euler"}


@pytest.mark.parametrize("task", ["torque", "position"])
def test_links_of_the_swimmer_at_rest_are_those_of_its_description(task):
    body = robot_poses.make_body("swimmer", TORQUE | {"constraint": task})
    ends = robot_poses.links(body, np.zeros((1, 1, 5)))[0, 0]
    np.testing.assert_allclose(np.sort(ends[..., 0], axis=1), [[0.5, 1.5], [-0.5, 0.5], [-1.5, -0.5]], atol=1e-12)
    np.testing.assert_allclose(ends[..., 1], 0.0, atol=1e-12)
    assert body.stage.axes == ("x", "y")
    assert body.stage.dt == pytest.approx(0.04)
    assert body.stage.floor is None


def test_a_turned_joint_turns_the_links_behind_it():
    body = robot_poses.make_body("swimmer", TORQUE)
    ends = robot_poses.links(body, np.array([[[0.0, 0.0, 0.0, 0.0, np.pi / 2]]]))[0, 0]
    np.testing.assert_allclose(sorted(ends[2].tolist()), [[-0.5, -1.0], [-0.5, 0.0]], atol=1e-9)


def test_the_walker_stands_on_its_floor_with_a_second_leg_to_be_told_apart():
    body = robot_poses.make_body("walker", TORQUE)
    ends = robot_poses.links(body, body.model.qpos0[None, None])[0, 0]
    assert body.stage.floor == 0.0
    assert body.stage.axes == ("x", "z")
    assert body.stage.branch.tolist() == [0, 0, 0, 0, 1, 1, 1]
    assert (ends[..., 1] - body.stage.radius[:, None]).min() == pytest.approx(0.04, abs=1e-9)  # of the feet: 0.1 − 0.06


def test_the_pendulum_has_a_rail_and_an_upright_pole():
    body = robot_poses.make_body("pendulum", TORQUE | {"constraint": "position"})
    assert body.stage.rail == (-1.0, 1.0)
    np.testing.assert_allclose(np.sort(robot_poses.links(body, np.zeros((1, 1, 2)))[0, 0, 1, :, 1]), [0.0, 0.6], atol=1e-3)


def test_hidden_coordinates_are_summed_from_their_velocities():
    body = robot_poses.make_body("swimmer", TORQUE)
    angles, speed = np.array([0.1, 0.2, 0.3]), np.array([0.5, -0.25, 0.0, 0.0, 0.0])
    obs = np.tile(np.concatenate([angles, speed]), (1, 4, 1))
    qpos = robot_poses.positions(body, obs)
    assert robot_poses.unobserved(body) == ["x", "y"]
    np.testing.assert_allclose(qpos[0, :, 2:], np.tile(angles, (4, 1)))
    np.testing.assert_allclose(qpos[0, :, 0], 0.5 * 0.04 * np.arange(4))
    np.testing.assert_allclose(qpos[0, :, 1], -0.25 * 0.04 * np.arange(4))


def test_a_summed_x_drifts_by_centimetres_in_20_seconds():
    obs = np.load(Path(robot_poses.__file__).parents[2] / "envs/demonstrations/swimmer_position.npz")["obs"]
    summed = robot_poses.positions(robot_poses.make_body("swimmer", TORQUE), obs[..., 2:])  # what the torque task would show
    drift = np.abs(summed[..., 0] + obs[:, :1, 0] - obs[..., 0])
    assert np.median(drift[:, -1]) == pytest.approx(0.06, abs=0.005)
    assert drift.max() == pytest.approx(0.17, abs=0.005)


def test_observed_positions_are_kept_as_they_are():
    body = robot_poses.make_body("walker", TORQUE | {"constraint": "position"})
    obs = np.random.default_rng(0).normal(size=(2, 3, 18))
    assert robot_poses.unobserved(body) == []
    np.testing.assert_allclose(robot_poses.positions(body, obs), obs[..., :9])
