"""The names of standstills: each standstill of a pass is assigned to a stop, here alone.

Theory of operation
-------------------
A pass is a hidden Markov chain (Rabiner 1989) over its standstills. The hidden state of a
standstill is (pass, stop, approach): the pass is a setup in one direction with one order of its
axes; the stop is a place on its route; the approach is the step of the plan, a step outside the
plan (astray), or none: then the machine stands at no stop, and the stop of the state is the last
one that it reached. `walk.Chain` follows the most probable path standstill by standstill (Viterbi
1967). The name of a standstill is the end of the best path. The margin is the logarithm of the odds
of that path against the best path with another end; a small margin is a doubt.

Moves. The step to the next stop has no cost. Every other move is a fault with a rate: a stop that
is not seen, the same stop again, the first stop again, the last stop, where the program of the
other direction begins, any other stop, a hold where no stop is, a step of another axis or the other
way. Stops that are missed one after another are a single fault, whose length is any unless the
counter shows it. The rates stand in `noise`.

Observations. Each observation has a noise and a rate of failure, and is omitted where the machine
does not show it. So one chain serves machines with all registers, with the stop bit alone, and
without signals.

    position    the plan's position of the stop; any position for a standstill at no stop
    counter     the number of stops since the standstill before, also by a marker input; a counter
                that was wrong once may stay wrong. A counter that is set back shows that a program
                begins anew, and is the number of the stop in the NC programs
    laser       the reading of the same stop in the same count, else the reading of a known stop and
                the nominal way from it. A lost count is an observation without memory: the readings
                before the loss are ignored. A reading that fits no stop begins a new memory
    time        how long a standstill lasts: `by_laser` leaves out the short plateaus

A later standstill may change the names of earlier ones. These are placed again by their new names.

The signals choose the setup (`finder`); without the signal of the setup, the laser's unbroken count
and the position do. At every standstill the program may begin anew with another order of the axes.
The direction follows from the chain: the first standstill
of a log extends the path of the pass that goes on, the path of a pass that begins in the other
direction, and the paths over a turn that no standstill has shown. `walk.Walk` compares the names
with counter and laser, and states what disagrees.
"""
