"""Simulate a mob of meerkats with a known reward and a known constraint. They are invented: no animal was observed.

The simulation replaces the published tables where these are absent, and lets recovery be scored. An animal is in a hidden
place p with a code c (a behaviour, or moving to a place). It draws its next code from the soft-optimal policy of `truth`,
π(c'|p, c) ∝ exp(r(c, c') + γ V(p', c')) over the codes c' that are possible in p and, if constrained, allowed after c.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import logsumexp

from envs.animals.columns import load_mapping
from envs.animals.rows.labels import Labels
from envs.animals.tracks import Tracks

MAPPING = load_mapping("meerkat")
NAMES = MAPPING.behaviours + tuple(f"moving to {place}" for place in MAPPING.places)
NUM_BEHAVIOURS = len(MAPPING.behaviours)

# Centre of each place on an invented map (x, height, z), in units of the published coordinates; a camera sees its own places.
CENTRES = {
    ("C2", "Foraging"): (7e3, 3e4, -13e3),
    ("C2", "Waiting Area"): (12e3, 4.6e4, 6e3),
    ("C2", "Door"): (-24e3, 3.2e4, -2e3),
    ("C2", "Background"): (38e3, 3.9e4, -20e3),
    ("C3", "Sand Area"): (-36e3, 6.5e4, 19e3),
    ("C3", "Around Mound"): (-40e3, 6.3e4, -1e3),
    ("C3", "Mound"): (-18e3, 6.5e4, -30e3),
    ("C3", "Left Sticks Area"): (-52e3, 5.9e4, -14e3),
    ("C3", "Right Sticks Area"): (14e3, 5.8e4, -12e3),
    ("C3", "Right Sand Area"): (60e3, 5.3e4, 10e3),
    ("C3", "Background"): (-10e3, 5e4, -45e3),
}
PLACE_NAMES = tuple(place for _, place in CENTRES)
SITES = tuple(site for site, _ in CENTRES)

DISCOUNT = 0.9
STAY_REWARD = 5.0  # reward of continuing the same code, which gives bouts of about 10 s
SHORT_CUT_REWARD = 0.6  # reward of a forbidden transition, which tempts the animals to violate the constraint
APPEAL = {  # reward of beginning a behaviour; 0 for the others
    "Foraging": 1.2, "Raised Guarding (Vigilant)": 0.8, "Moving": 0.6, "Low sitting/standing (stationary)": 0.8,
    "Dig burrow": 0.4, "High sitting/standing (Vigilant)": 0.4, "Interact with pup": -0.6, "Playfight": -0.6,
    "Interacting with foreign object": -0.8, "Carry pup": -1.0, "Human Interaction": -3.0,
}  # fmt: skip
PLACE_APPEAL = {
    "Foraging": 0.8,
    "Sand Area": 0.6,
    "Mound": 0.4,
    "Door": -1.0,
    "Background": -1.2,
}  # reward of setting out for a place; 0 for the others
ERRANDS = {  # additional reward of a behaviour on arrival at a place
    ("moving to Sand Area", "Dig burrow"): 2.0,
    ("moving to Mound", "Raised Guarding (Vigilant)"): 2.0,
    ("moving to Foraging", "Foraging"): 2.0,
    ("moving to Waiting Area", "Low sitting/standing (stationary)"): 2.0,
    ("moving to Around Mound", "Interact with pup"): 2.0,
    ("moving to Right Sand Area", "Sunbathe"): 2.0,
}
RESTING = ("Lying/resting (stationary)", "Sunbathe", "Groom", "Allogroom")
SETTING_OUT = ("Foraging", "Dig burrow", "Raised Guarding (Vigilant)", "Moving", *NAMES[NUM_BEHAVIOURS:])
FORBIDDEN = {  # code → the codes that may not follow at once
    **dict.fromkeys(RESTING, SETTING_OUT),  # a resting animal sits up first
    "Raised Guarding (Vigilant)": (*RESTING, "Playfight"),  # a sentinel comes down first
    "Carry pup": ("Foraging", "Dig burrow", "Raised Guarding (Vigilant)", "Playfight"),  # the pup is put down first
    "Dig burrow": RESTING,
}

RECORDINGS = {"C2": 4, "C3": 4}
RECORDING_SECONDS = 480
TRACKS_PER_RECORDING = 8
PUP_SHARE = 0.1
MISSING_SHARE = 0.01  # share of rows without a position
SPEED = 0.35  # share of the way to the aim covered in a second of moving; 0.05 in any other behaviour
WOBBLE = 600.0  # standard deviation of a position's noise, units of the map
CLOSE, DISTANT = 1e4, 3e4  # radii of neighbourhood, units of the map


class Truth(NamedTuple):
    """The simulated meerkats' reward, constraint and impossible pairs, [from code, to code]."""

    reward: Float[np.ndarray, "C C"]
    forbidden: Bool[np.ndarray, "C C"]  # the constraint
    structural: Bool[np.ndarray, "C C"]  # pairs that cannot occur: two cameras, or two moves in one


def truth() -> Truth:
    """Build the simulated meerkats' reward, their constraint, and the pairs that cameras and coding make impossible."""
    index = {name: code for code, name in enumerate(NAMES)}
    appeal = np.array([APPEAL.get(name, 0.0) for name in MAPPING.behaviours])
    there = np.array([PLACE_APPEAL.get(place, 0.0) - 0.8 for place in MAPPING.places])
    reward = np.tile(np.concatenate([appeal, there]), (len(NAMES), 1))
    np.fill_diagonal(reward, STAY_REWARD)
    for (source, target), bonus in ERRANDS.items():
        reward[index[source], index[target]] += bonus
    forbidden = np.zeros(reward.shape, dtype=bool)
    for source, targets in FORBIDDEN.items():
        forbidden[index[source], [index[target] for target in targets]] = True
    structural = np.logical_not(_possible().any(axis=0))
    return Truth(np.where(forbidden, SHORT_CUT_REWARD, reward), forbidden, structural)


def _destination() -> Int[np.ndarray, "P C"]:
    """Return the hidden place after code c, begun in place p; −1 where p's camera does not see that place."""
    keys = list(CENTRES)
    moved = [[keys.index((site, name)) if (site, name) in CENTRES else -1 for name in MAPPING.places] for site in SITES]
    stayed = np.tile(np.arange(len(SITES))[:, None], (1, NUM_BEHAVIOURS))
    return np.concatenate([stayed, np.array(moved)], axis=1)


def _possible() -> Bool[np.ndarray, "P C C"]:
    """Mark which code can follow which in each hidden place; any code can continue."""
    codes = np.arange(len(NAMES))
    moves = (codes >= NUM_BEHAVIOURS) | (codes == NAMES.index(MAPPING.moving))
    destination = _destination()
    nowhere = (destination < 0) | ((destination == np.arange(len(SITES))[:, None]) & (codes >= NUM_BEHAVIOURS))
    two_moves = np.outer(moves, moves)  # would be one bout
    return (~two_moves & ~nowhere[:, None, :] & ~nowhere[:, :, None]) | np.eye(len(NAMES), dtype=bool)


def _policy(world: Truth, constrained: bool) -> Float[np.ndarray, "P C C"]:
    """Compute π(c'|p, c) of the soft-optimal animal by value iteration."""
    possible = _possible() & ~(world.forbidden & constrained)
    after = np.maximum(_destination(), 0)
    stays = np.eye(len(NAMES), dtype=bool)

    def action_value(value: Float[np.ndarray, "P C"]) -> Float[np.ndarray, "P C C"]:
        onward = np.where(stays, value[:, :, None], value[after])  # V(p', c'): the place changes when the code does
        return np.where(possible, world.reward + DISCOUNT * onward, -np.inf)

    value = np.zeros((len(SITES), len(NAMES)))
    for _ in range(200):  # 0.9^200 < 1e-9
        value = np.asarray(logsumexp(action_value(value), axis=2))
    return np.exp(action_value(value) - value[:, :, None])


def _walk(
    policy: Float[np.ndarray, "P C C"], place: Int[np.ndarray, " N"], steps: int, generator: np.random.Generator
) -> tuple[Int[np.ndarray, "N T"], Int[np.ndarray, "N T"]]:
    """Draw hidden places and codes of N independent animals that begin foraging in the given places."""
    cumulative, after = np.cumsum(policy, axis=2), _destination()
    code = np.zeros(len(place), dtype=np.int64)
    places, codes = [place], [code]
    for _ in range(steps - 1):
        draw = generator.random(len(place)) * cumulative[place, code, -1]
        following = (cumulative[place, code] <= draw[:, None]).sum(axis=1)
        place, code = np.where(following == code, place, after[place, code]), following
        places.append(place)
        codes.append(code)
    return np.stack(places, axis=1), np.stack(codes, axis=1)


def _positions(
    places: Int[np.ndarray, "N T"], codes: Int[np.ndarray, "N T"], generator: np.random.Generator
) -> Float[np.ndarray, "N T 3"]:
    """Draw positions that lag behind the centre of the place where an animal is or to which it moves."""
    centre, after = np.array(list(CENTRES.values())), _destination()
    aim = centre[after[places, codes]]
    rate = np.where(codes >= NUM_BEHAVIOURS, SPEED, 0.05)[:, :, None]
    noise = generator.normal(scale=WOBBLE, size=aim.shape)
    position = np.empty_like(aim)
    position[:, 0] = centre[places[:, 0]] + 8 * noise[:, 0]
    for t in range(1, aim.shape[1]):
        position[:, t] = position[:, t - 1] + rate[:, t] * (aim[:, t] - position[:, t - 1]) + noise[:, t]
    return position


def simulated_tracks(seed: int = 0, constrained: bool = True) -> Tracks:
    """Simulate rows as read from tables: four recordings for each camera, a tenth of the animals pups."""
    generator = np.random.default_rng(seed)
    policy = _policy(truth(), constrained)
    parts = []
    for site, recordings in RECORDINGS.items():
        home = [place for place, name in enumerate(SITES) if name == site]
        for number in range(recordings):
            start = generator.choice(home, size=TRACKS_PER_RECORDING)
            parts.append(_recording(f"simulated_{site}_{number:02d}", site, policy, start, generator))
    return Tracks.joined(parts)


def _recording(
    name: str,
    site: str,
    policy: Float[np.ndarray, "P C C"],
    start: Int[np.ndarray, " N"],
    generator: np.random.Generator,
) -> Tracks:
    size, steps = len(start), RECORDING_SECONDS
    places, codes = _walk(policy, start, steps, generator)
    position = _positions(places, codes, generator)
    apart = np.linalg.norm(position[:, None] - position[None], axis=-1) + np.where(np.eye(size)[:, :, None], np.inf, 0.0)
    position[generator.random((size, steps)) < MISSING_SHARE] = np.nan
    pup = generator.random((size, 1)) < PUP_SHARE
    labels = np.array([*MAPPING.behaviours, *[MAPPING.moving] * len(MAPPING.places)])
    behaviour = np.where(pup, MAPPING.no_behaviour, labels[codes])
    close = (apart < CLOSE).sum(axis=0)
    return Tracks(
        recording=Labels.same(name, size * steps),
        site=Labels.same(site, size * steps),
        individual=Labels.of(np.repeat(np.arange(size).astype(str), steps)),
        group=Labels.of(np.repeat(np.where(pup, MAPPING.other_groups[0], MAPPING.groups[0]), steps)),
        time=np.tile(np.arange(steps, dtype=np.float64), size),
        behaviour=Labels.of(behaviour.ravel()),
        place=Labels.of(np.array(PLACE_NAMES)[places].ravel()),
        position=position.reshape(-1, 3),
        close=close.ravel(),
        distant=((apart < DISTANT).sum(axis=0) - close).ravel(),
    )
