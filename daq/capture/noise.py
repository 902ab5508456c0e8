"""Noise and failure rates of the observations: the numbers by which the capture decides.

Theory of operation
-------------------
An observation of a standstill is a position, a counter, a reading of the laser, a sample of a
window or a time. Each observation has a noise, and now and then an observation fails. A fact about
machines, instruments or persons that several decisions need stands here once. A decision compares
logarithms of odds: the cost of an event is minus the logarithm of the event's rate.

Events. `FAULT` is the rate of an event on the shop floor: stops that are not seen, a hold where no
stop is, a program begun anew, a wrong line of the survey file. Events are independent, so a place
that the program does not plan costs two faults. `FAILURE` is the rate of an observation that fails.
`ORDINARY` is the cost of an event that an earlier one makes probable: a failure after a failure, or
a program begun anew after a cut beam.

Noise. A machine at a stop is within `STILL_MM` of rest. A step agrees with the geometry within
`STILL_MM` and `STEP_TOLERANCE`, which are `SIGMAS` standard deviations of the step's noise. A
position scatters by `PLACED_MM`. An observation that fails lies anywhere within `RANGE_MM`.

Margins. A difference of `SIGMAS` standard deviations is no noise. `LEAST_SAMPLES` samples show
their own scatter, and `SERIES` samples show the course of a quantity. `MAJORITY` is the larger
part of a whole.

Times. A machine takes longer than `MOMENT_NS` for anything that it does. Samples and registers lag
behind the stop signal by at most `LAG_NS`.
"""

FAULT, FAILURE, ORDINARY = 5.0, 8.0, 1.0
"""Costs of events: one standstill, or one survey file, in 150 has a fault; one observation in 3,000
fails.
"""
SIGMAS = 5.0
"""Noise is smaller than this number of its standard deviations."""
STILL_MM = 0.02
"""Largest distance in mm of a standing machine while it comes to rest; the shortest step, and an
overrun that takes up the backlash, are longer.
"""
STEP_TOLERANCE = 0.02
"""Largest error of a step as a share of its length: twenty times a badly aligned mirror, a tenth of
a wrong step.
"""
PLACED_MM, BESIDE_MM = 0.1, 0.25
"""Distances in mm from a stop of a machine that is at the stop. Encoder positions scatter by 0.1 to
3 um, programs of two decimals are off by 5 um; with G91 that adds up to 0.1 mm over twenty
increments, 0.2 mm over forty. Vibration, overshoot and slips of a count are smaller, too.
"""
RANGE_MM = 1000.0
"""Range of a reading, or of a position, about which nothing is known."""
LEAST_SAMPLES = 3
"""Fewer samples do not show their own scatter, and are single wrong lines of a laser and no move. A
polled display gives no more in a short dwell.
"""
SERIES = 8
"""Fewer values do not show a course: correlation, two levels beside a straight line, a value that
stands still.
"""
MAJORITY = 0.5
"""The larger part decides: of a window, of a step, of a dwell, of the way of a leaving machine,
which is seen on it while a slip of the count is complete at once.
"""
MOMENT_NS = 100_000_000
"""A machine takes longer to come to rest, and to overrun a stop by 2 mm and return."""
FLICKER_NS = 3 * MOMENT_NS
"""A shorter absence of the stop signal in ns is a flicker: to make a step, a machine leaves, moves
and comes to rest.
"""
LAG_NS = 500_000_000
"""Longest time in ns by which the samples of a standstill, or the position registers, lag behind
the stop signal.
"""
