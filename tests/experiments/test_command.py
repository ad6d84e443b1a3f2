"""Exit codes of every command: done, a fault, bad input, the disk, a signal; each of them in one line."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from aircl_jax.runs.stopping import Terminated
from aircl_jax.storage import DiskError
from experiments.cli.command import run_command


@dataclass(frozen=True)
class Settings:
    size: int = 3


def test_a_task_has_the_settings_and_the_words_and_ends_with_0():
    seen = []
    assert run_command(lambda settings, words: seen.append((settings, words)), ["size=5"], Settings(), None) == 0
    assert seen == [(Settings(5), ["size=5"])]


def test_the_words_are_the_command_lines_where_none_are_passed(monkeypatch):
    monkeypatch.setattr("sys.argv", ["command", "size=7"])
    assert run_command(lambda settings, _: settings.size, None, Settings(), None) == 7


@pytest.mark.parametrize(("words", "said"), [(["size=many"], "size=many is not an integer"), (["length=1"], "unknown setting")])
def test_a_wrong_setting_is_one_line_and_2_and_nothing_is_done(words, said, capsys):
    assert run_command(lambda *_: pytest.fail("it was run"), words, Settings(), None) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("error: ") and said in printed.err
    assert printed.err.count("\n") == 1 and printed.out == ""


@dataclass(frozen=True)
class Words:
    number: int = 3
    share: float = 0.5
    name: str = "a"
    on: bool = False
    sizes: tuple[int, ...] = ()


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("number=010", 10),
        ("number=-2", -2),
        ("share=1e-3", 0.001),
        ("share=2", 2.0),
        ("name=2024-01-01", "2024-01-01"),
        ("name=no", "no"),
        ("name=[", "["),
        ("on=True", True),
        ("sizes=[3, 4]", (3, 4)),
    ],
)
def test_a_word_is_read_as_it_is_written(word, value):
    seen = []
    assert run_command(lambda settings, _: seen.append(settings), [word], Words(), None) == 0
    assert getattr(seen[0], word.partition("=")[0]) == value


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("number=1:30", "number=1:30 is not an integer"),
        ("number=0x10", "number=0x10 is not an integer"),
        ("number=1_0", "number=1_0 is not an integer"),
        ("on=yes", "on=yes is not true or false"),
        ("sizes=[", "cannot read 'sizes=['; quote a value with signs in it, as in 'sizes=\"[\"'"),
        ("sizes", "cannot read 'sizes'; write NAME=VALUE"),
    ],
)
def test_a_word_that_yaml_would_read_as_another_is_refused_with_the_cure(word, said, capsys):
    assert run_command(lambda *_: pytest.fail("it was run"), [word], Words(), None) == 2
    assert said in capsys.readouterr().err


def test_what_a_task_refuses_is_one_line_too(capsys):
    def refuse(*_: object) -> None:
        raise ValueError("there is\nno such file")

    assert run_command(refuse, [], Settings(), None) == 2
    assert capsys.readouterr().err == "error: there is no such file\n"


@pytest.mark.parametrize(("then", "said"), [("", "interrupted\n"), ("it goes on", "interrupted; it goes on\n")])
def test_an_interrupt_is_130_and_says_what_to_do(then, said, capsys):
    def cut(*_: object) -> None:
        raise KeyboardInterrupt

    assert run_command(cut, [], Settings(), None, then=then) == 130
    assert capsys.readouterr().err == said


def test_a_fault_of_the_code_is_1_and_one_line_with_the_file_of_its_trace(capsys):
    def fault(*_: object) -> None:
        raise TypeError("a fault\nof two lines")

    assert run_command(fault, [], Settings(), None) == 1
    said = capsys.readouterr().err
    assert said.startswith("error: a fault of this program: TypeError: a fault of two lines; its trace is in ")
    assert said.count("\n") == 1
    trace = Path(said.rpartition(" ")[2].strip())
    assert "raise TypeError" in trace.read_text(encoding="utf-8")
    trace.unlink()


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (DiskError("runs/x cannot be written: full; free some"), 74, "error: runs/x cannot be written: full; free some\n"),
        (OSError(28, "No space left on device", "out/table.md"), 74, "error: out/table.md: No space left on device\n"),
        (OSError(36, "File name too long", "out/aaa"), 2, "error: out/aaa: File name too long\n"),
        (Terminated(15), 143, "ended by SIGTERM; it goes on\n"),
        (Terminated(1), 129, "ended by SIGHUP; it goes on\n"),
    ],
)
def test_disks_and_signals_have_codes_of_their_own(error, code, said, capsys):
    def end(*_: object) -> None:
        raise error

    assert run_command(end, [], Settings(), None, then="it goes on") == code
    assert capsys.readouterr().err == said


def test_help_prints_what_the_command_is_for_and_ends(capsys):
    with pytest.raises(SystemExit) as ended:
        run_command(lambda *_: pytest.fail("it was run"), ["--help"], Settings(), "About it.")
    assert ended.value.code == 0
    assert capsys.readouterr().out == "About it.\n"
