"""A world that does not fit its own fields is refused in one line that names it."""

from copy import copy
from dataclasses import replace
from unittest import mock

import jax.numpy as jnp
import numpy as np
import pytest

from envs import CONSTRAINTS, Box, Codes, Constraint, Coordinates, Discrete, Grid, Limit, Step, adapt, make_env
from envs.checks import check_env, check_predicate
from tests.worlds import one_state_env, tiny_grid

WORLD = replace(one_state_env(lambda t, action: 0.0 * t, horizon=3, action_space=Box(2)), name="point")


def stepping(step):
    return lambda key, state, action: (state + 1, step)


def _changed(changes):
    """A copy with other values, which the tests' type checker does not see."""
    world = copy(WORLD)
    for name, value in changes.items():
        object.__setattr__(world, name, value)
    return world


FITTING = Step(jnp.zeros(4), jnp.zeros(()), jnp.zeros(()), jnp.zeros(()))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"horizon": 0}, "horizon=0; choose a whole number from 1 to 100000"),
        ({"horizon": 2**32}, "horizon=4294967296; choose a whole number from 1 to 100000"),
        ({"action_space": Box(2, 1.0, -1.0)}, "action_space runs from 1.0 to -1.0; choose a low below a high"),
        ({"action_space": 2}, "action_space is of type int; choose Discrete or Box"),
        ({"constraint_input": "actions"}, "constraint_input='actions'; choose from state, action, state_action"),
        ({"reset": lambda key: jnp.zeros(4)}, "reset returns ShapeDtypeStruct; choose (state, obs)"),
        ({"obs_size": 5}, "obs of reset has shape [4]; choose [5]"),
        ({"step": stepping(tuple(FITTING))}, "step does not return (state, Step); choose envs.Step for the second"),
        ({"step": stepping(FITTING._replace(obs=jnp.zeros(3)))}, "obs of step has shape [3]; choose [4]"),
        ({"step": stepping(FITTING._replace(reward=jnp.zeros(1)))}, "reward of step has shape [1]; choose []"),
        ({"step": stepping(FITTING._replace(cost=jnp.zeros(2)))}, "cost of step has shape [2]; choose []"),
        (
            {"step": lambda key, state, action: (0.5 * state, FITTING)},
            "step changes the structure, a shape or a type of state or obs; choose those that reset returns",
        ),
        (
            {"step": lambda key, state, action: (FITTING.obs, 0.0, False, False, {})},
            "step returns 5 values, as Gymnasium's does; choose (state, envs.Step(obs, reward, cost, terminated))",
        ),
        (
            {"step": lambda key, state, action: (state + len(action.missing), FITTING)},
            "step cannot be traced (AttributeError:",
        ),
        ({"reset": lambda key: (jnp.zeros(4)[99], jnp.zeros(4))}, "reset reads index 99 of an axis of 4, which jax takes for"),
        ({"reward_view": lambda obs: obs[jnp.array([0, 1, 2, 7])]}, "reward_view reads index 7 of an axis of 4"),
        ({"reward_view": lambda obs: obs[:2]}, "reward_view has shape [2]; choose [4], or set reward_view_size"),
        ({"tabular": tiny_grid().tabular}, "tabular needs a finite world; choose Discrete actions"),
        (
            {"tabular": tiny_grid().tabular, "action_space": Discrete(2)},
            "tabular.transition has shape [9, 4, 9]; choose [9, 2, 9]",
        ),
        ({"view": Grid(3, (0, 0), (2, 2), {})}, "view names 9 coordinates; choose 4, as obs_size says"),
        ({"view": Codes(("eat", "rest"), np.zeros((2, 2), bool))}, "view names 2 coordinates; choose 4"),
        ({"view": Coordinates(motors=("hip",))}, "view names 1 motors; choose 2, or none"),
        ({"limit": Limit("wall", 0.5, 4)}, "limit.bounds=4; choose a coordinate from 0 to 3, actions, or None"),
    ],
)
def test_a_misfit_is_one_line_with_the_env_and_what_would_fit(changes, message):
    with pytest.raises(ValueError) as caught:  # noqa: PT011
        check_env(_changed(changes))
    assert str(caught.value).startswith(f"env=point: {message}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("gridworld", {}),
        ("nonmarkov", {}),
        ("swimmer", {"constraint": "position"}),
        ("walker", {"constraint": "none"}),
        ("pendulum", {"terminate": True}),
        ("meerkat", {"data": "simulated"}),
        ("meerkat", {"data": "simulated", "state": "place"}),
        ("labyrinth", {"data": "simulated"}),
    ],
)
def test_every_shipped_world_fits(name, settings):
    check_env(make_env(name, **settings))


def test_a_world_of_ones_own_fits():
    check_env(WORLD)


POSE, TORQUE = jnp.zeros(9), jnp.zeros(2)


@pytest.mark.parametrize(
    ("violated", "message"),
    [
        (lambda qpos, action: qpos[0], "violated gives float32; choose true or false, as a comparison does"),
        (lambda qpos, action: action > 0.5, "violated has shape [2]; choose []"),
        (lambda qpos, action: qpos[99] > 1, "violated reads index 99 of an axis of 9, which jax takes for the last"),
        (lambda qpos, action: qpos[-10] > 1, "violated reads index"),
        (lambda qpos, action: jnp.where(qpos[:, None] > 1, 1, 0)[2, 4] > 0, "violated reads index 4 of an axis of 1"),
        (lambda qpos, action: jnp.take(qpos, 9) > 1, "violated reads index 9 of an axis of 9"),
        (lambda qpos, action: bool(qpos[0] > 1), "violated cannot be traced (TracerBoolConversionError:"),
        (lambda qpos: True, "violated cannot be traced (TypeError:"),
        (lambda qpos, action: None, "violated has no shape; choose []"),
    ],
)
def test_a_predicate_that_gives_no_true_or_false_or_reads_beyond_an_end_is_refused(violated, message):
    with pytest.raises(ValueError) as caught:  # noqa: PT011
        check_predicate("violated", violated, POSE, TORQUE)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "violated",
    [
        lambda qpos, action: (jnp.abs(action) > 0.5).any(),
        lambda qpos, action: qpos[-9] + qpos[8] > 1,
        lambda qpos, action: qpos[3:99].sum() > 1,  # a slice ends where the array does, as NumPy's
        lambda qpos, action: qpos[jnp.argmax(qpos)] > 1,
        lambda qpos, action: qpos[jnp.array([0, 8])].any(),
        lambda qpos, action: True,
    ],
)
def test_a_predicate_that_gives_true_or_false_is_taken(violated):
    check_predicate("violated", violated, POSE, TORQUE)


def test_a_shipped_robot_refuses_a_constraint_that_reads_beyond_the_pose():
    rows = {"swimmer": Constraint(lambda qpos, action, limit: qpos[99] > limit, limit=1.0)}
    with (
        mock.patch.dict(CONSTRAINTS, {"far": rows}),
        pytest.raises(ValueError, match=r"constraint 'far' of swimmer reads index 99 of an axis of 5"),
    ):
        make_env("swimmer", constraint="far")


@pytest.mark.filterwarnings("ignore:Brax System:UserWarning", "ignore:JAXopt:DeprecationWarning")
def test_a_world_that_is_wrapped_for_training_is_refused_by_the_names_of_its_wrappers():
    brax_envs = pytest.importorskip("brax.envs")
    world = brax_envs.get_environment("hopper", backend="spring")
    wrapped = brax_envs.training.wrap(world, episode_length=10)
    with pytest.raises(ValueError, match="Hopper is wrapped in AutoResetWrapper, EpisodeWrapper, VmapWrapper, whose resets"):
        adapt(wrapped, lambda state, action: jnp.abs(action).max() > 0.5, horizon=20)
    with pytest.raises(ValueError, match="violated gives float32; choose true or false"):
        adapt(world, lambda state, action: jnp.abs(action).max(), horizon=20)
    with pytest.raises(ValueError, match="violated reads index 99 of an axis of 6"):
        adapt(world, lambda state, action: state.pipeline_state.q[99] > 0, horizon=20)
    assert not adapt(world, lambda state, action: state.pipeline_state.q[0] > 0, horizon=20).registered
