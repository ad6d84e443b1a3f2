"""What no Gymnasium world of ours can be is refused in one line."""

import importlib

import pytest

from envs import from_gymnasium, make_env
from tests.envs.simulators.carts import HORIZON, Cart, Named, Restless, Silent, Uneven, fast


@pytest.mark.parametrize(
    ("make", "violated", "message"),
    [
        (Silent, "info", r"Silent gives no info\['cost'\]; choose another constraint"),
        (Restless, fast, "Restless does not follow from its seed and actions alone"),
        (Named, fast, "observations of Named are Dict.*; choose an environment with a Box of one axis of floats"),
        (Uneven, fast, "actions of Uneven have bounds that differ; wrap it in gymnasium.wrappers.RescaleAction"),
        (Cart, lambda obs, action: obs[1], "the constraint of Cart gives float32; choose true or false"),
        (Cart(), fast, "Cart is not registered; pass a function that makes it"),
    ],
)
def test_another_kind_of_world_is_refused_in_one_line(make, violated, message):
    with pytest.raises(ValueError, match=message):
        from_gymnasium(make, violated, HORIZON)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"task": "Pendulum-v99"}, "env.task=Pendulum-v99 of gymnasium cannot be made: "),
        ({"task": "CartPole-v1"}, r"actions of env.task=CartPole-v1 are Discrete\(2\); choose"),
        (
            {"constraint": "coordinate", "coordinate": 3, "limit": 1.0},
            "env.coordinate=3: an observation of env.task=Pendulum-v1 has",
        ),
        ({"constraint": "coordinate"}, "env.limit=default: env.constraint=coordinate has no limit of its own"),
        (
            {"constraint": "speed", "limit": 1.0},
            "unknown constraint 'speed' of Pendulum-v1; choose from none, torque, coordinate",
        ),
        ({"constraint": "info"}, r"gives no info\['cost'\]"),
    ],
)
def test_a_wrong_setting_is_one_line(settings, message):
    with pytest.raises(ValueError, match=message):
        make_env("gymnasium", **settings)


def test_without_gymnasium_one_line_names_the_extra(monkeypatch):
    def absent(name):
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(ValueError, match=r"needs the package gymnasium, which is not installed; install aircl-jax\[gym\]"):
        from_gymnasium(Cart, fast, HORIZON)
