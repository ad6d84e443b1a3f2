"""Log to Weights & Biases, or to trackio, which has the same functions: offline unless the environment says otherwise."""

import hashlib
import os
from collections.abc import Mapping
from typing import Any

from aircl_jax.recorders.logger import Logger, Run, imported

PROJECT = "aircl-jax"
MODE = "WANDB_MODE"  # the environment's variable that turns the network on: `online`


class Wandb(Logger):
    """Files in RUN/wandb; `wandb sync RUN/wandb/offline-…` uploads them later."""

    word = "wandb"
    extra = "aircl-jax[log]"

    def __init__(self, run: Run) -> None:
        super().__init__(run)
        self._package: Any = imported(self.word, self.word, self.extra)

    def begin(self) -> None:
        same = hashlib.sha256(str(self.run.folder.resolve()).encode()).hexdigest()[:16]  # a resumed run is the same run
        self._log = self._package.init(
            project=PROJECT,
            name=self.run.name,
            id=same,
            resume="allow",
            dir=str(self.run.folder),
            mode=os.environ.get(MODE, "offline"),
            config=dict(self.run.settings),
        )

    def write(self, step: int, values: Mapping[str, float]) -> None:
        self._package.log(dict(values), step=step)

    def end(self) -> None:
        self._package.finish()


class Trackio(Wandb):
    """trackio keeps its own folder on this machine; it sends nothing unless told to by its own settings."""

    word = extra = "trackio"

    def begin(self) -> None:
        self._log = self._package.init(project=PROJECT, name=self.run.name, config=dict(self.run.settings), resume="allow")
