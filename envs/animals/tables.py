"""Find the tables of a folder and read them as text: CSV files, Parquet files and folders of Parquet parts."""

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int

SUFFIXES = (".csv", ".parquet")
PIECE = 1 << 17  # rows of a Parquet table that are read at once
READ = 1 << 24  # bytes of a file that are read at once
ARCHIVE_LITTER = "__MACOSX"  # what macOS puts into a zip beside the files


class Found(NamedTuple):
    """The tables in and below a folder, those that are hidden, and files of other kinds. Only the first are read."""

    tables: tuple[Path, ...]
    hidden: tuple[Path, ...]
    others: tuple[Path, ...]


class Table(NamedTuple):
    """A table or a piece of one as text, whose rows are numbered as the lines of the file: a CSV's header is row 1."""

    file: Path
    row: Int[np.ndarray, " R"]
    columns: dict[str, list[str]]
    repeated: tuple[str, ...] = ()  # names that more than one column has
    row_names: bool = False  # a first column without a name was left out: row names, as R writes them


def find_tables(folder: Path) -> Found:
    """Find every table in and below `folder`; a folder NAME.parquet is one table, whatever its parts are called."""
    tables, hidden, others = [], [], []
    for path in sorted(folder.rglob("*")):
        inside, suffix = path.relative_to(folder), path.suffix.lower()
        if any(parent.suffix.lower() == ".parquet" for parent in inside.parents):
            continue  # a part of a table
        is_file = path.is_file() or path.is_symlink()
        is_table = (is_file and suffix in SUFFIXES) or (path.is_dir() and suffix == ".parquet")
        if any(part.startswith(".") or part == ARCHIVE_LITTER for part in inside.parts):
            hidden += [path] if is_table else []
        elif is_table:
            tables.append(path)
        elif is_file:
            others.append(path)
    return Found(tuple(tables), tuple(hidden), tuple(others))


def contents(path: Path) -> Iterator[bytes]:
    """Read the name and the bytes of a file, or of every file in a folder. Raises ValueError where one cannot be read."""
    files = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
    for file in files:
        yield str(file).encode()
        yield from read_bytes(file)


def read_bytes(file: Path) -> Iterator[bytes]:
    """Read a file part by part."""
    try:
        with file.open("rb") as content:
            while part := content.read(READ):
                yield part
    except OSError as error:
        raise ValueError(f"{file}: cannot be read: {error.strerror}") from None


def read_pieces(file: Path) -> Iterator[Table]:
    """Read one table: a CSV (UTF-8, any line ends) whole, Parquet in pieces of some of its rows.

    Raises ValueError naming file and row where it cannot be read.
    """
    if file.suffix.lower() == ".parquet":
        yield from _read_parquet(file)
    else:
        yield _read_csv(file)


def _read_parquet(file: Path) -> Iterator[Table]:
    try:
        import pandas as pd
        import pyarrow.dataset
    except ImportError as error:
        needed = "pandas and pyarrow, which are not installed"
        raise ValueError(f"{file}: this needs {needed}; install aircl-jax[animals]") from error
    first, batches = 1, _batches(file, pyarrow.dataset)
    while True:
        try:
            batch = next(batches, None)
            if batch is None:
                return
            table = batch.to_pandas()
            named = any(name is not None for name in table.index.names)
            table = table.reset_index(drop=not named).astype("string")
        except Exception as error:  # the readers of Parquet pass on errors of many kinds
            reason = (str(error) or type(error).__name__).splitlines()[0]
            raise ValueError(f"{file}: no readable Parquet file: {reason}") from None
        names = [str(name) for name in table.columns]
        columns = {
            name: ["" if text is pd.NA else str(text) for text in table.iloc[:, place].tolist()]
            for place, name in enumerate(names)
        }
        yield Table(file, np.arange(first, first + len(table)), columns, _repeated(names))
        first += len(table)


def _batches(file: Path, dataset: Any) -> Iterator[Any]:
    """Read a Parquet file or a folder of parts, row group by row group, in batches; one without rows where there is none."""
    folders = dataset.HivePartitioning.discover(infer_dictionary=True) if file.is_dir() else None
    found, empty = dataset.dataset(file, format="parquet", partitioning=folders), True
    for batch in found.to_batches(batch_size=PIECE, batch_readahead=1, fragment_readahead=1):
        if batch.num_rows:
            empty = False
            yield batch
    if empty:
        yield found.schema.empty_table()


def _read_csv(file: Path) -> Table:
    (_, header), *records = _records(file, _decoded(file))
    if not any(header):
        raise ValueError(f"{file}: row 1: the header is empty")
    records = [(row, record) for row, record in records if any(record)]  # the others are blank
    row_names = _has_row_names(file, header, records)
    if row_names:
        records = [(row, record[1:]) for row, record in records]
    padded = [record + [""] * (len(header) - len(record)) for _, record in records]
    columns = {name: [record[place] for record in padded] for place, name in enumerate(header)}
    return Table(file, np.array([row for row, _ in records], dtype=np.int64), columns, _repeated(header), row_names)


def _decoded(file: Path) -> str:
    content = b"".join(read_bytes(file))
    if not content.strip():
        raise ValueError(f"{file}: row 1: the file is empty")
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        text, wrong = "", error.start
    else:
        wrong = content.find(b"\0")
    if wrong >= 0:
        row = content.count(b"\n", 0, wrong) + 1
        column = content.count(b",", content.rfind(b"\n", 0, wrong) + 1, wrong) + 1
        raise ValueError(f"{file}: row {row}, column {column}: not UTF-8 text (byte {content[wrong]:#04x})")
    return text.removeprefix("\ufeff")


def _records(file: Path, text: str) -> list[tuple[int, list[str]]]:
    """Split a CSV into its records, each with the line on which it begins."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    records, row = [], 1
    try:
        for record in reader:
            records.append((row, record))
            row = reader.line_num + 1
    except csv.Error as error:
        unclosed = "unexpected end" in str(error) or "field limit" in str(error)
        words = "a quote is opened and never closed" if unclosed else f"no CSV: {error}"
        raise ValueError(f"{file}: row {row}: {words}") from None
    return records


def _has_row_names(file: Path, header: Sequence[str], records: Sequence[tuple[int, list[str]]]) -> bool:
    """Say whether the rows begin with a name for which the header has none, as R's write.table writes them.

    Row names are numbers from 1 on, or texts that differ. Raises ValueError for any other row that is longer than the
    header, because nothing says which of its fields is one too many.
    """
    longer = [(row, record) for row, record in records if len(record) > len(header)]
    if not longer:
        return False
    row, record = longer[0]
    counts = f"row {row}: {len(record)} fields where the header has {len(header)}"
    if len(longer) < len(records) or any(len(each) != len(header) + 1 for _, each in records):
        raise ValueError(f"{file}: {counts}")
    if not any(each[-1] for _, each in records):
        raise ValueError(f"{file}: {counts}, and the last of all {len(records)} rows is empty: a comma too many ends each row")
    names = [each[0] for _, each in records]
    numbered = names == [str(number) for number in range(1, len(names) + 1)]
    worded = len(set(names)) == len(names) and not any(name[:1].isdigit() or name[:1] in "+-." for name in names)
    if not numbered and not worded:
        raise ValueError(f"{file}: {counts} in all {len(records)} rows, and the first is no row's name; name every column")
    return True


def _repeated(names: Sequence[str]) -> tuple[str, ...]:
    return tuple(sorted({name for name in names if names.count(name) > 1}))
