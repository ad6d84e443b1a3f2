"""What differs between systems: encodings, modules that only some have, and names of signals."""

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.tiny_runs import WORDS

ROOT = Path(__file__).parents[1]
FILES = sorted(path for package in ("aircl_jax", "envs", "experiments") for path in (ROOT / package).rglob("*.py"))
POSIX_ALONE = {"fcntl", "grp", "posix", "pty", "pwd", "resource", "syslog", "termios", "tty"}
WINDOWS_ALONE = {"msvcrt", "winreg", "_winapi"}


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def nodes() -> Iterator[tuple[str, ast.AST]]:
    """Every node of every file, with the file's name."""
    for path in FILES:
        yield from ((name_of(path), node) for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


def test_every_text_file_is_read_and_written_in_a_named_encoding():
    for file, node in nodes():
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name not in ("open", "read_text", "write_text", "fdopen") or _of_os(node):
            continue
        modes = [arg.value for arg in node.args if isinstance(arg, ast.Constant) and isinstance(arg.value, str)]
        binary = name in ("open", "fdopen") and any("b" in mode and len(mode) <= 3 for mode in modes)
        assert binary or "encoding" in {keyword.arg for keyword in node.keywords}, f"{file}, line {node.lineno}"


def _of_os(node: ast.Call) -> bool:
    """`open` of these modules, and of an archive's members, opens no text."""
    match node.func:
        case ast.Attribute(value=ast.Attribute(attr="archive"), attr="open"):
            return True
        case ast.Attribute(value=ast.Name(id=module), attr="open"):
            return module in ("os", "tensorstore", "archive")
    return False


def test_no_file_imports_what_one_system_alone_has():
    for file, node in nodes():
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module] if isinstance(node, ast.ImportFrom) and node.module else []
        assert not (POSIX_ALONE | WINDOWS_ALONE).intersection(names), file


# A process as on Windows: without the modules and signals of POSIX, where no folder can be opened.
ELSEWHERE = """
import importlib.abc, importlib.util, os, shutil, signal, sys
absent = set(sys.argv.pop(1).split(","))

class Absent(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name in absent:
            raise ModuleNotFoundError(name)

find = importlib.util.find_spec
importlib.util.find_spec = lambda name, package=None: None if name in absent else find(name, package)
for name in absent:
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Absent())
shutil._use_fd_functions = False
for name in ("SIGHUP", "SIGKILL", "SIGUSR1", "SIGUSR2", "SIGALRM"):
    delattr(signal, name)
for name in ("sched_getaffinity", "geteuid", "getuid", "fork"):
    delattr(os, name)
opened = os.open

def open_files_alone(path, flags, *rest, **names):
    if isinstance(path, (str, os.PathLike)) and os.path.isdir(path):
        raise PermissionError(13, "Permission denied", str(path))
    return opened(path, flags, *rest, **names)

os.open = open_files_alone
from experiments.run import main
sys.exit(main(sys.argv[1:]))
"""


def test_a_run_goes_on_where_the_modules_and_signals_of_posix_are_absent(tmp_path):
    command = [sys.executable, "-c", ELSEWHERE, "fcntl,termios,grp,resource,syslog", *WORDS, "iterations=2"]
    command.append(f"run_dir={tmp_path / 'run'}")
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run" / "report.md").exists()


@pytest.mark.parametrize("name", ["run", "grün δ"])
def test_a_run_where_the_locale_knows_only_ascii(name, tmp_path):
    locale = {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    command = [sys.executable, "-m", "experiments.run", *WORDS, "iterations=2", f"run_dir={tmp_path / name}"]
    done = subprocess.run(command, cwd=ROOT, env=os.environ | locale, capture_output=True, check=False)
    if name.isascii():
        assert (done.returncode, done.stderr) == (0, b"")
        assert "±" in (tmp_path / name / "report.md").read_text(encoding="utf-8")
    else:
        assert done.returncode == 2 and done.stderr.count(b"\n") == 1
        assert b"as ascii, the encoding of this locale; set LC_ALL=C.UTF-8" in done.stderr
