"""Ask whether distance costs: which place an animal sets out for, by the appeal of places and how far they are."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from aircl_jax.animals.features import one_hot
from aircl_jax.animals.going import Choices, Weights, fit_going, log_going
from aircl_jax.animals.held_out import Gain, folds_of, jackknife, over_recordings
from envs.animals.full.steps import NONE, Recordings, possible_changes

FEWEST = 20  # trips below which nothing is fitted
LEAST_ROWS = 5  # located rows of a place, below which its middle is unknown
APPEAL_RIDGE, DISTANCE_RIDGE = 0.5, 0.05


class Trips(NamedTuple):
    """Nats per trip by appeal alone and with a cost of distance, and that cost, per unit of the ground."""

    number: int
    appeal_alone: float
    gain: Gain  # of the cost of distance, on held-out recordings
    cost: float  # negative: farther places are chosen less
    spread: float  # standard error, jackknife over recordings
    unit: str


def study_trips(recordings: Recordings) -> Trips | None:
    """Fit u(place) = appeal(place, camera) + κ distance to moves between places; None where the tables have too few."""
    if {"places", "positions"} & set(recordings.lacks):
        return None
    steps = recordings.steps
    trip = np.flatnonzero((steps.code != steps.following) & (recordings.destination[steps.following] != NONE))
    trip = trip[np.isfinite(steps.position[trip]).all(axis=1)]
    trip = trip[recordings.destination[steps.following[trip]] != steps.place[trip]]
    if len(trip) < FEWEST:
        return None
    recording, folds = steps.recording[trip], folds_of(recordings)
    nats = np.zeros((2, len(trip)))
    for fold in range(int(folds.max()) + 1):
        trained = folds != fold
        here = ~trained[recording]
        for row, with_distance in enumerate((False, True)):
            choices = _choices(recordings, trip, trained, with_distance)
            fitted = fit_going(choices, trained[recording].astype(np.float64))
            nats[row, here] = log_going(choices, fitted)[here]
    everyone = np.ones(len(folds), dtype=bool)
    costs = [_cost(recordings, trip, everyone & (np.arange(len(folds)) != left_out)) for left_out in range(len(folds))]
    return Trips(
        number=len(trip),
        appeal_alone=float(nats[0].mean()),
        gain=over_recordings(nats[1] - nats[0], np.ones(len(trip)), recording),
        cost=_cost(recordings, trip, everyone),
        spread=float(jackknife(np.array(costs))),
        unit=recordings.unit,
    )


def _cost(recordings: Recordings, trip: Int[np.ndarray, " n"], trained: Bool[np.ndarray, " R"]) -> float:
    choices = _choices(recordings, trip, trained, with_distance=True)
    return float(fit_going(choices, trained[recordings.steps.recording[trip]].astype(np.float64)).shared[0])


def _choices(
    recordings: Recordings, trip: Int[np.ndarray, " n"], trained: Bool[np.ndarray, " R"], with_distance: bool
) -> Choices:
    """Describe the trips: the codes of moving to another place in sight, the camera, the distance to each place's middle."""
    steps, size = recordings.steps, len(recordings.names)
    goes = recordings.destination != NONE
    possible = possible_changes(recordings)[trip] & goes & (recordings.destination != steps.place[trip][:, None])
    middle = np.full((len(recordings.sites), max(len(recordings.places), 1), 2), np.nan)
    located = trained[steps.recording] & np.isfinite(steps.position).all(axis=1)
    for site in range(len(recordings.sites)):
        for place in range(len(recordings.places)):
            rows = located & (steps.site == site) & (steps.place == place)
            if rows.sum() > LEAST_ROWS:
                middle[site, place] = np.median(steps.position[rows], axis=0)
    away = middle[steps.site[trip]] - steps.position[trip][:, None]
    distance = np.linalg.norm(away, axis=-1)[:, np.maximum(recordings.destination, 0)]
    unknown = ~np.isfinite(distance)
    distance = np.where(unknown, np.nanmean(distance), distance) * goes
    return Choices(
        change=trip,
        row=np.arange(len(trip)),
        step=trip,
        situation=one_hot(steps.site[trip], len(recordings.sites)),
        field=distance[:, :, None] if with_distance else np.zeros((len(trip), size, 0)),
        returning=np.zeros((len(trip), size)),
        joining=np.zeros((len(trip), size)),
        left=steps.code[trip],
        chosen=steps.following[trip],
        possible=possible,
        ridge=Weights(
            np.full((len(recordings.sites), 1), APPEAL_RIDGE),
            np.full(int(with_distance), DISTANCE_RIDGE),
            np.ones(size),
            np.ones(size),
        ),
        situations=recordings.sites,
        fields=("distance",) if with_distance else (),
    )
