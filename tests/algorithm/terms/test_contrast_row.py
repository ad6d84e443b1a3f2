"""What the contrast row refuses, and what it does not read."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.trainer import make_trainer, scheduled
from aircl_jax.methods import METHODS, get_method
from aircl_jax.model.networks import make_networks
from envs import make_env
from tests.worlds import TINY, random_trajectories, table_of, tiny_grid

pytestmark = pytest.mark.usefixtures("double_precision")

ROW = METHODS["aircl_contrast"]
SLIPPING = tiny_grid(slip=0.2, wind=0.1)


@pytest.mark.parametrize(
    ("env", "method", "said"),
    [
        ("swimmer", "aircl_contrast", "env=swimmer is no table of places"),
        ("meerkat", "aircl_contrast", "env=meerkat is no table of places"),
        ("nonmarkov", "aircl_contrast", "choose aircl_contrast_memory"),
    ],
)
def test_worlds_of_which_the_row_cannot_speak_are_refused_in_a_line(env, method, said):
    settings = {"data": "simulated"} if env == "meerkat" else {}
    with pytest.raises(ValueError, match=said) as raised:
        make_trainer(make_env(env, **settings), METHODS[method], TINY)
    assert "\n" not in str(raised.value)


def test_the_potential_waits_as_the_price_of_entries_does_and_its_rate_falls_as_the_others():
    config = replace(TINY, feasibility_delay=2, lr_decay_iterations=4)
    nets = make_networks(SLIPPING, ROW, config)
    for step, share in ((0, 0.0), (1, 0.0), (2, 0.5), (3, 0.25), (4, 0.0)):
        now = scheduled(nets, jnp.asarray(step)).config.adversary
        np.testing.assert_allclose(now.potential_rate, share * config.adversary.potential_rate, rtol=1e-6)
        np.testing.assert_allclose(now.learning_rate, (1 - step / 4) * config.adversary.learning_rate, rtol=1e-6)
    held = scheduled(make_networks(SLIPPING, ROW, replace(config, lr_decay_iterations=0)), jnp.asarray(1)).config.adversary
    assert held.potential_rate == 0.0 and held.learning_rate == config.adversary.learning_rate


def test_the_papers_contrast_prior_is_refused():
    with pytest.raises(ValueError, match="contrast_prior='on': aircl_contrast has no f"):
        get_method("aircl_contrast", "on")
    assert get_method("aircl_contrast", "off") == ROW


def test_what_the_worlds_table_says_of_reward_and_constraint_is_not_read():
    table = table_of(SLIPPING)
    unknown = {name: jnp.full_like(getattr(table, name), jnp.nan) for name in ("reward", "cost", "forbidden", "goal")}
    expert = random_trajectories(SLIPPING, 0, TINY.num_demonstrations)

    def after_a_step(world):
        trainer = make_trainer(replace(SLIPPING, tabular=world), ROW, replace(TINY, feasibility_delay=0))
        return trainer.step(trainer.init(jax.random.key(0), expert), expert)[0].params

    with jax.enable_x64(False):
        expert = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.int32 if leaf.dtype.kind == "i" else jnp.float32), expert)
        known, blind = (jax.jit(partial(after_a_step, world))() for world in (table, table._replace(**unknown)))
    jax.tree.map(np.testing.assert_array_equal, known, blind)
    assert np.any(known.entry_price)
