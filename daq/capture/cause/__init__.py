"""Common cause of the contradictions in a whole pass: the wrong statement of the survey file whose
correction makes the machine's stops and the laser's steps plausible.

Theory of operation
-------------------
A wrong line of the survey file spoils every stop in the same way. Judged stop by stop, such a line
gives a hundred findings, and no finding names the line. So the standstills of a pass are judged
together, before any of them is reported.

Observations. Standstill i of a pass shows a setup code c, decoded positions p_i (mm, three axes, or
none) and the laser's reading r_i (mm, while its count is unbroken). The laser's signal does not
pass through the control: its steps are an independent witness of the machine's path.

Hypotheses. The pass starts at the first stop of a route (setup, direction, axis order, box); stop i
has the planned position x_i and the nominal reading n_i. A cause changes exactly one statement:

    positions    p = k x + c per axis: offset, sign, factor, permutation, diameter, a register that
                 is not the commanded position
    laser        r_i - r_(i-1) = f (n_i - n_(i-1)): sign, optics factor, unit
    time         the laser's move begins and ends later or earlier than the signals' move: latency
                 of the laser or of the control (both edges alike), or a stop bit that comes before
                 the machine rests (the second edge alone). The steps are then those of the moves at
                 that time: a window between late signals may hold the reading of the next stop
    route        another axis order, another setup than the code states, another box. Orders that no
                 observation separates, because two axes make the same step, are one hypothesis with
                 two values

Likelihood. Every coordinate scatters by `PLACED_MM` about its hypothesis, or fails at the rate
`FAILURE` and lies anywhere within `RANGE_MM`; every step of the laser likewise, by the noise of a
step in the chain (`naming.route.step_noise_mm`). A free number fitted to the standstills (an
offset, a length) costs ln(RANGE_MM / PLACED_MM), the price of its search (Occam's factor, MacKay
2003, chapter 28); a cause costs `FAULT`, the prior odds against a wrong statement. The hypothesis
that the file is right costs nothing; each standstill that is not the next stop (a feed hold, a stop
driven twice or not seen) costs `FAILURE`, over the best path of stops: a single odd standstill is
no cause over a whole pass, two or three explained by a common line are.

Decision. From the third standstill on, a cause is named when it is e^`FAILURE` times as likely as a
right file and as every cause that changes another line, so that one failed observation cannot name
a cause, and when the laser has confirmed two of its steps. Of two causes with equal fit, neither is
named as the cause: a finding states both lines and the next move that decides. A pass is
judged again at each standstill; the judgement ends after `LAST` standstills, or, if the steps fit
the survey file, as soon as every axis has moved. One pair of causes stays open until the pass ends:
without positions a pass that begins at its second stop makes the steps of another order of axes.
The number of stops at its end decides.

Findings explained by a named cause are not raised at single stops (`EXPLAINED`). The machine's
signals, not this module, name the stops; after a correction of the file the stops are named again
from the logs.
"""
