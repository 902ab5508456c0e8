"""Do surveys that the planner proposes leave of exact machines what is forecast, and are they at their end where it is stated?

``PYTHONPATH=tests/lib python -m benchmarks.designs [MACHINES]``
"""

import sys

from testkit.rates import sequels
from testkit.rates.designs import MACHINES, table

if __name__ == "__main__":
    machines = int(sys.argv[1]) if len(sys.argv) > 1 else MACHINES
    table(machines)
    sequels.table(machines)
