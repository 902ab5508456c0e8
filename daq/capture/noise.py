"""Noise and failure rates of the observations: the numbers by which the capture decides.

Theory of operation
-------------------
An observation of a standstill is a position, a counter, a reading of the laser, a sample of a
window or a time. Each observation has a noise, and now and then an observation fails. This module
contains the numbers that several decisions use. A decision compares logarithms of odds: the cost of
an event is minus the logarithm of the event's rate.

Events. `FAULT` is the cost of an event on the shop floor: a missed stop, a hold between two stops,
a restarted program, or a wrong line of the survey file. Events are independent, so their costs add
up: a step that the program does not plan costs two faults. `FAILURE` is the cost of an observation
that fails. `ORDINARY` is the cost of an event that an earlier event makes probable: a failure after
a failure, or a restarted program after a cut beam.

Noise. A machine at a stop is within `STILL_MM` of rest. A step agrees with the geometry within the
sum of `STILL_MM` and the share `STEP_TOLERANCE` of the step. This sum is `SIGMAS` standard
deviations of the step's noise. A position scatters by `PLACED_MM`. An observation that fails lies
anywhere within `RANGE_MM`.

Margins. A difference of `SIGMAS` standard deviations is no noise. `LEAST_SAMPLES` samples show
their own scatter, and `SERIES` samples show the course of a quantity. A share above `MAJORITY`
decides.

Times. A machine takes longer than `MOMENT_NS` for anything that it does. Samples and registers lag
behind the stop signal by at most `LAG_NS`.
"""

FAULT, FAILURE, ORDINARY = 5.0, 8.0, 1.0
"""Costs of events. One standstill in 150 has a fault, and so has one survey file in 150. One
observation in 3,000 fails.
"""
SIGMAS = 5.0
"""Noise is smaller than this number of its standard deviations."""
STILL_MM = 0.02
"""Largest distance in mm from rest of a machine that comes to rest. The shortest step is longer,
and so is an overrun that takes up the backlash.
"""
STEP_TOLERANCE = 0.02
"""Largest error of a step as a share of its length. A badly aligned mirror causes a twentieth of
this error, a wrong step ten times this error.
"""
PLACED_MM, BESIDE_MM = 0.1, 0.25
"""Noise of a position, and largest distance between a standing machine and its stop, in mm. Encoder
positions scatter by 0.1 to 3 um. A program with two decimals rounds by up to 5 um; with G91 the
rounding adds up to 0.1 mm over twenty increments and 0.2 mm over forty. Vibration, overshoot and
slips of a count are below these distances.
"""
RANGE_MM = 1000.0
"""Range of a reading, or of a position, about which nothing is known."""
LEAST_SAMPLES = 3
"""Least number of samples that show their own scatter. Fewer deviating samples may be single wrong
lines of a laser and are no evidence of a move. A polled display sends only this number of samples
in a short dwell.
"""
SERIES = 8
"""Least number of values that show a course: their correlation, a step, or a constant value."""
MAJORITY = 0.5
"""Least share of a window, a step, a dwell or a travel that decides. Samples within the first half
of the travel show a leaving machine, because a slip of the count is complete at once.
"""
MOMENT_NS = 100_000_000
"""Shortest time in ns of any part of a move: a machine takes longer to come to rest, or to overrun
a stop by 2 mm and return.
"""
FLICKER_NS = 3 * MOMENT_NS
"""Shortest time in ns without the stop signal that can be a step, in which the machine leaves,
moves and comes to rest. A shorter time is a flicker.
"""
LAG_NS = 500_000_000
"""Longest time in ns by which the samples of a standstill, or the position registers, lag behind
the stop signal.
"""
