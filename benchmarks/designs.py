"""Do surveys that the planner proposes leave of exact machines what is forecast?

``PYTHONPATH=tests/lib python -m benchmarks.designs [MACHINES]``
"""

import sys

from testkit.rates.designs import MACHINES, table

if __name__ == "__main__":
    table(int(sys.argv[1]) if len(sys.argv) > 1 else MACHINES)
