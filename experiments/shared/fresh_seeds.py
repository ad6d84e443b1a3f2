"""State which seeds a row of a table is trained on: 0 and on, or fresh ones where settings were chosen after tests on these."""

from aircl_jax.methods import METHODS

ON_GRIDS = 1000  # the contrast rows' settings were chosen on seeds 200 to 203 of the default layout (docs/research.md)
ON_ROBOTS = 110  # on earlier ones settings were chosen (docs/research.md)
LATER = {"swimmer": 140, "walker": 170, "pendulum": 130, "halfcheetah": 130}  # the row changed after reports on earlier ones
GRIDS = ("gridworld", "nonmarkov")


def has_fresh_seeds(method: str) -> bool:
    """Whether the rows of a method have seeds, and settings, that no other rows have."""
    return METHODS[method].settings in ("contrast", "practice")


def first_seed_of(env: str, method: str) -> int:
    """Return the first seed of a row's runs."""
    if not has_fresh_seeds(method):
        return 0
    if env in GRIDS:
        return ON_GRIDS
    return LATER.get(env, ON_ROBOTS)
