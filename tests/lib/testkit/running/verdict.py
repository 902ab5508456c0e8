"""The rule of every fault: a stop is right, or it is named as doubtful, or it is asked for again;
never silently wrong."""

from stepdiag.daq.replay import begun_logs, replay
from stepdiag.virtual.bench.building import alignment_of, build_box, build_machine
from stepdiag.virtual.bench.config import read_config
from testkit.ordinary.measured import simulate_pass

RIGHT_UM = 0.5
"""A stop is right within this: the noise is 0.2 µm a sample, the machine swings out to below a
tenth of a micrometre."""


def nothing_silently_wrong(place, folder=None):
    """Return the passes of a survey, from its logs; every stop used reads what the machine truly
    did, or is doubted by name."""
    config = read_config(place.folder / "bench.toml")
    machine, box = build_machine(config), build_box(config)
    book = replay(begun_logs(folder or place.round)).book
    for each in book.passes:
        true = simulate_pass(
            machine,
            box,
            each.route.setup,
            each.number,
            alignment=alignment_of(config, each.route.setup),
        )
        chosen = each.chosen()
        first = min(chosen)
        zero = chosen[first].reading_mm - true.reading_mm[first]
        for index, stop in chosen.items():
            error_um = (stop.reading_mm - zero - true.reading_mm[index]) * 1e3
            assert abs(error_um) < RIGHT_UM or stop.doubts or each.doubt(index), (
                f"stop {index} wrong by {error_um:.2f} µm and not named"
            )
    return book
