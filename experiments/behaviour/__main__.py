"""Say of recorded animals when they leave an activity, where they go, what they avoid, and what is not told.

`python -m experiments.behaviour` fits the behaviour model to the meerkats' tables, judges it on held-out recordings beside
counting, and writes report.md, card.md, figures and recovered.npz. Any animal: `mapping=FILE.yaml data=FOLDER`.

env      meerkat (or any table with a mapping), labyrinth, or mobs: simulated mobs whose constraint is known
data     folder of tables, simulated, or default: the folder of the variable AIRCL_DATA
mapping  name or file of the column mapping
coding   bout or step
halves   random halves of the recordings on which flagged changes are judged; 0 for none
nested   true: choose features and ridges for each fold from the other folds (minutes)
mobs     number of simulated mobs of env=mobs
out      folder of the results
"""

import sys
from collections.abc import Sequence

from experiments.behaviour.settings import RESULTS, Settings
from experiments.behaviour.summary import summarise
from experiments.cli.command import run_command


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(make, argv, Settings(), __doc__)


def make(settings: Settings, words: Sequence[str]) -> None:
    """Run the study of these animals."""
    if settings.env == "meerkat":
        from experiments.behaviour.of_tables import run
    elif settings.env == "labyrinth":
        from experiments.behaviour.of_maze import run
    else:
        from experiments.behaviour.of_mobs import run
    run(settings, words)
    if settings.reported:
        summarise(RESULTS)


if __name__ == "__main__":
    sys.exit(main())
