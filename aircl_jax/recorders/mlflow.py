"""Log to MLflow: to the server of MLFLOW_TRACKING_URI, or into the run's own folder."""

import os
import re
from collections.abc import Mapping
from typing import Any

from aircl_jax.recorders.logger import Logger, Run, imported

SERVER = "MLFLOW_TRACKING_URI"  # the environment's variable
STORE = "mlflow.db"  # within the folder of the run
REFUSED = r"[^\w\-. :/]"  # letters that MLflow takes in no name
LONGEST = 500  # letters that MLflow keeps of a setting


class MLflow(Logger):
    """One run of MLflow; RUN/mlflow.db where no server is named."""

    word = "mlflow"

    def __init__(self, run: Run) -> None:
        super().__init__(run)
        self._package: Any = imported(self.word, "mlflow")

    def begin(self) -> None:
        if SERVER not in os.environ:
            self._package.set_tracking_uri(f"sqlite:///{(self.run.folder / STORE).resolve().as_posix()}")
        self._package.set_experiment("aircl-jax")
        self._package.start_run(run_name=self.run.name)
        self._package.log_params({name: str(value)[:LONGEST] for name, value in self.run.settings.items()})

    def write(self, step: int, values: Mapping[str, float]) -> None:
        self._package.log_metrics({re.sub(REFUSED, "_", name): value for name, value in values.items()}, step=step)

    def end(self) -> None:
        self._package.end_run()
