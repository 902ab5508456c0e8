"""How often is a right table refused, and a wrong one taken for right?

``python -m benchmarks.wrong_tables [MACHINES]``
"""

import sys

from testkit.rates.wrong_tables import MACHINES, print_rates

if __name__ == "__main__":
    print_rates(int(sys.argv[1]) if len(sys.argv) > 1 else MACHINES)
