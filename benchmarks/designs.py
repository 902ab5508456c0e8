"""Do surveys that the planner proposes leave of exact machines what is forecast, do they end where
that is stated, are screws named?

``python -m benchmarks.designs [MACHINES]``
"""

import sys

from testkit.rates import screws, sequels
from testkit.rates.designs import MACHINES, table

if __name__ == "__main__":
    machines = int(sys.argv[1]) if len(sys.argv) > 1 else MACHINES
    table(machines)
    sequels.table(machines)
    screws.table(machines)
