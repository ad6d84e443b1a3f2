"""Figure 2 on thirty-nine transitions that are counted by hand: histograms, tests, words, arrows and what is drawn."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.container import BarContainer
from matplotlib.patches import Rectangle
from matplotlib.text import Annotation

from aircl_jax.analysis.transition_distances import RiseTest
from aircl_jax.figures.animals import ground_maps
from aircl_jax.figures.animals import transitions as plots_animals
from aircl_jax.figures.style import LARGER
from envs.animals.columns import ColumnMapping
from envs.animals.rows.labels import Labels
from envs.animals.tracks import Tracks
from envs.animals.windows import Coded, Transitions
from experiments.figure2 import __main__ as figure2
from experiments.figure2.analysis import Numbers, Settings, Study, analyse
from experiments.figure2.report import code_table, long_pairs, report, rise_table, verdict

NAMES = ("rest", "dig", "run")
SETTINGS = Settings(draws=20, out="")
MAPPING = ColumnMapping(
    "made up", {}, missing_coordinates=(30.0, 40.0), coordinate_scale=10.0, coordinate_unit="metres", map_axes=(0, 2)
)


def moves() -> Transitions:
    """From the origin: 20 of 0.5, 10 of 1.5 and 5 of 2.5 along x, 1 of 15 along z; 3 whose end is missing, at (3, 4, 0)."""
    distance = np.repeat([0.5, 1.5, 2.5, 15.0, np.nan], [20, 10, 5, 1, 3])
    end = np.zeros((39, 3))
    end[:, 0] = distance
    end[35] = [0.0, 0.0, 15.0]
    end[36:] = np.nan
    source, target = np.repeat([0, 0, 1, 1, 2], [20, 10, 5, 1, 3]), np.repeat([1, 2, 2, 0, 0], [20, 10, 5, 1, 3])
    recording = np.resize(np.array(["a", "b"]), 39)
    site = np.where(np.arange(39) < 36, "north", "south")
    return Transitions(source, target, np.zeros((39, 3)), end, recording, site)


def study() -> Study:
    rows = 8
    position = np.arange(24.0).reshape(rows, 3)
    position[2] = np.nan
    empty, number = Labels.same("", rows), np.zeros(rows, np.int64)
    site = Labels.of(["north"] * 5 + ["south"] * 3)
    tracks = Tracks(empty, site, empty, empty, np.arange(8.0), empty, empty, position, number, number)
    place, code = np.array([0, 0, 0, 1, 1, 1, 1, 1]), np.array([0, 0, 0, 0, 0, 1, 1, 2])
    coded = Coded(tracks, number, code, place, NAMES, ("burrow", "field"))
    return Study(MAPPING, coded, moves(), ("read: 2 tables (a.csv, b.csv)",), simulated=False)


@pytest.fixture(scope="module")
def numbers() -> Numbers:
    return analyse(study(), SETTINGS)


def test_the_histograms_are_with_and_without_what_stands_at_the_missing_coordinates(numbers):
    assert numbers.without.counts.tolist() == [20, 10, 5, *[0] * 11, 1]
    assert numbers.with_missing.counts.tolist() == [20, 10, 5, 0, 0, 3, *[0] * 8, 1]  # 30, 40 and 0, in tens: 5 away
    assert numbers.without.edges.tolist() == list(range(16))


def test_the_tests_are_of_half_the_bins_the_figures_and_twice_them(numbers):
    assert [test.bin_width for test in numbers.rises["without"]] == [0.5, 1.0, 2.0]
    rise = numbers.rises["without"][1]
    assert (rise.counts, rise.low, rise.high, rise.z) == ((0, 1), 3.5, 14.5, 1.0)
    rise = numbers.rises["with_missing"][1]
    assert (rise.counts, rise.low, rise.high) == ((0, 3), 3.5, 5.5)
    assert rise.z == pytest.approx(3**0.5)


def test_the_tail_begins_at_nine_bins_and_long_is_the_95th_percentile(numbers):
    assert (numbers.tail.low, numbers.tail.high, numbers.tail.observed) == (2.0, 9.0, 1)
    assert numbers.long_distance == 2.5  # of 36: the 34th and 35th


def test_a_pair_counts_all_its_transitions_and_measures_those_that_are_located(numbers):
    assert numbers.pairs.seen.tolist() == [[0, 20, 10], [1, 0, 5], [3, 0, 0]]
    assert numbers.pairs.located[2, 0] == 0
    assert numbers.pairs.mean_distance[1, 2] == 2.5


def test_the_arrows_of_a_pair_go_from_its_starts_to_its_ends_on_the_ground(numbers):
    given = study()._replace(moves=moves()._replace(start=np.full((39, 3), 7.0)))
    found = figure2.arrows(given, numbers, 0, 2)
    assert found.start.tolist() == [[7.0, 7.0]] * 10
    assert found.end.tolist() == [[1.5, 0.0]] * 10  # x and z
    assert found.title == "rest → run\n33 % of its transitions, mean distance 1.5, n = 10"
    sites = np.where(np.arange(39) < 23, "north", "south")
    assert figure2.arrows(given._replace(moves=given.moves._replace(site=sites)), numbers, 0, 2).site == "south"  # 7 of 10


def test_the_ground_has_each_cameras_located_rows_on_its_two_coordinates():
    ground = figure2.ground_of(study())
    assert ground.cameras["north"].position.tolist() == [[0, 2], [3, 5], [9, 11], [12, 14]]
    assert ground.cameras["north"].place.tolist() == [0, 0, 1, 1]
    assert ground.cameras["south"].position.tolist() == [[15, 17], [18, 20], [21, 23]]


def test_a_note_is_the_largest_rise_in_the_figures_bins(numbers):
    first = figure2.note(numbers, "with_missing").splitlines()[0]
    assert first == "largest rise: 0 to 3 transitions, at 3.5 to 5.5"


def made_up(numbers: Numbers, **changes: Any) -> Numbers:
    """With tests of known results."""
    rise = RiseTest(1.0, 3.5, 5.5, (2, 9), 2.11, 0.2, 0.875)
    rises = {"without": [rise] * 3, "with_missing": [rise._replace(p_monotone=0.01, counts=(1, 7))] * 3}
    tail = numbers.tail._replace(observed=12, expected=4.25, ratio_band=(1.5, 4.0))
    return numbers._replace(rises=rises, tail=tail)._replace(**changes)


def test_the_words_say_what_the_tests_of_located_transitions_support(numbers):
    text = " ".join(verdict(study(), made_up(numbers)).split())
    assert "of the 36 transitions with both positions known **does not support** an inflexion" in text
    assert (
        "from 2 transitions at 3.5 to 9 at 5.5 (z = 2.1), and a trend that only falls gives as large a one with p = 0.200"
        in text
    )
    assert (
        "With the 3 transitions whose position is missing counted at (3, 4, 0): the largest rise is from 1 transitions" in text
    )
    assert (
        "12 transitions at 9 or more" in text and "to expect 4.2 (ratio, 95 % over resampled recordings: 1.50 to 4.00)" in text
    )
    low = [test._replace(p_monotone=0.04) for test in made_up(numbers).rises["without"]]
    assert "**supports** an inflexion" in verdict(study(), made_up(numbers, rises={"without": low, "with_missing": low}))


@pytest.mark.parametrize(
    ("band", "words"),
    [((1.5, 4.0), "heavier than exp"), ((0.5, 4.0), "not distinguishable from exp"), ((0.2, 0.9), "lighter than exp")],
)
def test_a_tail_is_heavier_or_lighter_where_the_whole_band_is(band, words, numbers):
    assert words in verdict(study(), made_up(numbers, tail=numbers.tail._replace(ratio_band=band)))


def test_long_transitions_are_rarer_where_the_null_model_has_more_of_them(numbers):
    null = np.zeros(15)
    null[[8, 9, 14]] = 100, 3, 4  # the tail begins at 9
    given = made_up(numbers, without=numbers.without._replace(shuffled=null))
    assert "has 7 transitions there: long transitions are more frequent" in verdict(study(), given)
    few = given._replace(tail=given.tail._replace(observed=6))
    assert "has 7 transitions there: long transitions are rarer" in verdict(study(), few)


def test_the_table_of_rises_has_a_row_for_each_bin_and_way_of_counting(numbers):
    rows = rise_table(made_up(numbers)).splitlines()[2:8]
    assert rows[0] == "| counted as (3, 4, 0) | 1 | 1 at 3.5 → 7 at 5.5 | 2.11 | 0.010 | 88 % |"
    assert rows[3] == "| left out | 1 | 2 at 3.5 → 9 at 5.5 | 2.11 | 0.200 | 88 % |"


def test_the_long_pairs_and_the_codes_are_tabled_by_name(numbers):
    text = long_pairs(study(), numbers._replace(long_pairs=[(0, 2)]))
    assert text.splitlines()[-1] == "| rest | run | 10 | 33 % | 1.5 |"
    assert "distance beyond 2.5. 95 %" in text
    assert code_table(study()).splitlines()[2:] == ["| 0 | rest | 5 |", "| 1 | dig | 2 |", "| 2 | run | 1 |"]


def test_what_was_read_is_told_in_the_loaders_words(numbers):
    assert "## What was read\n\n- read: 2 tables (a.csv, b.csv)\n" in report(study(), numbers, "c")


def test_only_simulated_animals_are_called_simulated(numbers):
    assert "SIMULATED" not in report(study(), numbers, "c")
    assert "SIMULATED" in report(study()._replace(simulated=True), numbers, "c").splitlines()[0]


@pytest.fixture(scope="module")
def figures(numbers) -> dict[str, Any]:
    kept = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plots_animals, "save", lambda figure, path: kept.update({Path(path).stem: figure}))
        figure2.draw(study(), SETTINGS, numbers._replace(long_pairs=[(0, 2)]))
    return kept


def bars(axis: Axes) -> list[float]:
    (found,) = [one for one in axis.containers if isinstance(one, BarContainer)]
    return [bar.get_height() for bar in found]


def test_a_panel_of_distances_has_its_own_counts_trend_and_cumulative_shares(figures, numbers):
    filled, kept, below, last = figures["figure2c_distances"].axes
    assert (filled.get_title(), kept.get_title()) == (
        *("missing coordinates counted as (3, 4, 0)", "missing coordinates left out"),
    )
    assert bars(filled) == numbers.with_missing.counts.tolist()
    assert bars(kept) == numbers.without.counts.tolist()
    by_label = {str(line.get_label()): np.asarray(line.get_ydata()) for line in kept.lines}
    np.testing.assert_allclose(by_label["smoothed trend"], numbers.without.trend)
    np.testing.assert_allclose(by_label["null: ends shuffled"], numbers.without.shuffled)
    np.testing.assert_allclose(last.lines[0].get_ydata()[:4], [0, 20 / 36, 30 / 36, 35 / 36])
    np.testing.assert_allclose(below.lines[0].get_ydata()[-1], 1.0)


def test_the_maps_of_pairs_go_from_row_to_column_with_the_long_ones_boxed(figures):
    distance, share = (figures[name].axes[0] for name in ("figure2d_mean_distance", "figure2e_frequency"))
    assert np.ma.filled(distance.images[0].get_array(), -1)[1].tolist() == [15.0, -1, 2.5]
    np.testing.assert_allclose(np.ma.filled(share.images[0].get_array(), -1)[0], [-1, 2 / 3, 1 / 3])
    for axis in (distance, share):
        assert [patch.get_xy() for patch in axis.patches if isinstance(patch, Rectangle)] == [(1.5, -0.5)]  # to run, from rest


def test_the_codes_have_their_share_of_the_rows(figures):
    written = [text.get_text() for text in figures["figure2g_codes"].axes[0].texts]
    assert written == ["0  rest", "62.50 %", "1  dig", "25.00 %", "2  run", "12.50 %"]


def test_the_arrows_of_figure_2f_are_drawn_from_start_to_end(figures):
    axis = figures["figure2f_long_transitions"].axes[0]
    arrows = [text for text in axis.texts if isinstance(text, Annotation)]
    assert {(tuple(one.xyann), tuple(one.xy)) for one in arrows} == {((0.0, 0.0), (1.5, 0.0))}
    assert len(arrows) == 10


def test_places_are_drawn_with_the_far_side_up_and_named_by_their_colours():
    rows = ground_maps.Rows(np.array([[0.5, 0.5], [0.5, 1.5], [1.5, 0.5]]), np.array([0, 1, 2]))
    ground = ground_maps.Ground({"north": rows}, "metres")
    with mpl.rc_context(LARGER):
        figure = ground_maps.place_map(ground, ("burrow", "field", "track"), 1.0, points=False, simulated=False)
    image = figure.axes[0].images[0]
    assert np.asarray(image.get_array())[:, 0].tolist() == [0, 1]  # from below: 0 at y of 0.5, 1 at 1.5
    assert image.origin == "lower"
    named = [text.get_text() for text in figure.legends[0].get_texts()]
    colours = [tuple(patch.get_facecolor()) for patch in figure.legends[0].get_patches()]
    assert named == ["burrow", "field", "track"]
    assert colours == list(map(tuple, np.asarray(image.cmap(image.norm(np.arange(3))))))
