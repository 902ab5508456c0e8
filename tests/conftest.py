"""How the property tests draw: the same examples in every `make test`, new ones with ``--hypothesis-profile explore``."""

import os

from hypothesis import HealthCheck, Phase, settings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the program does, and before numpy is loaded

# A change is judged by what it did, not by the luck of the draw nor by how busy the machine is; `make explore` looks for new examples.
BUSY = [HealthCheck.too_slow]
settings.register_profile("steady", derandomize=True, deadline=None, database=None, print_blob=True, suppress_health_check=BUSY)
settings.register_profile("explore", derandomize=False, deadline=None, print_blob=True, suppress_health_check=BUSY)
# of a changed program only whether a test notices it is asked (tools/mutants): few examples, and none made smaller
settings.register_profile("mutants", settings.get_profile("steady"), max_examples=25, phases=[Phase.explicit, Phase.generate])
settings.load_profile("steady")
