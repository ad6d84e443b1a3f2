"""Hold Table 1 of the paper, as printed.

"Adversarial Inverse Reward-Constraint Learning with Reward-Feasibility Contrast Prior Inspired by Animal Behaviour",
anonymous authors: discriminator accuracy (RCAcc) and constraint violation rate, mean ± std of ten seeds.
"""

from collections.abc import Mapping

COLUMNS = ("gridworld", "swimmer", "walker", "pendulum")
PRINTED = ("rc_acc", "violation_rate")  # the two measures of the table, under our names

# RCAcc in the four columns, then the violation rate in the same; – where the paper has none. AIRCL without the prior
# has the same RCAcc, 0.635 ± 0.201, on the grid and on the pendulum there.
_TABLE_1 = """
airl           0.625±0.078 0.500±0.100 0.501±0.001 0.553±0.054   0.095±0.026 0.614±0.035 0.936±0.006 0.321±0.281
gacl           0.828±0.056 0.635±0.104 0.755±0.043 0.565±0.128   0.073±0.026 0.623±0.007 0.942±0.002 0.432±0.151
icrl           –           –           –           –             0.055±0.046 0.626±0.028 0.940±0.001 0.405±0.213
icrl_prior     –           –           –           –             0.051±0.039 0.605±0.013 0.940±0.003 0.400±0.221
aircl          0.829±0.026 0.769±0.131 0.506±0.011 0.851±0.131   0.071±0.036 0.589±0.030 0.936±0.005 0.214±0.244
aircl_no_prior 0.635±0.201 0.744±0.100 0.510±0.013 0.635±0.201   0.081±0.036 0.589±0.027 0.938±0.006 0.234±0.222
aircl_linear   0.805±0.019 0.768±0.109 0.512±0.009 0.806±0.169   0.079±0.020 0.621±0.006 0.936±0.003 0.214±0.132
aircl_sa       0.820±0.027 0.753±0.082 0.508±0.008 0.658±0.195   0.082±0.042 0.627±0.030 0.939±0.004 0.348±0.218
"""

Printed = Mapping[str, tuple[float, float]]  # {measure: (mean, std)}


def _parsed() -> dict[str, dict[str, Printed]]:
    places = [(measure, env) for measure in PRINTED for env in COLUMNS]
    table: dict[str, dict[str, dict[str, tuple[float, float]]]] = {env: {} for env in COLUMNS}
    for line in _TABLE_1.split("\n")[1:-1]:
        method, *numbers = line.split()
        for (measure, env), number in zip(places, numbers, strict=True):
            row = table[env].setdefault(method, {})
            if number != "–":
                mean, std = map(float, number.split("±"))
                row[measure] = (mean, std)
    return {env: dict(rows) for env, rows in table.items()}


PAPER: Mapping[str, Mapping[str, Printed]] = _parsed()  # {env: {method: {measure: (mean, std)}}}
METHODS_OF_THE_PAPER = tuple(PAPER["gridworld"])
