"""Every key of a mapping is checked when it is loaded, and every label stays the text that it is."""

import pytest

from envs.animals.columns import load_mapping

COLUMNS = "columns: {time: t, individual: goat, behaviour: act, place: spot, group: age, coordinates: [x, y]}\n"


def loaded(tmp_path, text: str):
    (tmp_path / "m.yaml").write_text(text, encoding="utf-8")
    return load_mapping(str(tmp_path / "m.yaml"))


def test_labels_are_texts_whatever_yaml_takes_them_for(tmp_path):
    found = loaded(tmp_path, COLUMNS + "behaviours: [on, off, 01, 1e3, null, 2024-01-01, 'a: b']\n")
    assert found.behaviours == ("on", "off", "01", "1e3", "null", "2024-01-01", "a: b")
    assert loaded(tmp_path, "columns: {time: t, individual: no, behaviour: yes}\n").columns["individual"] == "no"


def test_numbers_and_lists_are_read_as_such(tmp_path):
    found = loaded(tmp_path, COLUMNS + "step: .5\nmap_axes: [1, 0]\nmissing_coordinates: [0, -1e3]\nsite: 'cam(.)'\n")
    assert (found.step, found.map_axes, found.missing_coordinates, found.site) == (0.5, (1, 0), (0.0, -1000.0), "cam(.)")
    assert (found.name, found.recording, found.coordinate_scale) == ("m", "file", 1.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "a mapping needs the key 'columns'; its keys are name, columns"),
        ("- a", "a mapping needs the key 'columns'"),
        ("colums: {}", "unknown key 'colums'; choose from name, columns"),
        ("columns: [time]", r"columns: \['time'\] is no list of names; it needs time, individual, behaviour"),
        ("columns: {time: t, individual: i}", "columns lacks 'behaviour'; it needs time, individual, behaviour"),
        ("columns: {time: t, individual: i, behaviour: b, colour: c}", "unknown key 'colour'; choose from time"),
        (
            "columns: {time: t, individual: t, behaviour: b}",
            "are 't', 't', 'b'; choose three columns",
        ),
        ("columns: {time: , individual: i, behaviour: b}", "columns: time: '' is not a column's name"),
        ("columns: {time: [t], individual: i, behaviour: b}", r"columns: time: \['t'\] is not a column's name"),
        (
            "columns: {time: t, individual: i, behaviour: b, coordinates: }",
            "coordinates: '' is not the name of one column",
        ),
        (
            COLUMNS.replace("[x, y]", "[x, y, z, w]"),
            "coordinates: .* is not the name of .*, or a list of 1 to 3",
        ),
        (COLUMNS.replace("[x, y]", "[x, x]"), "coordinates: .* is not the name of one column"),
        (COLUMNS + "zones: []", "unknown key 'zones'"),
        (COLUMNS + "step: soon", "step: 'soon' is not what this key takes: a number above 0"),
        (COLUMNS + "step: 0", "step: '0' is not what this key takes: a number above 0"),
        (COLUMNS + "step: -1", "step: '-1' is not"),
        (COLUMNS + "step: .nan", "step: '.nan' is not"),
        (COLUMNS + "step: 1e999", "step: '1e999' is not"),
        (COLUMNS + "step:", "step: '' is not"),
        (COLUMNS + "step: [1]", r"step: \['1'\] is not"),
        (COLUMNS + "coordinate_scale: 0", "coordinate_scale: '0' is not what this key takes: a number above 0"),
        (COLUMNS + "behaviours: eat", "behaviours: 'eat' is not what this key takes: a list of labels, each once"),
        (COLUMNS + "behaviours: [eat, eat]", "behaviours: .* is not what this key takes: a list of labels, each once"),
        (COLUMNS + "behaviours: [[eat]]", "behaviours: .* is not"),
        (COLUMNS + "behaviours: [eat, '']", "behaviours: .* is not"),
        (COLUMNS + "site: '(cam'", r"site: '\(cam' is not what this key takes: a regular expression with a group"),
        (COLUMNS + "site: cam", "site: 'cam' is not what this key takes: a regular expression with a group"),
        (COLUMNS + "map_axes: [0, 7]", r"map_axes: \['0', '7'\] is not what this key takes: a list of two different numbers"),
        (COLUMNS + "map_axes: [1, 1]", "map_axes: .* is not"),
        (COLUMNS + "map_axes: [0, 2]", r"map_axes: \[0, 2\]; the coordinates are numbered 0 to 1"),
        (COLUMNS + "missing_coordinates: [0, 0, 0]", r"missing_coordinates: \[0.0, 0.0, 0.0\] are more than the 2 of columns"),
        (COLUMNS + "missing_coordinates: 0", "missing_coordinates: '0' is not what this key takes: a list of 1 to 3 numbers"),
        (COLUMNS + "moving: wlak\nbehaviours: [walk, eat]", "moving: 'wlak' is no behaviour; choose from walk, eat"),
        (COLUMNS.replace("place: spot, ", "") + "moving: walk", "moving: needs the column 'place'; add place to columns"),
        (COLUMNS.replace("group: age, ", "") + "groups: [kid]", "groups: needs the column 'group'"),
        (COLUMNS + "groups: [kid]\nother_groups: [kid]", "other_groups: 'kid' is also in groups; choose one of them"),
        (COLUMNS + "no_behaviour: none", "no_behaviour: 'none' is a label of other_groups; add those, or leave it out"),
        (COLUMNS + "step: 1\nstep: 2", "no YAML: .*the key 'step' comes twice"),
        ("a: [", "no YAML"),
        ("[" * 5000, "no YAML"),
        (COLUMNS + "behaviours: &b [*b]", "no YAML|behaviours: .* is not"),
        ("a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\ncolumns: *c", "unknown key 'a'"),
    ],
)
def test_a_malformed_mapping_is_refused_in_one_line_with_file_key_and_value(tmp_path, text, words):
    with pytest.raises(ValueError, match=words) as caught:
        loaded(tmp_path, text)
    assert str(caught.value).startswith(f"{tmp_path / 'm.yaml'}: ")
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 500


def test_an_unknown_mapping_is_refused_with_those_that_there_are():
    with pytest.raises(ValueError, match="unknown mapping 'cats'; choose from meerkat"):
        load_mapping("cats")
