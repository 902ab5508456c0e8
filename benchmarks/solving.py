"""``python -m benchmarks.solving``: a process that solves surveys until it is told to end, standing
back as the daemon's child does."""

from stepdiag.daq.service.priority import lower_priority

if __name__ == "__main__":
    lower_priority()
    from benchmarks.bench_solver import survey
    from stepdiag.solver.methods.estimate import estimate

    layout = survey(30, beams=3)
    while True:
        estimate(layout, "FXYZ")
