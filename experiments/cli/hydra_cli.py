"""Run a task with Hydra's settings: a mistake prints one line and exits with 2, and Hydra leaves no file."""

import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, cast
from unittest import mock

import hydra
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import ConfigCompositionException, HydraException, MissingConfigException, OverrideParseException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from aircl_jax.defects import described
from aircl_jax.runs.stopping import Terminated
from aircl_jax.settings.renamed import old_name
from experiments.cli import hydra_settings
from experiments.cli.command import BAD_INPUT, DEFECT, DONE, complain, ended, ending
from experiments.cli.jobs import Job, failures, forget, note, notes
from experiments.cli.words import unreadable


class Composed(NamedTuple):
    """The settings of one command line, or of one job of a sweep."""

    env: str  # the choice of env=…
    values: dict[str, Any]  # resolved, groups within groups
    words: tuple[str, ...]  # NAME=VALUE, as they were given


def launch(task: Callable[[Composed], int | None], config_name: str, argv: Sequence[str]) -> int:
    """Compose the settings from `argv`, run the task once or over a sweep, and return the exit code.

    The task may return its own code. A job of a sweep that ends early costs no other job; each one that failed is named, and
    the highest code is returned.
    """
    return ending(lambda: _launched(task, config_name, argv), "the same command with resume=true continues")


def _launched(task: Callable[[Composed], int | None], config_name: str, argv: Sequence[str]) -> int:
    hydra_settings.register(argv)
    codes, ran = [DONE], list[Job]()

    def job(config: DictConfig) -> None:
        codes.append(_noted(task, config))

    try:
        _refuse_unreadable(argv)
        with _arguments(argv) as folder:
            try:
                hydra.main(version_base="1.3", config_path="pkg://experiments.cli.conf", config_name=config_name)(job)()
            finally:
                ran += notes(folder)
    except Terminated:
        raise
    except SystemExit as stop:  # --help, and argparse's own refusals
        return stop.code if isinstance(stop.code, int) else BAD_INPUT
    except (HydraException, OmegaConfBaseException, ValueError) as error:  # a ValueError of Hydra; `job` catches the task's
        return complain(_in_one_line(error, argv, config_name))
    except Exception as error:  # of a launcher that lost a job
        if not ran:
            raise
        codes.append(complain(described(error), DEFECT))
    finally:
        GlobalHydra.instance().clear()
    return max([*codes, *_ended(ran, argv)])


def _noted(task: Callable[[Composed], int | None], config: DictConfig) -> int:
    """Do a job, the only one or one of a sweep, and return its exit code.

    In a sweep the code is noted, because a launcher may do this in another process.
    """
    own = HydraConfig.get()
    words = tuple(own.overrides.task)
    try:
        if own.mode == RunMode.MULTIRUN:
            note(Path(own.sweep.dir), Job(own.job.num, words, None))
        values = cast(dict[str, Any], OmegaConf.to_container(config, resolve=True))
        code = task(Composed(own.runtime.choices["env"], values, words)) or DONE
    except Exception as error:
        code = ended(error)
    if own.mode == RunMode.MULTIRUN:
        note(Path(own.sweep.dir), Job(own.job.num, words, code))
    return code


def _ended(ran: Sequence[Job], argv: Sequence[str]) -> Iterator[int]:
    """Name the jobs of a sweep that failed, and yield the exit codes of all."""
    for line in failures(ran):
        complain(line)
    yield from (DEFECT if job.code is None else job.code for job in ran)
    if not ran and any(arg.startswith("hydra/launcher=") for arg in argv) and not any(arg.startswith("--") for arg in argv):
        yield complain("no job has left a note of its end; choose a hydra.sweep.dir that all machines see", DEFECT)


def _refuse_unreadable(argv: Sequence[str]) -> None:
    """Raise ValueError for a word with bytes that are no letters in the encoding of this locale."""
    for word in argv:
        if any("\ud800" <= letter <= "\udfff" for letter in word):
            encoding = sys.getfilesystemencoding()
            raise ValueError(f"cannot read {word!a} as {encoding}, the encoding of this locale; set LC_ALL=C.UTF-8")


@contextmanager
def _arguments(argv: Sequence[str]) -> Iterator[Path]:
    """Set the command line that Hydra reads; yield the folder for the notes of a sweep, a temporary one if none is named."""
    argv = [_whole(arg) for arg in argv]
    named = [arg.partition("=")[2] for arg in argv if arg.startswith("hydra.sweep.dir=")]
    with tempfile.TemporaryDirectory() as temporary:
        elsewhere, folder = ([], Path(named[-1])) if named else ([f"hydra.sweep.dir={temporary}"], Path(temporary))
        forget(folder)
        # Insert it beside the other NAME=VALUE words, because argparse takes them only in one unbroken row.
        first = next((i for i, arg in enumerate(argv) if "=" in arg and not arg.startswith("-")), len(argv))
        with (
            mock.patch.object(sys, "argv", ["experiments", *argv[:first], *elsewhere, *argv[first:]]),
            mock.patch.dict(os.environ, HYDRA_FULL_ERROR="1"),
        ):
            yield folder


def _whole(word: str) -> str:
    """Quote the comma list of log=…, which Hydra would take for a sweep; a run has all of its loggers."""
    name, _, value = word.partition("=")
    return f'log="{value}"' if name == "log" and "," in value and value[0] not in "\"'[" else word


def _in_one_line(error: Exception, argv: Sequence[str], command: str) -> str:
    if isinstance(error, MissingConfigException) and error.missing_cfg_file and error.options:
        group, _, name = error.missing_cfg_file.rpartition("/")
        return f"unknown {group} {name!r}; choose from {', '.join(hydra_settings.GROUPS.get(group, error.options))}"
    unknown = re.search(r"Could not override '([^']+)'", str(error))
    if isinstance(error, ConfigCompositionException) and unknown:
        key = getattr(error.__cause__, "full_key", None) or unknown.group(1)  # full_key names the unknown member of a group
        if of_before := old_name(key):
            return of_before
        env = next((arg.partition("=")[2] for arg in reversed(argv) if arg.startswith("env=")), hydra_settings.DEFAULT_ENV)
        known = hydra_settings.choices(key.rpartition(".")[0], env, command)
        return f"unknown setting {key}; choose from {', '.join(known)}"
    if isinstance(error, OverrideParseException):
        return unreadable(str(error.override))
    if "Config group override" in str(error):  # a number where a name is needed
        group, name = next((arg.partition("=")[::2] for arg in argv if re.match(r"\w+=-?[\d.]+$", arg)), ("name", ""))
        return f"unknown {group} {name!r}; choose from {', '.join(hydra_settings.GROUPS.get(group, []))}"
    return str(error).splitlines()[0]
