"""The yardstick of the pendulum's expert."""

import pytest

from envs import make_env
from experiments import pendulum_lqr


def test_the_regulator_balances_where_it_is_told_to():
    still = make_env("pendulum", noise=0.0)
    gain = pendulum_lqr.regulator(still)
    settings = pendulum_lqr.Settings(noise=0.0, std=0.0, episodes=8)
    near, safe = (pendulum_lqr.balance(still, gain, place, settings) for place in (-0.012, 0.0))
    assert (near[0] > 70).all()  # 1 a step once it stands there
    assert (safe[0] < 30).all()


def test_a_wrong_setting_is_one_line(capsys: pytest.CaptureFixture[str]):
    assert pendulum_lqr.main(["nose=1"]) == 2
    assert "nose" in capsys.readouterr().err
    assert pendulum_lqr.main(["episodes=0"]) == 2
    assert "episodes=0 is not an integer of at least 1" in capsys.readouterr().err
