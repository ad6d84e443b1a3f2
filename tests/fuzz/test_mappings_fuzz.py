"""A thousand mappings of odd keys and values: every one that is loaded can be read by, and the others are one line."""

import math
import re

import numpy as np
import pytest

from envs.animals.columns import ColumnMapping, load_mapping
from tests.fuzz.outcomes import Refused, outcome

CASES = 2000
VALUES = (
    *("", "~", "null", "no", "on", "01", "0x10", "1_000", "1:30", "1e3", "1e999", ".nan", "-.inf", "-1", "0", "0.5", "2", "3"),
    *("[]", "[a]", "[a, a]", "[a, b]", "[a, b, c]", "[a, b, c, d]", "[0, 1]", "[0, 7]", "[1, 1]", "[0, 0, 0]", "[[a], b]"),
    *(
        "{}",
        "{a: b}",
        "'a b'",
        '"\\n"',
        "'(cam'",
        "cam",
        "'cam(.)'",
        "'(a)|(b)'",
        "'[a-'",
        "2024-01-01",
        "&x [*x]",
        "!!python/none",
    ),
    *("eat", "walk", "[eat, walk]", "[eat, '']", "[eat, ~]", "[1, 2]", "[on, off]", "t", "goat", "file", "ä", "'\U0001f410'"),
)
KEYS = (
    *("name", "recording", "site", "step", "behaviours", "places", "groups", "other_groups", "no_behaviour", "moving"),
    *("missing_coordinates", "map_axes", "coordinate_scale", "coordinate_unit", "colour", "Step", "columns"),
)
INNER = ("time", "individual", "behaviour", "stop", "place", "coordinates", "group", "close", "distant", "colour")
GOOD = {"time": "t", "individual": "goat", "behaviour": "act", "place": "spot", "coordinates": "[x, y]", "group": "age"}


def text(random: np.random.Generator) -> str:
    inner = {name: value for name, value in GOOD.items() if random.random() < 0.95}
    for _ in range(random.integers(0, 3)):
        inner[str(random.choice(INNER))] = str(random.choice(VALUES))
    lines = [f"columns: {{{', '.join(f'{name}: {value}' for name, value in inner.items())}}}"]
    lines += [f"{random.choice(KEYS)}: {random.choice(VALUES)}" for _ in range(random.integers(0, 4))]
    return "\n".join(lines) + "\n"


def is_sound(mapping: ColumnMapping) -> bool:
    """Whether every field is what the loader of tables takes for granted."""
    names = [name for name in mapping.columns.values() if isinstance(name, str)]
    coordinates = mapping.columns.get("coordinates", "")
    labels = (*mapping.behaviours, *mapping.places, *mapping.groups, *mapping.other_groups)
    return (
        all(isinstance(label, str) and label for label in (*names, *labels))
        and (isinstance(coordinates, str) or 1 <= len(coordinates) <= 3)
        and {"time", "individual", "behaviour"} <= mapping.columns.keys()
        and math.isfinite(mapping.step)
        and mapping.step > 0
        and mapping.coordinate_scale > 0
        and (not mapping.site or re.compile(mapping.site).groups > 0)
        and (not mapping.moving or not mapping.behaviours or mapping.moving in mapping.behaviours)
        and all(math.isfinite(value) for value in mapping.missing_coordinates)
        and set(mapping.map_axes) <= {0, 1, 2}
        and len(set(mapping.map_axes)) == 2
    )


@pytest.mark.slow
def test_an_odd_mapping_is_sound_or_refused_in_one_line(tmp_path):
    file, loaded = tmp_path / "m.yaml", 0
    for case in range(CASES):
        content = text(np.random.default_rng(case))
        file.write_text(content, encoding="utf-8")
        found = outcome(lambda: load_mapping(str(file)))
        loaded += not isinstance(found, Refused)
        assert found.names(f"{file}: ") if isinstance(found, Refused) else is_sound(found), f"case {case}: {content}"
    print(f"{loaded} of {CASES} loaded")
    assert CASES // 10 < loaded < CASES // 2


@pytest.mark.slow
def test_noise_in_a_mapping_is_refused_in_one_line_or_sound(tmp_path):
    file = tmp_path / "m.yaml"
    good = "columns: {time: t, individual: goat, behaviour: act, place: spot}\nstep: 2\nmoving: walk\nbehaviours: [eat, walk]\n"
    for case in range(CASES):
        random, content = np.random.default_rng(case), bytearray(good.encode())
        for _ in range(random.integers(1, 4)):
            at = int(random.integers(len(content)))
            content[at : at + int(random.integers(0, 3))] = random.bytes(int(random.integers(0, 3)))
        file.write_bytes(content)
        found = outcome(lambda: load_mapping(str(file)))
        assert found.names(f"{file}: ") if isinstance(found, Refused) else is_sound(found), case
