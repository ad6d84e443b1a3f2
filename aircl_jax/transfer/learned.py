"""Measure and map what a run has learned apart from its policy: by the swap test on a grid, by limits, by activities."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from aircl_jax.analysis.activities import maps_of_activities
from aircl_jax.analysis.recovered_limits import measures_of_limits
from aircl_jax.model.networks import Networks
from aircl_jax.runs.result import Result
from aircl_jax.runs.spec import RunSpec
from aircl_jax.transfer.grid import maps_of_a_grid, of_a_grid
from aircl_jax.types import TrainState


def measures_of_learned(spec: RunSpec, networks: Networks, states: TrainState) -> Mapping[str, np.ndarray]:
    """{measure: [S]} of the swap test on a grid, and of the limits of a row that has any."""
    return {**of_a_grid(spec, networks, states), **measures_of_limits(networks, states)}


def maps_of_learned(result: Result) -> Mapping[str, Any]:
    """Collect the arrays of recovered.npz; none where the world has no such maps."""
    spec = result.spec
    if spec.method.is_fitted:
        return maps_of_activities(spec.env.view, result.states)
    return maps_of_a_grid(spec, result.networks, result.states, result.expert)
