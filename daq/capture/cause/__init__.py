"""Common cause of the contradictions in a whole pass: the wrong statement of the survey file whose
correction makes the machine's stops and the laser's steps plausible.

Theory of operation ------------------- A wrong line of the survey file spoils every stop in the
same way. If each stop is judged alone, such a line gives a hundred findings, and none of them names
the line. So the standstills of a pass are judged together, before a finding about one of them is
raised.

Observations. Standstill i of a pass shows a setup code c, decoded positions p_i (mm, three axes, or
none) and the laser's reading r_i (mm, while its count is unbroken). The laser's signal does not
pass through the control: its steps are an independent witness of the machine's path.

Hypotheses. The pass starts at the first stop of a route (setup, direction, axis order, box); stop i
has the planned position x_i and the nominal reading n_i. A cause changes exactly one statement:

- Positions: p = k x + c per axis, with a wrong offset, sign, factor, permutation or diameter, or a
  register that is not the commanded position.
- Laser: r_i - r_(i-1) = f (n_i - n_(i-1)), with a wrong sign, optics factor or unit.
- Time: the laser's move begins and ends later or earlier than the signals' move. A latency of laser
  or control shifts both edges alike; a stop bit that comes before the machine rests shifts the
  second edge alone. The steps are then those of the laser's moves: a window between late signals
  may hold the reading of the next stop.
- Route: another axis order, another setup than the code states, another box. Two orders in which
  two axes make the same step cannot be separated; they are one hypothesis with two values.

Likelihood. Every coordinate scatters by `PLACED_MM` about its hypothesis, or is an outlier with
probability `OUTLIER`, spread over `RANGE_MM`; every step of the laser likewise, by the noise of a
step in the chain (`naming.walk.noise_mm`). A free number fitted to the standstills (an offset, a
length) costs ln(RANGE_MM / PLACED_MM), the price of its search (Occam's factor, MacKay 2003,
chapter 28); a cause costs `CAUSE`, the prior odds against a wrong statement. The hypothesis of a
right file costs nothing, except `FAILURE` for each standstill that is not the next stop (a feed
hold, a stop driven twice or not seen) on the best path of stops. So one odd standstill names no
cause, but two or three odd standstills that a common line explains do.

Decision. From the third standstill on, a cause is named when it is e^`SURE` times as likely as a
right file and as every cause that changes another line, and when the laser has confirmed two of its
steps. Of two causes with equal fit, neither is named as the cause: a finding states both lines and
the next move that separates them. A pass whose steps fit the file is not judged any more after
every axis has moved, and no pass after `LAST` standstills. One case stays open until the pass ends:
without positions, a pass that begins at its second stop makes the same steps as another order of
axes. The number of stops at the end of the pass decides.

Findings explained by a named cause are not raised at single stops (`EXPLAINED`). The machine's
signals, not this module, name the stops; after a correction of the file the stops are named again
from the logs.
"""
