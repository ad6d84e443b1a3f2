"""Find the folder of the animals' data: `env.data`, else the variable AIRCL_DATA, else none for simulated animals."""

import os
from pathlib import Path

VARIABLE = "AIRCL_DATA"  # a folder with meerkat/ and labyrinth/ in it


def data_folder(setting: str, name: str) -> Path | None:
    """Find the folder of one animal's data; None where it is simulated. Raises ValueError for a missing folder.

    `setting` is a folder (or one that holds a folder `name`), `simulated`, or `default`. The last means the folder of the
    variable where that is set, and simulated data otherwise.
    """
    if setting == "simulated" or (setting == "default" and not os.environ.get(VARIABLE)):
        return None
    if setting == "default":
        folder = Path(os.environ[VARIABLE]) / name
        if not folder.is_dir():
            raise ValueError(f"{VARIABLE}={os.environ[VARIABLE]}: no folder {name} in it; set env.data=DIR or simulated")
        return folder
    folder = Path(setting)
    if not folder.is_dir():
        raise ValueError(f"env.data={setting}: no such folder; give a folder, or simulated")
    return folder / name if (folder / name).is_dir() else folder


def command_prefix(setting: object, simulated: bool) -> str:
    """Return the `AIRCL_DATA=DIR ` that a repeated command needs; empty where the variable was not used."""
    return f"{VARIABLE}=DIR " if setting == "default" and not simulated else ""
