"""Where a run in a directory starts: what is free, what is kept, and what no other process may have touched in between."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aircl_jax.runs import checkpoint
from aircl_jax.runs import directory as runs
from aircl_jax.runs.directory import RunDirectory
from aircl_jax.runs.opening import open_run, open_saved

SETTINGS = {"env": {"name": "gridworld"}, "iterations": 8}


def opened(path: Path, existing: Any = "refuse", **changes) -> RunDirectory:
    return open_run(path, SETTINGS | changes, 2, existing)


def trained(path: Path, iterations: int = 8) -> None:
    """A run of chunks of two iterations, whose state counts them."""
    directory = opened(path)
    with directory.held():
        for end in range(2, iterations + 1, 2):
            rows = [{"at": np.array([end - 1.0, 0.5])}, {"at": np.array([float(end), 0.5])}]
            directory.on_chunk(end, {"count": np.array(end)}, rows, {"iteration": end, "seconds": 1.0, "compile_s": 0.5})


@pytest.mark.parametrize("own", ["figures", "report.md", "state", ".git"])
def test_a_directory_of_ones_own_is_not_free_without_settings_of_a_run(own, tmp_path):
    (tmp_path / own).mkdir()
    for existing in ("refuse", "resume", "overwrite"):
        with pytest.raises(ValueError, match=rf"holds files \({own}, …\) and no config.yaml; choose another directory"):
            opened(tmp_path, existing)
    assert (tmp_path / own).is_dir()


def test_what_a_kill_leaves_before_the_settings_are_written_is_free(tmp_path):
    (tmp_path / ".config.yaml.new").write_text("half")
    assert opened(tmp_path).start == 0


def test_the_newest_two_checkpoints_of_whole_chunks_are_kept(tmp_path):
    trained(tmp_path)
    assert sorted(runs.checkpoints(tmp_path)) == [6, 8]


def test_a_run_that_another_process_finished_in_between_is_not_wiped(tmp_path):
    first = {existing: opened(tmp_path / existing) for existing in ("refuse", "resume", "overwrite")}
    for existing, directory in first.items():
        trained(tmp_path / existing)
        with pytest.raises(ValueError, match="was used by another run just now; give the command again"), directory.held():
            pass
        assert sorted(runs.checkpoints(tmp_path / existing)) == [6, 8]


def test_overwriting_takes_a_link_away_and_not_what_it_leads_to(tmp_path):
    trained(tmp_path / "run")
    (tmp_path / "run" / "state").rename(tmp_path / "elsewhere")
    (tmp_path / "run" / "state").symlink_to(tmp_path / "elsewhere")
    with opened(tmp_path / "run", "overwrite").held():
        assert not (tmp_path / "run" / "state").exists()
    assert (tmp_path / "elsewhere" / "00000008").is_dir()


def test_an_overwrite_that_is_killed_leaves_a_run_that_can_be_begun_again(tmp_path, monkeypatch):
    trained(tmp_path)
    for doomed in ("state", "metrics.jsonl", "timing.jsonl", "figures"):
        removed = []

        def until(entry, doomed=doomed, removed=removed, remove=runs._remove):
            removed.append(entry.name)
            if entry.name == doomed:
                raise KeyboardInterrupt
            remove(entry)

        with (
            monkeypatch.context() as patched,
            pytest.raises(KeyboardInterrupt),
            patched.setattr(runs, "_remove", until) or opened(tmp_path, "overwrite").held(),
        ):
            pass
        assert opened(tmp_path, "resume").settings == SETTINGS


@pytest.mark.parametrize("name", ["a" * 300, "/".join(["deep" * 20] * 60)])
def test_a_name_that_is_too_long_is_refused_in_one_line(name, tmp_path):
    with pytest.raises(ValueError, match=r"^run_dir=.*choose (a shorter name|another directory)$"):
        opened(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_checkpoint_costs_one_chunk_and_a_line(tmp_path, capsys):
    trained(tmp_path)
    file = next(path for path in (tmp_path / "state" / "00000008").rglob("*") if path.is_file())
    file.write_bytes(file.read_bytes()[:-1])
    assert open_saved(tmp_path).start == 6
    resumed = opened(tmp_path, "resume")
    with resumed.held():
        assert resumed.start == 6
        assert int(resumed.load({"count": np.array(0)})["count"]) == 6
        assert len(resumed.history()["at"]) == 6
        assert sorted(runs.checkpoints(tmp_path)) == [6]
    said = capsys.readouterr().err
    assert said == f"warning: the checkpoint {tmp_path}/state/00000008 is damaged or cut short; going on from iteration 6\n"


def test_two_damaged_checkpoints_are_refused_and_nothing_is_lost(tmp_path):
    trained(tmp_path)
    for iteration in ("00000006", "00000008"):
        (tmp_path / "state" / iteration / "checksum.json").write_text("{}")
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    with pytest.raises(ValueError, match=r"00000008 is damaged or cut short; use overwrite=true to start again"):
        opened(tmp_path, "resume")
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before


def test_lost_checkpoints_of_a_finished_run_are_said(tmp_path):
    trained(tmp_path)
    (tmp_path / "summary.json").write_text("{}")
    (tmp_path / "state").rename(tmp_path / "moved")
    with pytest.raises(ValueError, match=r"has lost its checkpoints .* restore them, or use overwrite=true"):
        opened(tmp_path, "resume")


def flip_a_digit(lines: list[str], line: int) -> None:
    lines[line] = lines[line].replace("0.5", "0.6")


def repeat(lines: list[str], line: int) -> None:
    lines.insert(line, lines[line])


def remove(lines: list[str], line: int) -> None:
    del lines[line]


@pytest.mark.parametrize("damage", [flip_a_digit, repeat, remove])
def test_changed_rows_are_noticed_by_their_digest(damage, tmp_path):
    trained(tmp_path)
    written = tmp_path / "metrics.jsonl"
    whole = written.read_text().splitlines(keepends=True)
    for line, start in ((6, 6), (2, None)):  # since the older checkpoint, where it can be made again, and before
        lines = whole.copy()
        damage(lines, line)
        written.write_text("".join(lines))
        if start:
            assert opened(tmp_path, "resume").start == start
        else:
            with pytest.raises(ValueError, match=rf"{written} is (not what was written|cut short of).* 8; use overwrite=true"):
                opened(tmp_path, "resume")


def test_rows_after_the_checkpoint_are_cut_as_a_kill_leaves_them(tmp_path):
    trained(tmp_path)
    with (tmp_path / "metrics.jsonl").open("a") as file:
        file.write('{"at": [9.0, 0.5]}\n{"at": [10.')
    with opened(tmp_path, "resume", iterations=10).held():
        assert len((tmp_path / "metrics.jsonl").read_text().splitlines()) == 8


def test_other_devices_are_said(tmp_path, monkeypatch, capsys):
    trained(tmp_path)
    monkeypatch.setattr("aircl_jax.runs.opening.devices", lambda: "9 × abacus")
    with opened(tmp_path, "resume", iterations=10).held():
        said = capsys.readouterr().err
    assert "goes on on 9 × abacus: its numbers may differ in their last digits" in said and said.count("\n") == 1


def test_a_run_from_before_checkpoints_had_notes_goes_on(tmp_path):
    trained(tmp_path)
    for saved in runs.checkpoints(tmp_path).values():
        (saved / "checksum.json").write_text(json.dumps({"crc32": checkpoint._crc32(saved / "arrays", None)}))
    assert opened(tmp_path, "resume", iterations=10).start == 8


def test_a_directory_that_cannot_be_read_is_refused(tmp_path, monkeypatch):
    trained(tmp_path)

    def denied(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", denied)
    with pytest.raises(ValueError, match="cannot be read: Permission denied; choose another directory"):
        opened(tmp_path, "resume")
