"""What a run is made of: its settings are enough to make it again, or it says that they are not."""

from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import envs
from aircl_jax import METHODS, train
from aircl_jax.runs.spec import make_spec, read_spec
from aircl_jax.settings.env_defaults import default_config
from aircl_jax.settings.train_config import PPOConfig, TrainConfig
from envs import make_env
from envs.robots.factors import SwimmerBody, SwimmerMotors
from envs.settings import at_least
from tests.finished_runs import untrained

GIVEN = {"contrast_prior": "method", "seeds": 1, "first_seed": 0, "iterations": 2, "demonstrations": "default"}
SIMULATED = {"data": "simulated"}


@pytest.mark.parametrize(("env", "settings"), [("gridworld", {"slip": 0.1}), ("meerkat", SIMULATED), ("labyrinth", SIMULATED)])
def test_a_spec_is_read_from_its_settings(env, settings):
    spec = make_spec(env, "aircl_corrected", env_settings=settings, config={}, **GIVEN)
    assert read_spec(spec.settings).settings == spec.settings


def test_a_changed_body_is_in_the_settings_and_read_from_them():
    shipped = Path(envs.__file__).parent / "demonstrations" / "swimmer_torque.npz"
    given: dict[str, Any] = GIVEN | {"demonstrations": str(shipped)}
    body = {"mass": 1.5, "gears": {"front": -1}}
    spec = make_spec("swimmer", "airl", env_settings={"body": body, "reward": "backwards"}, config={}, **given)
    assert spec.settings["env"]["body"] == {"mass": 1.5, "gear": 1.0, "length": 1.0, "viscosity": 1.0} | {
        "gears": {"front": -1.0, "rear": 1.0}
    }
    assert read_spec(spec.settings).settings == spec.settings
    same = SwimmerBody(mass=1.5, gears=SwimmerMotors(front=-1.0))
    assert make_spec("swimmer", "airl", env_settings={"body": same}, config={}, **given).env_settings["body"]["mass"] == 1.5


def test_settings_of_before_there_were_changed_bodies_make_the_same_world():
    today = make_spec("swimmer", "airl", env_settings={}, config={}, **GIVEN).settings
    new = ("reward", "target", "action_cost", "body")
    before = today | {"env": {name: value for name, value in today["env"].items() if name not in new}}
    assert read_spec(before).settings == today


def test_recorded_demonstrations_that_have_changed_are_noticed():
    spec = make_spec("labyrinth", "bc", env_settings=SIMULATED, config={}, **GIVEN)
    part = make_spec("labyrinth", "bc", env_settings=SIMULATED | {"split": "train"}, config={}, **GIVEN)
    assert spec.settings["demonstrations"] != part.settings["demonstrations"]
    with pytest.raises(ValueError, match="demonstrations=default is not what the run had: the content has changed"):
        read_spec(spec.settings | {"demonstrations": part.settings["demonstrations"]})


def test_an_environment_of_ones_own_is_no_named_one():
    env = make_env("gridworld", slip=0.3)
    spec = make_spec(env, "airl", env_settings={}, config={}, **GIVEN)
    assert spec.settings["env"] == {"name": "gridworld", "own": True}
    with pytest.raises(ValueError, match="env=gridworld was given as an Env, which a run does not keep"):
        read_spec(spec.settings)
    with pytest.raises(ValueError, match="env_settings are given beside the Env gridworld"):
        make_spec(env, "airl", env_settings={"slip": 0.1}, config={}, **GIVEN)


def test_a_feasibility_of_actions_alone_is_refused_before_a_wall():
    for method, refused in (("aircl_corrected", True), ("airl_centred", False), ("aircl", False)):
        asked = {"env_settings": {"constraint": "position"}, "config": {}, **GIVEN}
        if refused:
            with pytest.raises(ValueError, match="constraint_input=action: the constraint of env=walker reads states alone"):
                make_spec("walker", method, **asked)
            asked["config"] = {"constraint_input": "env"}
        assert make_spec("walker", method, **asked).env.constraint_input == "state"


def test_a_simulated_world_has_the_settings_of_its_kind():
    spec = make_spec(make_env("meerkat", **SIMULATED), "aircl_corrected", env_settings={}, config={}, **GIVEN)
    assert spec.config.clone_epochs == default_config("meerkat", "tuned").clone_epochs > TrainConfig().clone_epochs


@pytest.mark.parametrize("method", ["bc", "gacl"])
def test_a_method_without_a_learned_reward_has_none_to_ask_for(method):
    result = untrained(method)
    with pytest.raises(ValueError, match=f"method={method} learns no reward"):
        result.reward(jnp.zeros(result.spec.env.obs_size), jnp.asarray(0))


@pytest.mark.parametrize(
    ("config", "words"),
    [
        (TrainConfig(temperature=float("nan")), "train.temperature=nan is not finite"),
        (TrainConfig(temperature=-1.0), "train.temperature=-1.0 is negative"),
        (TrainConfig(iterations=0), "train.iterations=0 is not an integer of at least 1"),
        (TrainConfig(ppo=PPOConfig(log_std_max=-2.0)), "train.ppo.log_std_init=-0.7 is not between"),
    ],
)
def test_a_configuration_that_cannot_work_is_refused(config, words):
    with pytest.raises(ValueError, match=words):
        make_spec("gridworld", "airl", env_settings={}, config=config, **{**GIVEN, "iterations": "default"})


def test_scalars_of_numpy_and_jax_are_the_numbers_that_they_hold():
    plain = make_spec("gridworld", "airl", env_settings={"slip": 0.5, "start": (1, 0)}, config={"hidden": (8, 8)}, **GIVEN)
    settings = {"slip": np.float64(0.5), "start": np.array([1, 0])}
    spec = make_spec("gridworld", "airl", env_settings=settings, config={"hidden": [jnp.asarray(8), np.int32(8)]}, **GIVEN)
    assert spec.settings == plain.settings
    for one in (np.int64(1), np.uint8(1), jnp.asarray(1)):
        assert type(at_least("seeds", one, 1)) is int
    with pytest.raises(ValueError, match=r"seeds=1\.5 is not an integer"):
        at_least("seeds", np.float64(1.5), 1)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"terms": ("contrast", "decay")},
            "method=mine: unknown term 'decay'; choose from discriminator, feasibility_gradient",
        ),
        ({"feasibility": "steps"}, "method=mine: feasibility='steps'; choose from none, step, sequence, step_sequence"),
    ],
)
def test_a_row_with_an_unknown_term_or_choice_is_refused_before_anything_runs(changes, words, monkeypatch):
    row = copy(METHODS["airl"])
    for name, value in changes.items():  # which the tests' type checker does not see
        object.__setattr__(row, name, value)
    monkeypatch.setitem(METHODS, "mine", row)
    with pytest.raises(ValueError, match=words):
        make_spec("gridworld", "mine", env_settings={}, config={}, **GIVEN)


def test_a_world_of_ones_own_runs_with_the_defaults_whatever_it_is_called():
    own = replace(make_env("gridworld"), name="walker", registered=False)
    assert make_spec(own, "aircl_corrected", env_settings={}, config={}, **GIVEN).config == TrainConfig(iterations=2)


def test_double_precision_is_refused():
    with jax.enable_x64(True), pytest.raises(ValueError, match="JAX_ENABLE_X64=1 is set, and runs are of single precision"):
        train("gridworld", "airl")
