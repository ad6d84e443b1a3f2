"""Log to TensorBoard by tensorboardX: `tensorboard --logdir RUN` shows the runs in a folder."""

from collections.abc import Mapping
from typing import Any

from aircl_jax.recorders.logger import Logger, Run, imported

FOLDER = "tensorboard"  # within the run's


class TensorBoard(Logger):
    """Event files in RUN/tensorboard; a resumed run adds another to them."""

    word = "tensorboard"

    def __init__(self, run: Run) -> None:
        super().__init__(run)
        self._package: Any = imported(self.word, "tensorboardX")

    def begin(self) -> None:
        self._writer = self._package.SummaryWriter(str(self.run.folder / FOLDER))
        text = "\n".join(f"    {name}: {value}" for name, value in self.run.settings.items())
        self._writer.add_text("settings", text)

    def write(self, step: int, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            self._writer.add_scalar(name, value, step)

    def end(self) -> None:
        self._writer.close()
